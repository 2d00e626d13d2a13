"""arviz-plots since 1.0 (Python 3.12): ranks rescaled by the largest one seen, and exact ranks rejected."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy import stats

from gaugeblock import make_trials, to_arviz
from gaugeblock.validate.marginal.discrete_ranks import rank_ecdf_test
from gaugeblock.validate.marginal.uniformity import ecdf_test


@pytest.fixture(scope="module")
def their_plotted_p_value(peer):
    """The p-value that the plot writes, to two digits."""
    plots, base = peer("arviz_plots"), peer("arviz_base")

    def p_value(ranks):
        tree = base.from_dict({"prior_sbc": {"a": ranks[None].astype(float)}})
        text = plots.plot_ecdf_pit(tree, backend="none").viz["p_value_text"]["a"].item()["string"]
        return float(re.search(r"p=([\d.]+)", text).group(1))

    return p_value


@pytest.fixture(scope="module")
def their_p_value(peer):
    """Its default test, to all digits; on ranks as the plot rescales them."""
    peer("arviz_plots")
    test = peer("arviz_stats.base").array_stats.uniformity_test

    def p_value(values):
        largest = values.max()
        return float(test((values + 0.5) / (largest + 1) if largest > 1 else values)[0])

    return p_value


def our_p_value(ranks, draws, seed=0):
    return rank_ecdf_test(ranks, draws, np.random.default_rng(seed)).p_value


def lower_half(seed=0):
    """Ranks among 1,000 draws of 200 truths that all lie below the middle: a posterior far too high."""
    return np.random.default_rng(seed).integers(0, 501, 200)


def test_theirs_finds_ranks_in_the_lower_half_uniform(their_plotted_p_value):
    assert their_plotted_p_value(lower_half()) > 0.05


def test_ours_knows_how_many_draws_there_were():
    assert our_p_value(lower_half(), 1000) < 1e-12


def exact_ranks(seed):
    """Ranks of 4,000 truths among 100 draws of exact posteriors."""
    return np.random.default_rng(seed).integers(0, 101, 4000)


def test_theirs_rejects_exact_ranks(their_p_value, their_plotted_p_value):
    """Ranks are discrete and it takes them for continuous: 4,000 trials of 100 draws are always rejected."""
    assert max(their_p_value(exact_ranks(seed)) for seed in range(20)) < 0.01
    assert their_plotted_p_value(exact_ranks(0)) < 0.01


def test_ours_rejects_exact_ranks_as_often_as_it_says():
    """At most as many of 200 as a test of size 5% exceeds with probability 1e-3."""
    rejected = [our_p_value(exact_ranks(seed), 100, seed) <= 0.05 for seed in range(200)]
    assert sum(rejected) <= stats.binom.ppf(0.999, 200, 0.05)


@pytest.fixture(scope="module")
def uniform_samples():
    return np.random.default_rng(1000).random((4000, 1000))


def test_theirs_rejects_too_many_uniform_samples(their_p_value, uniform_samples):
    """Cauchy combination of dependent p-values: more of 4,000 than 5% exceeds with probability 1e-6."""
    rejected = sum(their_p_value(sample) <= 0.05 for sample in uniform_samples)
    assert rejected > stats.binom.ppf(1 - 1e-6, 4000, 0.05)


def test_ours_is_of_its_size_on_the_same_samples(uniform_samples):
    """Exceeded with probability 1e-3 by a test of size 5%."""
    rejected = sum(ecdf_test(sample).p_value <= 0.05 for sample in uniform_samples)
    assert rejected <= stats.binom.ppf(0.999, 4000, 0.05)


def test_arviz_plots_draws_our_trials_in_three_lines(peer):
    """The whole of them, and the posterior of one."""
    plots = peer("arviz_plots")
    rng = np.random.default_rng(3)
    theta = rng.normal(size=(300, 2))
    trials = make_trials(theta, theta[:, None] + rng.normal(size=(300, 60, 2)), ["a", "b"], x=theta)
    whole, one = to_arviz(trials), to_arviz(trials, trial=3)
    assert {"a", "b"} <= set(plots.plot_ecdf_pit(whole, backend="none").viz["p_value_text"].data_vars)
    assert plots.plot_ppc_pit(whole, backend="none").viz["ecdf_lines"]["a"].item() is not None
    for plot in (plots.plot_forest, plots.plot_pair):
        assert plot(one, backend="none").viz is not None
