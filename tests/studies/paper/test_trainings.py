"""Scatter between trainings: read off what is kept, and squeezed by its kind."""

import numpy as np
import pytest
from studies.paper import claims
from studies.paper.claim import Counted, Kind
from studies.paper.experiment import committed
from studies.paper.grid_populations import LEVELS, is_kept
from studies.paper.moderated import prior_of
from studies.paper.numbers import by_claim
from studies.paper.paper_flow import ON_NICER, TRAININGS
from studies.paper.trainings import AUC, NONE, POSTERIOR, Scatter, by_training, kind_of, scatter

EXPERIMENTS = (
    *("detection", "importance", "calibration_published", "line_bias", "gain_marginalised"),
    *("detection_nicer", "calibration_nicer", "conformal", "cross_check"),
)
"""Those that ran with every training."""


def kept():
    """Trainings of every part that a judged claim's rules look at, in units of its error, by kind."""
    found = {AUC: [], POSTERIOR: []}
    for experiment in EXPERIMENTS:
        table = committed(experiment)
        errors = by_claim(table, "standard_error")
        for name, parts in by_claim(table).items():
            claim = claims().get(name)
            if claim is None or claim.counted is not Counted.JUDGED or claim.kind is not Kind.FLOW:
                continue
            margins = {(m.part, m.less) for rule in claim.rules for m in rule.margins(claim.parts)}
            for part, less in margins:
                names = [part, less] if less else [part]
                if not all(word in parts and word in errors[name] for word in names):
                    continue
                row = by_training(claim, part) - (by_training(claim, less) if less else 0.0)
                unit = np.sqrt(sum(errors[name][word] ** 2 for word in names))
                if name.startswith("grid."):
                    unit = claim.error["value"]
                if np.ptp(row) > 0 and len(row) == len(TRAININGS):
                    found[kind_of(claim)].append(row / unit)
    return {kind: np.array(rows) for kind, rows in found.items()}


@pytest.fixture(scope="module")
def priors():
    return {kind: prior_of(rows) for kind, rows in kept().items()}


def test_a_difference_of_two_trainings_has_twice_the_variance_and_a_bound_has_none_of_the_published():
    one = Scatter(sd=3.0, df=5.0)
    assert one.error(1) == pytest.approx(3.0 * 2**0.5)
    assert one.error(9) == pytest.approx(3.0 * (10 / 9) ** 0.5)
    assert one.error(9, published=False) == pytest.approx(1.0)


def test_degrees_of_freedom_grow_with_trainings_where_they_are_a_claims_own():
    own = Scatter(sd=1.0, df=5.0, own=3.0, trainings=4)
    assert (own.freedom(4), own.freedom(5), own.freedom(14)) == (5.0, 6.0, 15.0)
    # Two sets of four, as of the coverage deviation: six of their own.
    assert Scatter(sd=1.0, df=8.0, own=6.0, trainings=4).freedom(5) == 10.0
    assert Scatter(sd=1.0, df=2.0).freedom(4) == 5.0


def test_a_claim_of_fewer_trainings_is_squeezed_by_what_more_of_others_tell(priors):
    claim, prior = claims()["cal.dev.nicer.bright"], priors[POSTERIOR]
    row = by_training(claim)
    assert len(row) == len(ON_NICER) < len(TRAININGS)
    own = len(row) - 1.0
    unit = by_claim(committed(claim.by), "standard_error")[claim.id]["value"]
    variance = (prior.df * prior.scale + own * row.var(ddof=1) / unit**2) / (prior.df + own)
    found = scatter(claim, "value")
    assert found.sd == pytest.approx(unit * np.sqrt(variance))
    assert (found.df, found.own, found.trainings) == (pytest.approx(prior.df + own), own, len(row))


@pytest.mark.parametrize(
    ("name", "part", "less"),
    [
        ("grid.pn.bright.B1.5e-06.D2", "value", ""),
        ("is.sweep.3pc", "value", ""),
        ("det.B1.dGamma.bright", "mean", ""),
        # A step from one part to another scatters by what it does within a training.
        ("det.B1.dGamma.bright", "mean", "medium"),
        ("cal.dev.pn.faint", "value", ""),
    ],
)
def test_a_claim_scatters_as_its_trainings_do_squeezed_by_its_kind(priors, name, part, less):
    claim = claims()[name]
    row = by_training(claim, part) - (by_training(claim, less) if less else 0.0)
    assert len(row) == len(TRAININGS) == 4
    errors = by_claim(committed(claim.by), "standard_error")[name]
    unit = np.hypot(errors[part], errors[less]) if less else errors[part]
    if name.startswith("grid."):
        unit = claim.error["value"]
    prior = priors[kind_of(claim)]
    variance = (prior.df * prior.scale + 3.0 * row.var(ddof=1) / unit**2) / (prior.df + 3.0)
    found = scatter(claim, part, less)
    assert found.sd == pytest.approx(unit * np.sqrt(variance))
    assert (found.df, found.own, found.trainings) == (pytest.approx(prior.df + 3.0), 3.0, 4)


def test_kinds_are_large_enough_and_hold_every_claim_that_was_trained_again(priors):
    """Of 173 areas and 55 other numbers: what few of a kind would lend is little."""
    assert {kind: len(rows) for kind, rows in kept().items()} == {AUC: 173, POSTERIOR: 55}
    assert all(1.0 < prior.df < 10.0 for prior in priors.values())


def test_trainings_are_compared_on_the_same_spectra():
    table = committed("detection")
    row = table["claim"].values.tolist().index("grid.pn.bright.B1.5e-06.D2")
    mine = by_training(claims()["grid.pn.bright.B1.5e-06.D2"])
    np.testing.assert_array_equal(mine, table["trained"].values[:, row])
    assert table["number"].values[row] == pytest.approx(mine.mean())


def test_where_no_second_training_is_kept_the_kind_lends(priors):
    for name in ("tab2.range", "cal.spot.seed101"):
        claim, prior = claims()[name], priors[kind_of(claims()[name])]
        lent = scatter(claim, next(iter(claim.parts)), error=0.2)
        assert (lent.sd, lent.df) == (pytest.approx(0.2 * np.sqrt(prior.scale)), pytest.approx(prior.df))
        assert lent.own == 0.0
    # Of one network, which is not trained again: that it gives the same several times says nothing.
    assert not scatter(claims()["tab2.uncapped"], "failures").own


def test_what_no_training_decides_does_not_scatter():
    assert scatter(claims()["xc.fisher"], "value") == NONE == Scatter(sd=0.0, df=np.inf)


def test_deviations_scatter_as_the_bright_trainings_of_both_do(priors):
    tables = [committed(name) for name in ("calibration_retrained", "calibration_published")]
    ours = by_claim(tables[0]) | by_claim(tables[1])
    errors = by_claim(tables[0], "standard_error") | by_claim(tables[1], "standard_error")
    names = ("tab2.reseed101", "tab2.reseed202", "tab2.reseed303", "tab2.uncapped")
    both = [[ours[name]["dev"] for name in names], [claims()[name].parts["dev"] for name in names]]
    unit = np.sqrt(np.mean([errors[name]["dev"] ** 2 for name in names]))
    prior = priors[POSTERIOR]
    own = np.var(both, axis=1, ddof=1).mean() / unit**2
    known = scatter(claims()["tab2.uncapped"], "dev")
    squeezed = (prior.df * prior.scale + 6 * own) / (prior.df + 6)
    assert known.sd == pytest.approx(unit * np.sqrt(squeezed))
    assert (known.df, known.own) == (pytest.approx(6.0 + prior.df), 6.0)
    assert scatter(claims()["tab2.reseed101"], "dev") == known


def test_claims_of_the_studys_own_spectra_are_said_to_be():
    paired = {name for name, claim in claims().items() if claim.paired}
    cells = {name for name in paired if name.startswith("grid.")}
    assert len(cells) == 87
    assert "grid.pn.medium.B1.0.0003.D1" in cells
    assert "grid.pn.medium.B1.5e-06.D3" not in cells
    assert paired - cells == {
        "det.B1.dGamma.medium", "det.B1.dGamma.bright", "det.B3.bright.D2",
        *(f"tab1.{which}.medium.{family}" for which in ("best", "D3") for family in ("B1", "B2")),
        "tab1.D3.medium.B3",
        *(f"tab1.{which}.bright.{family}" for which in ("best", "D3") for family in ("B1", "B2", "B3")),
        *(f"tab4.{detector}.B1.{level}" for detector in ("D1", "D2") for level in ("medium", "bright")),
    }  # fmt: skip


def test_the_cell_that_is_best_is_of_a_kept_seed_where_the_best_is_paired():
    """By published and by our AUCs alike; so the smallest D3 of the levels is not: it is faint."""
    found = {}
    for name, claim in claims().items():
        if name.startswith("grid.pn."):
            level, family, *strength, detector = name.split(".")[2:]
            place = (level, family, "D3" if detector == "D3" else "best")
            both = (claim.value, by_training(claim).mean())
            kept = is_kept(level, family, float(".".join(strength)))
            found.setdefault(place, []).append((*both, kept))
    for (level, family, which), rows in found.items():
        if claims()[f"tab1.{which}.{level}.{family}"].paired:
            assert all(max(rows, key=lambda row, i=i: row[i])[2] for i in (0, 1)), (level, family)
    # Of one set of spectra, as the study's: what is told of the smallest is not of means over many.
    weakest = committed("detection").sel(response="epic-pn", detector="D3")["auc"].isel(strength=0)
    for family, strength in (("B2", "0.9"), ("B3", "10")):
        told = [claims()[f"grid.pn.{level}.{family}.{strength}.D3"].value for level in LEVELS]
        assert np.argmin(told) == np.argmin(weakest.sel(family=family).values) == LEVELS.index("faint")
