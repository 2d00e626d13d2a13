"""Every experiment runs as its twin does, yet smaller, resumes bit for bit, and measures its claims."""

import json
from dataclasses import replace

import numpy as np
import pytest
from studies.kit.results import read, write
from studies.paper import Agreement, Setting, claims, judge
from studies.paper.detection_claims import cells
from studies.paper.experiment import committed, made, trained_since
from studies.paper.experiments import EXPERIMENTS, PAST, load
from studies.paper.numbers import alone, by_claim

GRID = {"clean": 8, "suspicious": 8, "reference": 16, "draws": 20, "again": 2}
PAIRS = {"pairs": 6, "draws": 30, "exact": 2, "curve": 6}
RANKS = {"ranks": 20, "coverage": 20, "draws": 50}
HALVES = {"calibration": 40, "test": 40, "draws": 50}
SMALL = {
    "information": {"spectra": 20, "invariance": 8},
    "posteriors": {"line": 3, "draws": 100},
    "line_bias": {"line": 10, "draws": 20},
    "evidence": {"draws": 100},
    "nested": {"live": 40},
    # Of the same sizes, so that each response is compiled once for both.
    "detection": GRID,
    "detection_nicer": GRID,
    "detection_ours": GRID,
    "importance": {"clean": 4, "suspicious": 4, "draws": 60, "few": 40, "others": 2},
    "calibration_published": {"ranks": 20, "coverage": 20, "recovery": 10, "draws": 50},
    "calibration_retrained": {"ranks": 20, "coverage": 20, "spot": 4, "draws": 50},
    "calibration_nicer": RANKS,
    "calibration_ours": RANKS,
    "conformal": HALVES,
    "conformal_ours": HALVES,
    "gain_marginalised": PAIRS,
    "gain_ours": PAIRS,
    "cross_check": {
        **{"pool": 20, "screen": 50, "draws": 500, "proposals": 500},
        **{"warmup": 10, "chain": 20, "told": 20},
    },
    "residuals": {"runs": {"clean faint": 0, "clean medium": 1, "B1 medium": 0}, "spectra": 3},
    "evidence_pairs": {"pairs": 8, "draws": 50},
    "learning_curve": {"spectra": [400, 600], "cap": 1, "test": 20, "draws": 10},
    "go_no_go": {"trials": 60, "draws": 40},
    "outputs": {"ranks": 20, "draws": 20, "refined": 8, "weighted": 50, "recovery": 10, "line": 8},
}
"""Sizes in place of a twin's: about as few as leave every claim measured."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pieces")


@pytest.fixture(scope="module", params=(*EXPERIMENTS, *PAST))
def twin(request, folder):
    experiment = load(request.param)
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "cross_check":
            # Few live points need few proposals at a time, and short chains no short steps.
            patch.setattr("studies.paper.experiments.cross_posteriors.BATCH", 128)
            patch.setattr("studies.paper.experiments.cross_posteriors.ACCEPTED", 0.8)
        yield _twin(request, experiment, folder)


def _twin(request, experiment, folder):
    sizes = experiment.sizes[Setting.TWIN]
    small = sizes | SMALL.get(request.param, {})
    assert set(small) == set(sizes)
    # That several trainings are put together, experiments of claims and test_retrained.py see.
    trainings = experiment.trainings[: 1 if request.param in PAST else None]
    experiment = replace(experiment, sizes={Setting.TWIN: small}, trainings=trainings)
    if experiment.extra == "xray":
        request.getfixturevalue("xray_data")
    return experiment, made(experiment, Setting.TWIN, folder, seed=11)


DIFFERING = {
    *("pair.counts", "tb.ratio", "sub.scaling"),
    "grid.pn.medium.B1.5e-06.D3",
}
"""Of what is committed; three are the study's own numbers, to more digits than it prints."""


def mine(experiment):
    return {name: claim for name, claim in claims().items() if claim.by == experiment.name}


def test_its_table_says_by_which_weights_it_was_made(twin):
    experiment, table = twin
    weights = json.loads(table.attrs["flows"])
    assert set(weights) == set(experiment.flows)
    assert all(len(digest) == 64 for digest in weights.values())
    assert trained_since(table) == []


def test_every_training_gives_numbers_of_its_own(twin):
    experiment, table = twin
    if len(experiment.trainings) > 1:
        assert table.sizes["training"] == 2
        assert (np.ptp(table["trained"].values, axis=0) > 0).sum() > 0.3 * table.sizes["row"]


def test_cells_of_a_grid_are_means_over_sets_where_spectra_are_not_the_studys(twin):
    experiment, table = twin
    response = {"detection": "epic-pn", "detection_nicer": "nicer"}.get(experiment.name)
    if response:
        here, numbers = table.sel(response=response), by_claim(alone(table))
        for claim, place in cells(response):
            if claim in numbers:
                many = not claims()[claim].paired and not claim.endswith(".D1")
                expected = here["again" if many else "auc"].values[place]
                assert numbers[claim]["value"] == pytest.approx(expected, abs=1e-12), claim


def test_of_every_training_stands_beside_it_what_is_its(twin):
    """The line on EPIC-pn by the training of the same name; shrinks by the study's network, not by ours."""
    experiment, table = twin
    if experiment.name == "detection_nicer":
        beside = table["trained"].values[:, table["part"].values == "EPIC-pn"]
        assert beside.shape == (2, 3)
        assert (np.ptp(beside, axis=0) > 0).all()
    if experiment.name == "cross_check":
        assert (np.abs(table["study"] / table["flow"] - 1.0) > 1e-3).mean() > 0.5
        kept = by_claim(alone(table))["xc.bright.capture"]["first"]
        bright = np.flatnonzero(table["level"].values.astype(str) == "bright")[0]
        exact = table["exact_reference"].values[bright]
        assert kept == pytest.approx((1 - table["study"].values[bright]) / (1 - exact))


def test_it_measures_the_claims_that_are_its_and_no_others(twin):
    experiment, table = twin
    assert set(experiment.measured(table)) == set(mine(experiment))


def test_every_claim_is_measured(twin):
    experiment, table = twin
    found = experiment.measured(table)
    judged = [judge(claim, found[name]) for name, claim in mine(experiment).items()]
    assert not [item for item in judged if item.verdict is Agreement.PENDING]


def test_a_run_that_finds_its_pieces_gives_the_same_bits(twin, folder):
    experiment, table = twin
    again = made(experiment, Setting.TWIN, folder, seed=11)
    assert again.drop_attrs().identical(table.drop_attrs())


def test_a_table_survives_its_file_and_says_how_it_was_made(twin, tmp_path):
    experiment, table = twin
    write({"": table}, tmp_path / "a.nc")
    stored = read(tmp_path / "a.nc")
    for name, values in table.data_vars.items():
        np.testing.assert_array_equal(stored[name].values, values.values)
    assert (stored.attrs["experiment"], stored.attrs["setting"]) == (experiment.name, "twin")
    assert stored.attrs["command"] == f"python -m studies.paper {experiment.name} --twin --seed 11"
    assert "numpy" in stored.attrs["versions"]


@pytest.mark.parametrize("name", [*EXPERIMENTS, *PAST])
def test_what_is_committed_is_a_full_run_that_still_says_what_it_said(name):
    table, experiment = committed(name), load(name)
    if table is None:
        pytest.skip(f"{name} has no committed result yet")
    assert (table.attrs["setting"], table.attrs["version"]) == ("full", experiment.version)
    found = experiment.measured(table)
    for key, claim in mine(experiment).items():
        differs = judge(claim, found[key]).verdict is Agreement.DIFFERS
        assert differs == (key in DIFFERING), key


@pytest.fixture(scope="module")
def published():
    """What `published` finds, and itself."""
    experiment = load("published")
    return experiment, experiment.measured(experiment.run({}, None, 1))


def test_exact_and_arithmetic_claims_agree_but_three(published):
    experiment, found = published
    verdicts = {name: judge(claim, found[name]).verdict for name, claim in mine(experiment).items()}
    assert len(verdicts) == 42
    assert set(verdicts.values()) == {Agreement.AGREES, Agreement.DIFFERS}
    differing = {name for name, verdict in verdicts.items() if verdict is Agreement.DIFFERS}
    assert differing == {"pair.counts", "tb.ratio", "sub.scaling"}


def test_the_published_intervals_and_p_values_come_out_too(published):
    """Beside the claims themselves; bootstrap and permutation errors are far below these tolerances."""
    found = {name: item.parts for name, item in published[1].items()}
    assert found["pair.mean"]["error"] == pytest.approx(1.37, abs=0.005)
    assert found["pair.mean"]["p"] == pytest.approx(0.812, abs=0.0005)
    assert found["pair.reg.slope"]["error"] == pytest.approx(24.2, abs=0.05)
    assert found["pair.reg.slope"]["p"] == pytest.approx(0.0021, abs=0.002)
    assert found["pair.reg.intercept"]["error"] == pytest.approx(0.87, abs=0.005)
    for name, low, high in (("B1.medium", -90, -44), ("B1.bright", -1166, -562), ("B4.medium", 3, 26)):
        part = found[f"ns.cc.{name}"]
        assert part["low"] == pytest.approx(low, abs=0.06 * (high - low))
        assert part["high"] == pytest.approx(high, abs=0.06 * (high - low))
