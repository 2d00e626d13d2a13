"""The detection grid: its populations, what is said of it, and the errors of what is said."""

import numpy as np
import pytest
from scipy import stats
from studies.paper import claims
from studies.paper.auc_error import auc_error
from studies.paper.detection_claims import (
    LINE_ON_EPIC_PN,
    cells,
    estimates,
    of_more_spectra,
    on_epic_pn,
    on_nicer,
)
from studies.paper.detection_grid import CELL, SHARES, Grid, as_dataset, roc
from studies.paper.experiment import committed
from studies.paper.experiments import load
from studies.paper.grid_populations import cell_counts, cell_seed, clean_counts
from studies.paper.numbers import by_claim
from studies.paper.paper_flow import VARIANTS
from studies.paper.rows import published_rows
from studies.paper.trainings import by_training

SHAPE = (3, 4, 4, 3)


def mine(name):
    return {key for key, claim in claims().items() if claim.by == name}


def published(response):
    pytest.importorskip("jaxspec")
    from studies.paper.detection_figures import published_aucs

    return published_aucs(response)


def test_every_claim_about_a_grid_is_read_off_it():
    auc = published("epic-pn")
    assert set(on_epic_pn(auc)) == mine("detection")
    assert set(on_nicer(published("nicer"))) == mine("detection_nicer")
    assert len({place for _, place in cells("epic-pn")}) == 144


def test_the_published_cells_give_the_published_claims():
    """So what is read off a grid is what the study read off its own."""
    found = on_epic_pn(published("epic-pn"))
    for name in mine("detection"):
        claim = claims()[name]
        for part, value in claim.parts.items():
            assert found[name][part] == pytest.approx(value, abs=0.0051), (name, part)
        # One published cell of the gain lies 0.081 from 1/2 itself.
        if not name.startswith("grid."):
            assert all(rule.satisfied(claim.parts, found[name]) for rule in claim.rules), name
    auc = np.where(np.isnan(published("nicer")), 0.5, published("nicer"))
    nicer = on_nicer(auc)
    for name, same in LINE_ON_EPIC_PN.items():
        nicer[name]["EPIC-pn"] = found[same]["value"]
    for name in mine("detection_nicer"):
        claim = claims()[name]
        for part, value in claim.parts.items():
            assert nicer[name][part] == pytest.approx(value, abs=0.0051), (name, part)
        if not name.startswith("grid."):
            assert all(rule.satisfied(claim.parts, nicer[name]) for rule in claim.rules), name


def test_of_the_line_on_nicer_the_strongest_is_told_and_of_faint_spectra_the_best():
    auc = np.random.default_rng(13).random((5, *SHAPE))
    found = on_nicer(auc)
    faint, medium, bright = range(3)
    np.testing.assert_array_equal(found["det.nicer.B1.bright"]["value"], auc[:, bright, 0, 3, 0])
    np.testing.assert_array_equal(found["det.nicer.B1.medium"]["value"], auc[:, medium, 0, 3, 0])
    np.testing.assert_array_equal(
        found["det.nicer.B1.faint"]["value"], auc[:, faint, 0, :, :2].reshape(5, -1).max(axis=1)
    )
    np.testing.assert_array_equal(found["det.B4.nicer36"]["max"], auc[:, :, 3].reshape(5, -1).max(axis=1))


def test_the_studys_spectra_come_out_where_it_kept_its_seeds():
    """Its rows state the mean photon index of every cell of the line to three digits."""
    pytest.importorskip("jaxspec")
    from gaugeblock.simulators.xray import published as study

    rows = published_rows()
    levels, norms = rows["line_level"].values.astype(str), rows["line_norm"].values
    drawn = np.array([study.theta(100, cell_seed("B1", norm))[:, 1].mean() for norm in norms])
    same = np.abs(drawn - rows["line_alpha_truth"].values) < 6e-4
    kept = {(str(level), float(norm)) for level, norm in zip(levels[same], norms[same], strict=True)}
    assert kept == {("bright", norm) for norm in study.STRENGTHS["B1"]} | {("medium", 3e-4)}


def test_populations_are_poisson_about_their_means(xray_data):
    from gaugeblock.simulators.xray import family, published, reference

    simulator = reference(level="bright")
    theta = published.theta(50, 5)
    clean = clean_counts(simulator, 50, 5)
    lined = simulator.with_effect(family("B1", 3e-4))
    cell = cell_counts(lined, "B1", 3e-4, 50)
    for counts, expected in (
        (clean, simulator.expected(theta)),
        (cell, lined.expected(published.theta(50, cell_seed("B1", 3e-4)))),
    ):
        pulls = (counts - expected).sum() / np.sqrt(expected.sum())
        chi = ((counts - expected) ** 2 / expected)[expected > 20].mean()
        assert abs(pulls) < 3.5
        assert 0.9 < chi < 1.1
    np.testing.assert_array_equal(clean, clean_counts(simulator, 50, 5))


def grid(rng, shift, again_variance=0.0):
    """Normal scores: AUC of Phi(shift / sqrt 2), the same clean ones for every cell."""
    clean = np.broadcast_to(rng.normal(size=(3, 1, 1, 3, 200)), (*SHAPE, 200))
    suspicious = shift + rng.normal(size=(*SHAPE, 100))
    nothing, unused = np.zeros((3, 4, 2, 20)), np.zeros(SHAPE[:3])
    again = 0.76 + np.sqrt(again_variance) * rng.normal(size=(*SHAPE, 20))
    return Grid(
        clean=clean, suspicious=suspicious, again=again, nothing=nothing, accuracy=unused, largest=unused
    )


def test_curves_are_of_the_strongest_change_and_hold_its_area():
    """Of normal scores Phi(shift + z) at every share; in this cell alone they differ."""
    rng = np.random.default_rng(12)
    made = grid(rng, 0.0)
    made.suspicious[1, 2, 3, 0] += 1.5
    made.suspicious[1, 2, 2, 1] += 9.0
    curves = made.roc
    assert curves.shape == (3, 4, 3, len(SHARES))
    np.testing.assert_allclose(np.trapezoid(curves, SHARES, axis=-1), made.auc[:, :, 3], atol=0.006)
    wanted = stats.norm.sf(stats.norm.isf(SHARES) - 1.5)
    assert np.abs(curves[1, 2, 0] - wanted).max() < 0.15
    assert np.abs(curves[1, 2, 1] - SHARES).max() < 0.2
    assert (np.diff(curves) >= 0).all()
    assert (curves[..., -1] == 1).all()
    np.testing.assert_allclose(roc(np.zeros(7), np.zeros(9)), SHARES)
    replicates = made.replicates(rng, 3)
    table = as_dataset({"epic-pn": made}, {"epic-pn": replicates})
    np.testing.assert_allclose(table["replicates"].values[0], replicates, rtol=1e-6)
    here = table["roc"].sel(response="epic-pn", level="medium", family="B3", detector="D1")
    np.testing.assert_array_equal(here.values, curves[1, 2, 0])


def test_replicates_have_the_mean_and_the_error_of_an_auc():
    rng = np.random.default_rng(8)
    made = grid(rng, 1.0)
    replicates = made.replicates(rng, 200)
    assert replicates.shape == (200, *SHAPE)
    np.testing.assert_allclose(replicates.mean(axis=0), made.auc, atol=0.012)
    spread = replicates.std(axis=0, ddof=1).mean()
    assert spread == pytest.approx(auc_error(0.76, 200, 100), rel=0.15)


def test_training_again_widens_the_errors_of_d3_alone():
    narrow, wide = (
        grid(np.random.default_rng(8), 1.0, variance).replicates(np.random.default_rng(1), 200)
        for variance in (0.0, 0.08**2)
    )
    np.testing.assert_array_equal(narrow[..., :2], wide[..., :2])
    spread = wide[..., 2].std(axis=0, ddof=1)
    # As large over all cells together as over other draws of them.
    assert np.sqrt((spread**2).mean()) == pytest.approx(0.08, rel=0.05)
    np.testing.assert_allclose(wide[..., 2].mean(axis=0), narrow[..., 2].mean(axis=0), atol=0.02)


def test_replicates_keep_what_cells_share():
    rng = np.random.default_rng(9)
    replicates = grid(rng, 0.0).replicates(rng, 300)
    one = replicates[:, 0, 0, :, 0]  # four strengths of one detector share their clean spectra
    correlation = np.corrcoef(one.T)[np.triu_indices(4, 1)].mean()
    assert correlation == pytest.approx(1 / 3, abs=0.12)
    # So the mean of 36 has the error of nine independent ones with half the variance.
    _, spread = estimates(on_epic_pn(replicates[0]), on_epic_pn(replicates))["det.B4.pn36"]["mean"]
    assert spread == pytest.approx(0.0354 / 3 / np.sqrt(2), rel=0.2)


def test_ties_count_half():
    rng = np.random.default_rng(10)
    made = grid(rng, 0.0)
    tied = Grid(
        clean=np.zeros_like(made.clean),
        suspicious=np.zeros_like(made.suspicious),
        again=made.again,
        nothing=made.nothing,
        accuracy=made.accuracy,
        largest=made.largest,
    )
    np.testing.assert_allclose(tied.replicates(rng, 5), 0.5)
    np.testing.assert_allclose(tied.auc, 0.5)


def test_a_flow_that_gives_less_on_other_spectra_too_is_said_to():
    pytest.importorskip("jaxspec")
    from studies.paper.experiments.detection import measured

    table = committed("detection")
    again = published("epic-pn")[None].copy()
    again[..., 0] = np.nan
    again[0, 2, 0, 3, 1] -= 0.15  # D2 of the strongest line at bright
    table["again"] = (("response", *CELL), again)
    table["again_sd"] = (("response", *CELL), np.where(np.isnan(again), np.nan, 0.03))
    found = measured(table)
    told = {name for name, item in found.items() if "embedding" in item.because}
    assert told == {"grid.pn.bright.B1.0.0003.D2", "tab4.D2.B1.bright"}
    assert "0.660 ± 0.030" in found["tab4.D2.B1.bright"].because


def test_the_line_on_nicer_stands_beside_the_training_of_the_same_name_on_epic_pn():
    errors = {name: by_claim(committed(name), "standard_error") for name in ("detection", "detection_nicer")}
    for claim, same in LINE_ON_EPIC_PN.items():
        here, there = by_training(claims()[claim], "EPIC-pn"), by_training(claims()[same])
        names = [list(committed(name)["training"].values) for name in ("detection_nicer", "detection")]
        assert names[0] == ["first", "-seed101", "-seed202"]
        assert here.tolist() == [there[names[1].index(name)] for name in names[0]]
        assert errors["detection_nicer"][claim]["EPIC-pn"] == errors["detection"][same]["value"]
    # What the study's table has of the same on EPIC-pn.
    told = [claims()[same].value for same in LINE_ON_EPIC_PN.values()]
    assert told == pytest.approx([0.97, 0.97, 0.76], abs=0.0051)


def test_what_our_own_flows_give_stands_beside_every_cell():
    ours = by_claim(committed("detection_ours"))
    assert set(ours) == mine("detection") | mine("detection_nicer")
    for name in ("detection", "detection_nicer"):
        found = load(name).measured(committed(name))
        for claim in mine(name):
            part = "value" if "value" in ours[claim] else claims()[claim].needs[0]
            assert f"flows of our own give {'' if part == 'value' else part + ' '}" in found[claim].note
            assert f"{ours[claim][part]:.4g}" in found[claim].note.rpartition("give ")[2]


def test_cells_of_other_spectra_than_the_studys_are_means_over_many_sets():
    rng = np.random.default_rng(14)
    again = rng.random((*SHAPE, 20))
    again[..., 0, :] = np.nan
    for response, short, number in (("epic-pn", "pn", 38), ("nicer", "nicer", 78)):
        found = of_more_spectra(again, response)
        own = {name for name, claim in claims().items() if name.startswith(f"grid.{short}.") and claim.paired}
        assert set(found) == {
            name
            for name in claims()
            if name.startswith(f"grid.{short}.") and not name.endswith(".D1") and name not in own
        }
        assert len(found) == number
        for name, place in cells(response):
            if name in found:
                mean, error = found[name]["value"]
                assert mean == pytest.approx(again[place].sum() / 20)
                assert error == pytest.approx(np.sqrt(again[place].var() / 19))
    assert of_more_spectra(np.full((*SHAPE, 20), np.nan), "nicer") == {}


def test_networks_of_a_response_are_trained_on_it():
    names = {name: experiment.retrained for name in ("detection", "detection_nicer", "calibration_nicer")
             for experiment in (load(name),)}  # fmt: skip
    assert names["detection_nicer"] == names["calibration_nicer"]
    for name, response in (("detection", "epic-pn"), ("detection_nicer", "nicer")):
        variants = [VARIANTS[f"{flow}{end}"] for flow in names[name] for end in load(name).trainings]
        assert {variant.response for variant in variants} == {response}
        assert {variant.level for variant in variants} == {"faint", "medium", "bright"}
        assert not any(variant.gain for variant in variants)
