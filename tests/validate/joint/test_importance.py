from __future__ import annotations

import re

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import NotChecked, make_trials, trials_tree
from gaugeblock.validate.joint.importance import (
    acceptance,
    importance,
    importance_findings,
    kish_fraction,
    log_evidence,
    log_weights,
    summarise,
)
from gaugeblock.validate.joint.psis import pareto_khat, pareto_shape, tail_length
from gaugeblock.validate.prepared import Prepared


def test_weights_where_prior_or_likelihood_vanish_or_are_not_numbers():
    inf, nan = np.inf, np.nan
    weight = log_weights([0.0] * 6, [1.0, -inf, nan, nan, inf, 2.0], [1.0, 0.0, -inf, 0.0, 0.0, nan])
    np.testing.assert_array_equal(weight, [2.0, -inf, -inf, nan, nan, nan])


def test_kish_fraction_of_known_weights():
    weight = np.log([[1, 1, 1, 1], [1, 1, 0.5, 0.5]])
    np.testing.assert_allclose(kish_fraction(weight), [1.0, 9 / 2.5 / 4])
    np.testing.assert_allclose(kish_fraction(weight + 700), kish_fraction(weight))
    np.testing.assert_allclose(kish_fraction(weight - 700), kish_fraction(weight))


def test_rows_without_weight_or_with_nan_count_as_zero():
    rows = np.array([[-np.inf, -np.inf], [np.nan, 0.0], [0.0, -np.inf]])
    assert kish_fraction(rows).tolist() == [0.0, 0.0, 0.5]
    assert acceptance(rows).tolist() == [0.0, 0.0, 0.5]
    np.testing.assert_array_equal(np.isnan(log_evidence(rows)[0]), [True, True, False])
    np.testing.assert_array_equal(np.isinf(pareto_khat(np.repeat(rows, 20, axis=1)))[:2], True)


def test_kish_fraction_of_a_gaussian_that_is_too_wide():
    """q = N(0, s^2) for N(0, 1): (E w)^2 / E w^2 is sqrt(2 s^2 - 1) / s^2; median within 1%."""
    draws = 1.5 * np.random.default_rng(0).normal(size=(100, 20_000))
    weight = stats.norm.logpdf(draws) - stats.norm.logpdf(draws, scale=1.5)
    assert np.median(kish_fraction(weight)) == pytest.approx(np.sqrt(2 * 1.5**2 - 1) / 1.5**2, rel=0.01)


def test_log_evidence_and_its_error():
    """True value 2.5; the pulls of 500 rows have mean 0 and sd 1 (limits at 4 standard errors)."""
    draws = 1.5 * np.random.default_rng(1).normal(size=(500, 2000))
    weight = 2.5 + stats.norm.logpdf(draws) - stats.norm.logpdf(draws, scale=1.5)
    value, error = log_evidence(weight)
    pull = (value - 2.5) / error
    assert abs(pull.mean()) < 4 / np.sqrt(500)
    assert abs(pull.std() - 1) < 4 / np.sqrt(1000)


def test_equal_weights():
    weight = np.full((3, 500), -1234.5)
    assert kish_fraction(weight).tolist() == [1.0] * 3
    assert pareto_khat(weight).tolist() == [0.0] * 3
    np.testing.assert_allclose(log_evidence(weight), [[-1234.5] * 3, [0.0] * 3], atol=1e-10)


@pytest.mark.parametrize("draws", [100, 500, 1000])
def test_khat_agrees_with_arviz_stats(draws):
    base = pytest.importorskip("arviz_stats.base")
    rng = np.random.default_rng(draws)
    weight = rng.normal(size=(30, draws)) * rng.uniform(0.3, 4, size=(30, 1))
    theirs = [float(base.array_stats.psislw(-row)[1]) for row in weight]
    np.testing.assert_allclose(pareto_khat(weight), theirs, rtol=1e-6)


@pytest.mark.parametrize("shape", [-0.3, 0.2, 0.7, 1.2])
def test_pareto_shape_is_recovered(shape):
    """Mean over 100 fits of 2,000 exceedances: within 0.02 of the truth, pulled to 0.5 by the prior."""
    sample = stats.genpareto.rvs(shape, size=(100, 2000), random_state=np.random.default_rng(2))
    assert pareto_shape(sample).mean() == pytest.approx(shape, abs=0.02)


def test_khat_of_few_draws_or_few_weights_is_infinite():
    rng = np.random.default_rng(3)
    assert np.isinf(pareto_khat(rng.normal(size=(2, 20)))).all()
    few = np.full((1, 400), -np.inf)
    few[0, :8] = rng.normal(size=8)
    assert np.isinf(pareto_khat(few)).all()
    assert (tail_length(225), tail_length(400)) == (45, 60)


def test_tied_weights_do_not_break_the_fit():
    weight = np.where(np.random.default_rng(4).random((5, 500)) < 0.05, 2.0, 0.0)
    assert np.isfinite(pareto_khat(weight)).all()


def test_findings_name_population_and_sense():
    rng = np.random.default_rng(5)
    ess, khat, evidence = importance_findings(rng.normal(size=(50, 300)), population="importance")
    assert (ess.kind, ess.sense, ess.population) == ("quantile", "at-least", "importance")
    assert ess.details["ess"].shape == khat.details["khat"].shape == (50,)
    assert set(evidence.details) == {"log_evidence", "log_evidence_error", "acceptance"}


def weighed(*, offset=0.0, wider=1.0, trials=150):
    """Importance of draws of an exact Gaussian posterior, with a log q `offset` nat too high, or `wider`."""
    rng = np.random.default_rng(31)
    theta = rng.normal(size=(trials, 1))
    x = theta + rng.normal(size=(trials, 1))
    draws = x[:, None] / 2 + wider * np.sqrt(0.5) * rng.normal(size=(trials, 60, 1))
    log_q = stats.norm.logpdf(draws, x[:, None] / 2, np.sqrt(0.5))[..., 0] + offset
    likelihood = stats.norm.logpdf(x[:, None], draws)[..., 0]
    made = make_trials(
        theta, draws, ["a"], log_q=log_q, log_likelihood=likelihood,
        log_prior=stats.norm.logpdf(draws)[..., 0],
    )  # fmt: skip
    return importance(Prepared(trials_tree(made), 1))


def test_weights_that_draws_do_not_confirm_are_doubted():
    exact = weighed()
    assert [found.id for found in exact] == ["importance.ess", "importance.khat", "importance.evidence"]
    assert not any(isinstance(found, NotChecked) or found.doubt for found in exact)
    for made, why in (
        ({"offset": 1.0}, r"differ by -(0\.9|1\.0)"),
        ({"wider": 4.0}, r"nat lower at the draws"),
    ):
        ess, *others = weighed(**made)
        assert re.search(why, ess.doubt)
        assert [(item.id, type(item)) for item in others] == [
            (f"importance.{name}", NotChecked) for name in ("khat", "evidence")
        ]
        assert all(re.search(why, item.why) for item in others)


def test_the_error_of_a_share_of_trials_is_that_of_a_proportion_and_never_none():
    """Agresti and Coull's: two trials more of either kind."""
    rng = np.random.default_rng(7)
    heavy = rng.pareto(0.6, (30, 400))
    weight = np.log(np.concatenate([heavy, np.ones((20, 400))]))
    _, khat, _ = importance_findings(weight)
    above = np.count_nonzero(pareto_khat(weight) > 0.7)
    assert 20 < above <= 30
    assert khat.estimate[0] == above / 50
    share = (above + 2) / 54
    assert khat.standard_error[0] == pytest.approx(np.sqrt(share * (1 - share) / 50))
    np.testing.assert_allclose(khat.influence[0], (pareto_khat(weight) > 0.7) - above / 50)


def test_errors_of_an_evidence_by_hand():
    weight = np.array([0.5, 2.0, 1.0, 0.0, 3.5])
    with np.errstate(divide="ignore"):
        value, error = log_evidence(np.log(weight)[None] + 900)
    assert value[0] == pytest.approx(900 + np.log(1.4))
    assert error[0] == pytest.approx(weight.std(ddof=1) / np.sqrt(5) / 1.4)
    with np.errstate(divide="ignore"):
        assert acceptance(np.log(weight)[None])[0] == pytest.approx(1.4 / 3.5)


def test_findings_of_weights_some_of_which_could_not_be_computed():
    rng = np.random.default_rng(32)
    weight = rng.normal(size=(9, 40))
    weight[2, 5], weight[7] = np.nan, -np.inf
    number = np.arange(9)[::-1]
    ess, khat, evidence = importance_findings(weight, trial=number, caveats=("said",))
    summary = summarise(weight)
    assert summary.broken.tolist() == [k == 2 for k in range(9)]
    said = "in 1 trial(s) a weight could not be computed (NaN likelihood or prior); ESS counts as 0"
    for one in (ess, khat, evidence):
        assert (one.n_trials, one.caveats, one.population) == (9, ("said", said), "trials")
        assert one.details["trial"].values.tolist() == number.tolist()
    assert "fraction of 40 draws" in ess.claim
    assert ess.estimate[0] == np.sort(kish_fraction(weight))[4]
    assert ess.quantile.tolist() == evidence.quantile.tolist() == [0.5]
    np.testing.assert_array_equal(evidence.values[0], log_evidence(weight)[1])
    np.testing.assert_array_equal(evidence.details["log_evidence"], log_evidence(weight)[0])
    np.testing.assert_array_equal(evidence.details["log_evidence_error"], log_evidence(weight)[1])
    np.testing.assert_array_equal(evidence.details["acceptance"], acceptance(weight))
    np.testing.assert_array_equal(khat.details["khat"], pareto_khat(weight))
    assert (khat.quantity, khat.sense, evidence.quantity, evidence.sense) == ("", "at-most", "", "at-most")


def test_a_group_s_trials_are_summarised_some_at_a_time_without_those_that_are_broken(monkeypatch):
    """31 trials of 40 draws in blocks of ten: one is left over, one has a log q that is no number."""
    rng = np.random.default_rng(33)
    theta = rng.normal(size=(31, 1))
    draws = theta[:, None] + rng.normal(size=(31, 40, 1))
    log_q, likelihood, prior = rng.normal(size=(3, 31, 40))
    log_q[12, 3] = np.nan
    words = {"log_q": log_q, "log_likelihood": likelihood, "log_prior": prior}
    main = make_trials(theta, draws, ["a"])
    group = make_trials(theta, draws, ["a"], **words).assign_coords(trial=np.arange(31) + 100)
    monkeypatch.setattr("gaugeblock.validate.storage.VALUES", 16 * 40 * 10)
    kept = np.delete(np.arange(31), 12)
    for tree, population in ((trials_tree(main, group), "importance"), (trials_tree(group), "trials")):
        ess, *others = importance(Prepared(tree, 1))
        assert (ess.n_trials, ess.population) == (30, population)
        np.testing.assert_allclose(ess.values[0], kish_fraction(likelihood + prior - log_q)[kept])
        assert ess.details["trial"].values.tolist() == (kept + 100).tolist()
        assert ess.caveats == ("1 of 31 trials have NaN or infinite draws or log_q; left out here",)
        assert all(isinstance(item, NotChecked) for item in others) == bool(ess.doubt)
    lean = importance(Prepared(trials_tree(main.assign(log_q=group["log_q"].drop_vars("trial"))), 1))
    assert [item.id for item in lean] == ["importance.ess", "importance.khat", "importance.evidence"]
    assert {item.why.split("; ")[1] for item in lean} == {"the trials lack log_likelihood, log_prior"}
    told = importance(Prepared(trials_tree(main.assign_attrs(no_log_prior="it is a box")), 1))
    assert {item.why for item in told} == {"needs the log density of the prior: it is a box"}
    nothing = importance(Prepared(trials_tree(group.assign(log_q=group["log_q"] * np.nan)), 1))
    assert {item.why for item in nothing} == {"every trial has NaN or infinite draws or log_q"}
