from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from gaugeblock.validate import make_trials, run_validators, trials_tree
from gaugeblock.validate.designs.identifiability import capture_finding, shrink_finding
from gaugeblock.validate.designs.shrinkage import capture, effective_dimension, shrink, weighted_sd
from gaugeblock.validate.finding import NotChecked, finding_from
from gaugeblock.validate.joint.psis import pareto_khat

# theta ~ N(0, 1), x ~ N(theta, 1): the posterior's sd is 0.707 of the prior's.
EXACT = np.sqrt(0.5)


def run(trials, **groups):
    tree = trials_tree(trials, **groups) if groups else trials
    findings, missing = run_validators(tree, seed=0, select=["identifiability"])
    return {item.id: item for item in findings}, {item.id: item.why for item in missing}


def test_shrink_of_an_exact_posterior(gaussian_trials):
    """Four standard errors for each of two parameters: 1 seed in 8,000. No weights, no capture."""
    findings, missing = run(gaussian_trials(2000, 100, 2, seed=0, density=False))
    for name in ("p0", "p1"):
        found = findings[f"identifiability.shrink[{name}]"]
        assert abs(found.estimate[0] - EXACT) < 4 * found.standard_error[0]
        assert found.standard_error[0] == pytest.approx(EXACT / np.sqrt(2 * 2000), rel=0.1)
        np.testing.assert_allclose(found.influence.mean(axis=1), 0, atol=1e-12)
        assert (found.population, found.quantity) == ("trials", "")
    assert "lack log_q" in missing["identifiability.capture"]


def test_a_prior_without_a_density_is_named(gaussian_trials):
    """Also of what it captures: the trials say why its density is not in them."""
    lean = gaussian_trials(50, 20, 2, seed=0, density=False)
    _, missing = run(lean.assign_attrs(no_log_prior="it is a sample"))
    assert missing["identifiability.capture"] == "needs the log density of the prior: it is a sample"


def test_standard_error_of_shrink_is_its_scatter():
    """1,000 sets of 200 trials: ratio within 4 of its standard errors (2.2%) and 2% for finite samples."""
    rng = np.random.default_rng(1)
    found = [
        shrink_finding("a", np.exp(rng.normal(-1, 0.3, 200)), rng.standard_normal(200)) for _ in range(1000)
    ]
    scatter = np.std([item.estimate[0] for item in found])
    assert np.mean([item.standard_error[0] for item in found]) / scatter == pytest.approx(1, abs=0.11)


@pytest.mark.parametrize(("ratio", "expected"), [(1.0, 1.0), (1.2, None)])
def test_capture_of_exact_and_wide_estimators(gaussian_trials, ratio, expected):
    """Within 4 standard errors of (1 - ratio 0.707) / (1 - 0.707): 1 seed in 16,000 each."""
    main = gaussian_trials(2000, 20, 1, seed=2, density=False)
    importance = gaussian_trials(200, 400, 1, seed=3, ratio=ratio)
    findings, missing = run(main, importance=importance)
    assert not missing
    found = findings["identifiability.capture[p0]"]
    truth = (1 - ratio * EXACT) / (1 - EXACT) if expected is None else expected
    assert abs(found.estimate[0] - truth) < 4 * found.standard_error[0]
    assert found.standard_error[0] < 0.1
    assert (found.population, found.n_trials) == ("importance", 200)
    assert (found.details["exact_sd"] / found.details["prior_sd"]).values.mean() == pytest.approx(
        EXACT, abs=0.05
    )


def test_the_prior_captures_nothing():
    """Calibrated, and worth nothing: x tells theta to 0.2 of the prior, the estimator returns the prior."""
    rng = np.random.default_rng(4)
    theta = rng.normal(size=(300, 1))
    x = theta + 0.2 * rng.normal(size=(300, 1))
    draws = rng.normal(size=(300, 500, 1))
    log_prior = -0.5 * (draws[..., 0] ** 2)
    trials = make_trials(
        theta, draws, ["a"], x=x,
        log_q=log_prior, log_prior=log_prior, log_likelihood=-0.5 * ((x - draws[..., 0]) / 0.2) ** 2,
    )  # fmt: skip
    findings, _ = run(trials)
    assert abs(findings["identifiability.shrink[a]"].estimate[0] - 1) < 0.15
    found = findings["identifiability.capture[a]"]
    assert abs(found.estimate[0]) < 4 * found.standard_error[0]


def test_where_the_exact_posterior_is_the_prior_there_is_nothing_to_capture():
    rng = np.random.default_rng(5)
    width = np.full(200, 1.0)
    said = capture_finding("a", width, 0.999 * width, rng.normal(size=500))
    assert isinstance(said, NotChecked)
    assert "as wide as its prior" in said.why


def test_weights_that_cannot_be_relied_on_are_left_out(gaussian_trials):
    """A fifth as wide as the posterior: hardly any k-hat below 0.7."""
    narrow = gaussian_trials(60, 200, 1, seed=6, ratio=0.2)
    _, missing = run(gaussian_trials(60, 20, 1, seed=7), importance=narrow)
    assert "k-hat below 0.7" in missing["identifiability.capture"]
    good = gaussian_trials(60, 200, 1, seed=8)
    draws = good["draws"].values.copy()
    draws[0, 0, 0] = np.nan
    findings, _ = run(
        gaussian_trials(500, 20, 1, seed=7), importance=good.assign(draws=(good["draws"].dims, draws))
    )
    found = findings["identifiability.capture[p0]"]
    assert found.n_trials == 59
    assert found.population == "reliable importance weights"
    assert "59 of 60" in found.caveats[0]


def test_capture_is_the_same_in_any_blocks_and_from_the_first_trials_alone(gaussian_trials, monkeypatch):
    trials = gaussian_trials(300, 100, 2, seed=14)
    whole = run(trials)[0]["identifiability.capture[p1]"]
    monkeypatch.setattr("gaugeblock.validate.storage.VALUES", 200 * 7)
    pieces = run(trials)[0]["identifiability.capture[p1]"]
    np.testing.assert_array_equal(whole.influence, pieces.influence)
    monkeypatch.setattr("gaugeblock.validate.designs.identifiability.MOST_TRIALS", 50)
    first = run(trials)[0]["identifiability.capture[p1]"]
    assert first.n_trials <= 50
    assert first.population == "reliable importance weights"
    assert "of 50 trials" in first.caveats[0]


def test_a_parameter_that_never_varies_is_named(gaussian_trials):
    trials = gaussian_trials(50, 20, 2, seed=9, density=False)
    trials["theta_true"][:, 1] = 3.0
    findings, missing = run(trials)
    assert set(findings) == {"identifiability.shrink[p0]"}
    assert "same in every trial" in missing["identifiability.shrink[p1]"]


def test_too_few_trials(gaussian_trials):
    findings, missing = run(gaussian_trials(5, 20, 1, seed=10))
    assert not findings
    assert set(missing) == {"identifiability.shrink", "identifiability.capture"}


def test_circular_parameters_are_cut_open():
    """Posteriors of sd 0.3 around truths on a circle, many of them across its seam."""
    rng = np.random.default_rng(11)
    theta = rng.uniform(-np.pi, np.pi, (400, 1))
    centre = theta + 0.3 * rng.normal(size=(400, 1))
    draws = (centre[:, None] + 0.3 * rng.normal(size=(400, 200, 1)) + np.pi) % (2 * np.pi) - np.pi
    findings, _ = run(make_trials(theta, draws, ["angle"], circular=["angle"]))
    expected = 0.3 / (2 * np.pi / np.sqrt(12))
    assert findings["identifiability.shrink[angle]"].estimate[0] == pytest.approx(expected, rel=0.05)


def test_weighted_sd_is_that_of_repeated_draws():
    rng = np.random.default_rng(12)
    draws = rng.normal(size=(3, 40, 2))
    np.testing.assert_allclose(weighted_sd(draws, np.ones((3, 40))), weighted_sd(draws))
    zero = np.concatenate([np.ones((3, 40)), np.zeros((3, 7))], axis=1)
    padded = np.concatenate([draws, 99 * np.ones((3, 7, 2))], axis=1)
    np.testing.assert_allclose(weighted_sd(padded, zero), weighted_sd(draws))
    np.testing.assert_allclose(shrink(draws, [2.0, 4.0]), weighted_sd(draws) / [2.0, 4.0])


def test_capture_and_effective_dimension_of_known_cases():
    """Published: exact shrink 0.731 captured to 0.163 means a flow's shrink of 0.956."""
    assert capture(1 - 0.163 * (1 - 0.731), 0.731) == pytest.approx(0.163)
    assert effective_dimension(np.diag([1.0, 1.0, 0.0])) == pytest.approx(2.0)
    assert effective_dimension(np.stack([np.eye(2), np.diag([1.0, 1e-9])])) == pytest.approx([2.0, 1.0])


def test_findings_survive_storage(gaussian_trials):
    findings, _ = run(gaussian_trials(100, 100, 1, seed=13))
    for finding in findings.values():
        dataset = finding.to_dataset()
        assert isinstance(dataset, xr.Dataset)
        again = finding_from(dataset)
        np.testing.assert_array_equal(again.estimate, finding.estimate)


def test_standard_error_of_capture_is_its_scatter():
    """1,000 sets of 150 trials and 120 truths, so that prior and widths both tell; two-sided."""
    rng = np.random.default_rng(2)
    found = []
    for _ in range(1000):
        exact = np.exp(rng.normal(-1.2, 0.35, 150))
        made = capture_finding(
            "a", 1.1 * exact * np.exp(rng.normal(0, 0.2, 150)), exact, rng.normal(size=120)
        )
        found.append(made)
    scatter = np.std([item.estimate[0] for item in found])
    assert np.mean([item.standard_error[0] for item in found]) / scatter == pytest.approx(1, abs=0.11)


def test_influences_of_both_are_those_of_leaving_trials_out():
    """What a trial moves, by leaving it out: an oracle that shares nothing with the formula."""
    rng = np.random.default_rng(3)
    n = 400
    exact, truth = np.exp(rng.normal(-1, 0.3, n)), rng.normal(size=n)
    wide = exact * np.exp(rng.normal(0.1, 0.2, n))
    shrunk = shrink_finding("a", wide, truth)
    share = capture_finding("a", wide, exact, rng.normal(size=10**6))
    prior = float(share.details["prior_sd"])
    for trial in range(0, n, 40):
        kept = np.arange(n) != trial
        moved = wide[kept].mean() / truth[kept].std(ddof=1)
        assert (n - 1) * (shrunk.estimate[0] - moved) == pytest.approx(shrunk.influence[0, trial], abs=0.03)
        moved = (1 - wide[kept].mean() / prior) / (1 - exact[kept].mean() / prior)
        assert (n - 1) * (share.estimate[0] - moved) == pytest.approx(share.influence[0, trial], abs=0.03)


def test_both_findings_by_hand():
    rng = np.random.default_rng(21)
    wide, exact, truth = (
        np.exp(rng.normal(-1, 0.3, 40)),
        np.exp(rng.normal(-1.2, 0.3, 40)),
        rng.normal(size=40),
    )
    prior = truth.std(ddof=1)
    square = (truth - truth.mean()) ** 2 / truth.var()
    found = shrink_finding("a", wide, truth, trial=np.arange(40) + 7, caveats=("said",))
    ratio = wide / prior
    influence = ratio - ratio.mean() - 0.5 * ratio.mean() * (square - 1)
    np.testing.assert_allclose(found.influence[0], influence)
    assert found.estimate[0] == pytest.approx(ratio.mean())
    assert found.standard_error[0] == pytest.approx(influence.std(ddof=1) / np.sqrt(40))
    assert (found.components, found.caveats, found.n_trials) == (("a",), ("said",), 40)
    assert float(found.details["prior_sd"]) == prior
    np.testing.assert_array_equal(found.details["posterior_sd"], wide)
    assert found.details["trial"].values[0] == 7
    truths = rng.normal(size=90)
    prior, square = truths.std(ddof=1), (truths - truths.mean()) ** 2 / truths.var()
    share = capture_finding(
        "a", wide, exact, truths, trial=np.arange(40), population="some", caveats=("said",)
    )
    a, b = wide.mean() / prior, exact.mean() / prior
    value = (1 - a) / (1 - b)
    influence = (value * (exact / prior - b) - (wide / prior - a)) / (1 - b)
    moved = (a - value * b) / (1 - b) * 0.5 * square.std() / np.sqrt(90)
    assert share.estimate[0] == pytest.approx(value)
    np.testing.assert_allclose(share.influence[0], influence)
    assert share.standard_error[0] == pytest.approx(np.hypot(influence.std(ddof=1) / np.sqrt(40), moved))
    np.testing.assert_array_equal(share.details["exact_sd"], exact)
    np.testing.assert_array_equal(share.details["posterior_sd"], wide)
    assert (share.population, share.caveats) == ("some", ("said",))


@pytest.mark.parametrize(("errors", "enough"), [(2.9, False), (3.1, True)])
def test_a_constraint_must_be_three_of_its_errors(errors, enough):
    """Of widths that scatter and of a prior known from so many truths, both together."""
    rng = np.random.default_rng(22)
    truth, scatter = rng.normal(size=200), rng.normal(size=50)
    scatter = (scatter - scatter.mean()) / scatter.std(ddof=1)
    prior = truth.std(ddof=1)
    square = (truth - truth.mean()) ** 2 / truth.var()
    of_prior = 0.5 * square.std() / np.sqrt(200)
    # 1 - b = errors * hypot(0.1 / sqrt(50), b * of_prior), for b by bisection.
    low, high = 0.0, 1.0
    for _ in range(60):
        b = (low + high) / 2
        low, high = (b, high) if 1 - b > errors * np.hypot(0.1 / np.sqrt(50), b * of_prior) else (low, b)
    found = capture_finding("a", np.full(50, 0.5), prior * (b + 0.1 * scatter), truth)
    assert isinstance(found, NotChecked) != enough
    if not enough:
        assert f"(shrink {b:.3f} +- {np.hypot(0.1 / np.sqrt(50), b * of_prior):.3f})" in found.why


def test_weighted_widths_by_hand():
    rng = np.random.default_rng(23)
    draws, weight = rng.normal(size=(3, 6, 2)), rng.exponential(size=(3, 6))
    weight[2] = [0, 0, 7.0, 0, 0, 0]
    found = weighted_sd(draws, weight)
    for k, j in np.ndindex(2, 2):
        share = weight[k] / weight[k].sum()
        mean = share @ draws[k, :, j]
        variance = share @ (draws[k, :, j] - mean) ** 2 / (1 - share @ share)
        assert found[k, j] == pytest.approx(np.sqrt(variance))
    assert found[2].tolist() == [0.0, 0.0]
    matrix = np.array([[2.0, 1.0, 0.0], [1.0, 3.0, 0.5], [0.0, 0.5, 1.0]])
    values = np.linalg.eigvalsh(matrix)
    assert effective_dimension(matrix) == pytest.approx(values.sum() ** 2 / (values**2).sum())


def test_shares_are_of_the_trials_whose_weights_can_be_relied_on(gaussian_trials):
    """Widths of draws and of weighted draws, trial by trial; one with a likelihood that is no number."""
    trials = gaussian_trials(40, 200, 1, seed=24, ratio=1.2)
    likelihood = trials["log_likelihood"].values.copy()
    likelihood[11, 3] = np.nan
    trials = trials.assign(log_likelihood=(("trial", "draw"), likelihood)).assign_coords(
        trial=np.arange(40) + 5
    )
    findings, _ = run(trials)
    found = findings["identifiability.capture[p0]"]
    weight = np.exp(trials["log_likelihood"] + trials["log_prior"] - trials["log_q"]).values
    khat = pareto_khat(np.log(weight))
    kept = np.flatnonzero(khat < 0.7)
    assert 20 <= len(kept) < 40
    assert 11 not in kept
    draws = trials["draws"].values
    np.testing.assert_allclose(found.details["posterior_sd"], draws[kept, :, 0].std(axis=1, ddof=1))
    np.testing.assert_allclose(found.details["exact_sd"], weighted_sd(draws, weight)[kept, 0])
    assert found.details["trial"].values.tolist() == (kept + 5).tolist()
    assert found.population == "reliable importance weights"
    assert found.caveats == (f"on the {len(kept)} of 40 trials with k-hat below 0.7",)
