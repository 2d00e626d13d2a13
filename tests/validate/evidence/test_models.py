"""Posterior model probabilities: reliability under a gate, log score, and the best exponent."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import optimize, special, stats

from gaugeblock.core.errors import InputError
from gaugeblock.validate import judge, make_trials, run_validators
from gaugeblock.validate.evidence.models import (
    bins,
    check_index,
    check_names,
    check_probabilities,
    exponent,
    exponent_finding,
    reliability_finding,
    score_finding,
)
from gaugeblock.validate.marginal.coverage import STEADYING
from gaugeblock.validate.policy import read_policy

ALONE = read_policy("default").model_copy(update={"required": ("models",)})


def exact(n, models, rng, *, spread=1.5):
    """Probabilities ``(n, models)`` and the models that they are true of."""
    probability = special.softmax(spread * rng.normal(size=(n, models)), axis=1)
    return probability, (rng.random((n, 1)) > np.cumsum(probability, axis=1)[:, :-1]).sum(axis=1)


def tempered(probability, temperature):
    return special.softmax(np.log(probability) / temperature, axis=1)


def judged(probability, true, *, seed=0):
    names = [f"m{index}" for index in range(probability.shape[1])]
    found = [
        reliability_finding(each, true == index, name=name, id=f"models.reliability[{name}]")
        for index, (name, each) in enumerate(zip(names, probability.T, strict=True))
    ]
    return judge(found, [], ALONE, seed=seed).outcome


@pytest.mark.parametrize("number", [1, 3, 5])
def test_bins_hold_equal_numbers_and_equal_values_stay_together(number):
    rng = np.random.default_rng(1)
    found = bins(rng.random(1000), number)
    assert np.ptp(np.bincount(found)) <= number
    assert len(np.bincount(found)) == number
    piled = np.concatenate([np.zeros(590), rng.random(410)])
    label = bins(piled, 5)
    assert np.bincount(label).tolist() == [590, 200, 210]
    assert bins(np.ones(50), 5).tolist() == [0] * 50
    order = np.argsort(piled)
    assert (np.diff(label[order]) >= 0).all()


def test_a_gap_is_how_often_it_was_true_less_what_was_stated():
    stated = np.repeat([0.1, 0.6, 0.9], [40, 40, 40])
    true = np.concatenate([np.arange(40) < 4, np.arange(40) < 30, np.arange(40) < 20])
    found = reliability_finding(stated, true, name="m", id="models.reliability[m]")
    np.testing.assert_allclose(found.estimate, [0.0, 0.15, -0.4], atol=1e-12)
    np.testing.assert_allclose(found.details["happened"], [0.1, 0.75, 0.5])
    np.testing.assert_allclose(found.details["stated"], [0.1, 0.6, 0.9])
    assert found.details["number"].values.tolist() == [40, 40, 40]
    assert found.components == ("m @ 0.1 to 0.1", "m @ 0.6 to 0.6", "m @ 0.9 to 0.9")
    np.testing.assert_allclose(found.influence.mean(axis=1), 0, atol=1e-12)
    # What a trial adds to the gap of its bin, in units of the whole: the scatter is the error, unsteadied.
    share = np.array([4, 30, 20]) / 40
    scatter = np.sqrt((found.influence**2).mean(axis=1) / 120)
    np.testing.assert_allclose(scatter, np.sqrt(share * (1 - share) / 40))


def test_the_stated_errors_are_the_scatter():
    """200 exact audits of three models: errors within 12% of the scatter, each known to 5%."""
    rng = np.random.default_rng(2)
    found = [
        reliability_finding(p[:, 0], m == 0, name="m", id="m")
        for p, m in (exact(600, 3, rng) for _ in range(200))
    ]
    estimate, error = (np.array([getattr(f, name) for f in found]) for name in ("estimate", "standard_error"))
    assert (np.abs(estimate.mean(axis=0)) < 4 * estimate.std(axis=0) / np.sqrt(200)).all()
    ratio = error.mean(axis=0) / estimate.std(axis=0)
    assert (ratio > 0.85).all()
    # Bins where it is hardly ever true are steadied, and the outermost ones are wide.
    assert (ratio < [3.0, 1.3, 1.2, 1.2, 1.3]).all()


@pytest.mark.usefixtures("quick_judging")
def test_exact_probabilities_do_not_fail():
    """100 audits of 500 trials: FAIL in no more than 5%, to the 0.999 binomial quantile."""
    rng = np.random.default_rng(3)
    failed = sum(judged(*exact(500, 3, rng), seed=seed) == "FAIL" for seed in range(100))
    assert failed <= stats.binom.ppf(0.999, 100, 0.05)


@pytest.mark.usefixtures("quick_judging")
def test_on_the_edge_of_the_tolerance_neither_verdict_comes_often():
    """One of two models is true 0.05 more often than stated, whatever is stated: 5% of 120 audits each."""
    rng = np.random.default_rng(4)
    said = []
    for seed in range(120):
        stated = rng.uniform(0.1, 0.85, 1500)
        true = (rng.random(1500) >= stated + 0.05).astype(int)
        said.append(str(judged(np.stack([stated, 1 - stated], axis=1), true, seed=seed)))
    most = stats.binom.ppf(0.999, 120, 0.05)
    assert said.count("FAIL") <= most
    assert said.count("PASS") <= most


def test_the_gate_passes_what_is_right_and_fails_what_is_too_flat_or_too_sharp():
    """10,000 trials: 20 of 20 right verdicts of each."""
    rng = np.random.default_rng(5)
    for seed in range(20):
        probability, true = exact(10_000, 2, rng, spread=0.8)
        assert judged(probability, true, seed=seed) == "PASS"
        assert judged(tempered(probability, 2.0), true, seed=seed) == "FAIL"
        assert judged(tempered(probability, 0.5), true, seed=seed) == "FAIL"


@pytest.mark.parametrize("temperature", [0.5, 1.0, 2.0])
def test_the_exponent_is_the_temperature(temperature):
    """Of 100 audits: unbiased, with the errors that are stated, and at 1 with a p-value that is uniform."""
    rng = np.random.default_rng(6)
    made = [exact(500, 3, rng) for _ in range(100)]
    found = [exponent_finding(tempered(p, temperature), m) for p, m in made]
    estimate = np.array([f.estimate[0] for f in found])
    error = np.array([f.standard_error[0] for f in found])
    assert abs(estimate.mean() - np.log(temperature)) < 4 * estimate.std() / 10
    assert 0.75 < error.mean() / estimate.std() < 1.3
    rejected = sum(f.p_value < 0.05 for f in found)
    assert rejected <= stats.binom.ppf(0.999, 100, 0.05) if temperature == 1 else rejected == 100
    np.testing.assert_allclose(found[0].influence.std() / np.sqrt(500), error[0])


def test_the_exponent_has_the_best_log_score():
    probability, true = exact(400, 4, np.random.default_rng(7))

    def score(power):
        return np.log(special.softmax(power * np.log(probability), axis=1))[np.arange(400), true].mean()

    power, _ = exponent(probability, true)
    assert score(power) > max(score(0.999 * power), score(1.001 * power))
    certain = np.eye(2)[true % 2] * 0.98 + 0.01
    assert exponent(certain, true % 2)[0] > 5


def test_the_score_is_against_the_shares_of_the_truths():
    probability = np.array([[0.5, 0.5], [0.8, 0.2], [0.4, 0.6], [1.0, 0.0]])
    true = np.array([0, 0, 1, 1])
    found = score_finding(probability, true)
    assert found.estimate[0] == pytest.approx(np.mean(np.log([0.5, 0.8, 0.6, 1e-12]) - np.log(0.5)))
    assert found.standard_error[0] == pytest.approx(found.influence.std() / 2)
    assert found.caveats[0].startswith("1 of 4 trials")
    assert score_finding(probability[:3], true[:3]).caveats == ()


def trials_of(probability, true):
    trials = make_trials(true[:, None].astype(float), np.zeros((len(true), 3, 1)), ["model"])
    return trials.assign(model_probability=(("trial", "model"), probability))


def test_the_validator_says_it_of_trials_with_finite_draws():
    probability, true = exact(60, 3, np.random.default_rng(8))
    trials = trials_of(probability, true).load()
    trials["draws"][7] = np.nan
    found, missing = run_validators(trials, seed=0, select=["models"])
    ids = [f"models.reliability[model_{k}]" for k in (1, 2, 3)]
    assert [f.id for f in found] == [*ids, "models.confidence", "models.score", "models.exponent"]
    assert not missing
    assert {f.n_trials for f in found} == {59}
    kept = np.arange(60) != 7
    right = probability.argmax(axis=1) == true
    np.testing.assert_allclose(found[3].details["happened"] @ found[3].details["number"], right[kept].sum())
    assert found[3].components[-1].endswith(f"to {probability[kept].max():.3g}")
    few, missing = run_validators(
        trials_of(probability, true).isel(trial=slice(10)), seed=0, select=["models"]
    )
    assert (few, {item.why for item in missing}) == (
        (),
        {"10 trials with finite probabilities; 20 are needed"},
    )
    _, missing = run_validators(trials.drop_vars("model_probability"), seed=0, select=["models"])
    assert {item.id for item in missing} == {
        "models.reliability",
        "models.confidence",
        "models.score",
        "models.exponent",
    }


def test_what_are_no_probabilities_is_refused():
    with pytest.raises(InputError, match=r"trial 1 are \[2. 1.\]; .* take the softmax"):
        check_probabilities(np.array([[0.5, 0.5], [2.0, 1.0]]))
    with pytest.raises(InputError, match="trial 0"):
        check_probabilities(np.array([[-0.1, 1.1]]))
    with pytest.raises(InputError, match="two models or more"):
        check_probabilities(np.ones((3, 1)))
    rounded = check_probabilities(np.array([[0.3333, 0.6664], [np.nan, 0.5]]))
    assert rounded[0].sum() == pytest.approx(1, abs=1e-15)
    assert np.isnan(rounded[1, 0])
    for truths in ([0.5], [2.0], [[0.0, 1.0]]):
        with pytest.raises(InputError, match="whole number from 0 to 1"):
            check_index(truths, 2)
    assert check_names(None, 2) == ["model_1", "model_2"]
    for names in (["a"], ["a", "a"]):
        with pytest.raises(InputError, match="2 models need as many names"):
            check_names(names, 2)


def test_bins_of_a_few_by_hand():
    """A bin closes when it holds its share; what is left over joins the last if it is less than half."""
    assert bins([0.1, 0.2, 0.3, 0.4], 2).tolist() == [0, 0, 1, 1]
    assert bins([0.4, 0.1, 0.3, 0.2], 2).tolist() == [1, 0, 1, 0]
    assert bins([0.1, 0.1, 0.1, 0.2, 0.3, 0.3, 0.4], 2).tolist() == [0, 0, 0, 0, 1, 1, 1]
    # Shares of 2.5: three and three and one, and one is less than half of it.
    assert (
        bins([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95], 4).tolist() == [0] * 3 + [1] * 3 + [2] * 4
    )
    assert bins([0.1] * 3 + [0.2] * 3 + [0.3] * 2, 4).tolist() == [0] * 3 + [1] * 3 + [2] * 2
    assert bins([0.1, 0.1, 0.9], 1).tolist() == [0, 0, 0]


def test_reliability_of_a_few_trials_is_in_fewer_bins():
    """At least twenty trials a bin, five bins at most; influences and errors of each by hand."""
    rng = np.random.default_rng(9)
    for n, number in ((20, 1), (39, 1), (40, 2), (99, 4), (100, 5), (300, 5)):
        stated, true = rng.random(n), rng.random(n) < 0.5
        found = reliability_finding(stated, true, name="m", id="m")
        assert len(found.estimate) == number
        label = bins(stated, number)
        for k in range(number):
            here = label == k
            gap = (true - stated)[here].mean()
            assert found.estimate[k] == pytest.approx(gap)
            np.testing.assert_allclose(found.influence[k], here * (true - stated - gap) * n / here.sum())
            steadied = (true[here].sum() + STEADYING) / (here.sum() + 2 * STEADYING)
            assert found.standard_error[k] == pytest.approx(np.sqrt(steadied * (1 - steadied) / here.sum()))


def test_the_exponent_and_its_influences_by_hand():
    """Where the slope of the log score is 0, by bisection; the curvature is the variance of the logs."""
    probability, true = exact(60, 3, np.random.default_rng(10))
    logs = np.log(probability)

    def slope(power):
        weight = special.softmax(power * logs, axis=1)
        return logs[np.arange(60), true] - (weight * logs).sum(axis=1)

    power, influence = exponent(probability, true)
    assert power == pytest.approx(optimize.brentq(lambda at: slope(at).mean(), 0.01, 20), rel=1e-8)
    weight = special.softmax(power * logs, axis=1)
    curvature = ((weight * logs**2).sum(axis=1) - (weight * logs).sum(axis=1) ** 2).mean()
    np.testing.assert_allclose(influence, slope(power) / curvature, atol=1e-8)
    found = exponent_finding(probability, true)
    assert found.estimate[0] == pytest.approx(np.log(power))
    error = influence.std() / np.sqrt(60)
    assert found.standard_error[0] == pytest.approx(error / power)
    np.testing.assert_allclose(found.influence[0], influence / power)
    assert found.p_value == pytest.approx(2 * stats.norm.sf(abs(power - 1) / error))
    assert found.n_trials == 60
    flat = exponent_finding(np.full((30, 2), 0.5), np.arange(30) % 2)
    assert flat.estimate[0] == 0.0
    sharp = exponent_finding(np.tile([0.99, 0.01], (30, 1)), np.zeros(30, dtype=int))
    assert sharp.estimate[0] > 2


def test_scores_and_checks_of_a_few():
    probability, true = exact(25, 3, np.random.default_rng(11))
    found = score_finding(probability, true)
    share = np.bincount(true, minlength=3) / 25
    gain = [np.log(p[m] / share[m]) for p, m in zip(probability, true, strict=True)]
    assert found.estimate[0] == pytest.approx(np.mean(gain))
    np.testing.assert_allclose(found.influence[0], np.array(gain) - np.mean(gain))
    assert found.standard_error[0] == pytest.approx(np.std(gain) / 5)
    rough = np.array([[0.501, 0.5], [0.4, 0.6015]])
    np.testing.assert_allclose(check_probabilities(rough), rough / rough.sum(axis=1, keepdims=True))
    with pytest.raises(InputError, match="trial 1 are"):
        check_probabilities(np.array([[0.5, 0.5], [0.4, 0.603]]))
    assert check_index([[1.0], [0.0], [2.0]], 3).tolist() == [1, 0, 2]
    assert check_names(["b", 7], 2) == ["b", "7"]
