"""What draws tell of the gates' precision, against what is known of their shapes, and against audits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import integrate, stats
from tests.validate.planning.test_planner import POLICY, audit

from gaugeblock.core.errors import InputError
from gaugeblock.validate import Outcome, judge, make_trials
from gaugeblock.validate.planning import pilot
from gaugeblock.validate.planning.limit_process import normal_spread
from gaugeblock.validate.planning.pilot import spreads_of
from gaugeblock.validate.planning.planner import plan
from gaugeblock.validate.trials import trials_tree

LEVELS = np.array([0.5, 0.68, 0.9])


def told(pool, **given):
    """From exact truths and draws, which lie together."""
    return spreads_of(trials_tree(make_trials(pool[:, 0], pool[:, 1:])), **given)


def known(shape):
    """Standard errors of a symmetric density: of a slope of ranks, and of logs of quantiles."""
    reach = shape.ppf((1 + LEVELS) / 2)
    width = np.sqrt(LEVELS * (1 - LEVELS)) / (2 * shape.pdf(reach) * reach)
    squared, _ = integrate.quad(lambda v: shape.pdf(v) ** 2, -np.inf, np.inf)
    return np.array([np.sqrt(1 / 12) / squared / reach[1], *width])


@pytest.mark.parametrize("shape", [stats.norm, stats.cauchy, stats.t(3), stats.laplace, stats.uniform(-1, 2)])
def test_of_known_shapes(shape):
    """20,000 truths: a bias to 2%, widths to 7%, and 4% more for what 125 draws are blurred; three errors."""
    pool = shape.rvs(size=(2000, 251, 1), random_state=np.random.default_rng(1))
    ratio = told(pool)[0] / known(shape)
    assert abs(ratio[0] - 1) < 0.06
    assert (abs(ratio[1:] - 1.04) < 0.21).all()
    # Neither too small nor too large together.
    assert abs(ratio[1:].mean() - 1.04) < 0.12


def test_of_normal_posteriors_it_is_what_a_plan_takes():
    np.testing.assert_allclose(normal_spread(), known(stats.norm), rtol=1e-6)


def test_neither_units_nor_truths_nor_order_matter_and_each_parameter_is_told_apart():
    rng = np.random.default_rng(2)
    pool = np.stack([rng.normal(size=(60, 101)), rng.standard_cauchy((60, 101))], axis=-1)
    first = told(pool, seed=3)
    assert first.shape == (2, 4)
    assert first[1, 3] > 1.5 * first[0, 3]
    np.testing.assert_allclose(told(1e6 + 1e-3 * pool, seed=3), first, rtol=1e-4)
    pool[:, 0] = 77.0
    np.testing.assert_array_equal(told(pool, seed=3), first)
    assert not np.array_equal(told(pool, seed=4), first)


def test_discrete_draws():
    """Of three values widths are known for certain; of a value that is nearly always the same no shift is."""
    rng = np.random.default_rng(4)
    three, rare = rng.integers(0, 3, (100, 101, 1)), rng.random((100, 101, 1)) < 0.003
    assert (told(three.astype(float))[0] < 3).all()
    assert np.isinf(told(rare.astype(float))[0, 0])


@pytest.mark.parametrize(
    ("trials", "draws", "said"),
    [(19, 60, "19 trials of 60 draws say too little"), (30, 39, "30 trials of 39 draws say too little")],
)
def test_too_little(trials, draws, said):
    with pytest.raises(InputError, match=said):
        told(np.random.default_rng(5).normal(size=(trials, draws + 1, 1)))
    assert told(np.random.default_rng(5).normal(size=(20, 41, 1))).shape == (1, 4)


def test_draws_that_follow_each_other():
    pool = np.random.default_rng(6).normal(size=(50, 201, 1)).cumsum(axis=1)
    with pytest.raises(InputError, match="draws depend on their order: 200 are worth about"):
        told(pool)


def test_of_more_trials_than_truths_the_first_are_taken(monkeypatch):
    monkeypatch.setattr(pilot, "TRUTHS", 50)
    pool = np.random.default_rng(7).normal(size=(80, 101, 2))
    np.testing.assert_array_equal(told(pool), told(pool[:50]))
    assert not np.array_equal(told(pool[:40]), told(pool[:50]))


def test_as_many_truths_as_are_asked_for(monkeypatch):
    """More truths, less scatter: of 30 pilots each, by a third at least."""
    scatter = []
    for truths in (200, 5000):
        monkeypatch.setattr(pilot, "TRUTHS", truths)
        found = [told(np.random.default_rng([7, k]).normal(size=(100, 101, 1)))[0] for k in range(30)]
        scatter.append(np.std(found, axis=0))
    assert (scatter[1] < 0.67 * scatter[0]).all()


def test_the_promise_of_a_plan_for_heavy_tails_holds():
    """Cauchy posteriors at the number planned for them: they PASS, and at a third of it few do."""
    rng = np.random.default_rng(8)
    spreads = told(rng.standard_cauchy((400, 251, 1)))
    planned = plan(POLICY, params=1, draws=100, families=1, further=0, spreads=spreads)
    normal = plan(POLICY, params=1, draws=100, families=1, further=0)
    assert 3 < planned.trials / normal.trials < 8
    assert (planned.shape, normal.shape) == ("given", "normal")
    assert planned.pass_probability_exact >= 0.9

    def passed(trials, audits):
        made = (
            audit(np.random.default_rng([9, k]), trials, 100, 1, draw=np.random.Generator.standard_cauchy)
            for k in range(audits)
        )
        return sum(judge(found, [], POLICY, seed=k).outcome is Outcome.PASS for k, found in enumerate(made))

    assert passed(planned.trials, 20) >= stats.binom.ppf(1e-3, 20, 0.9)
    at_a_third = plan(
        POLICY, params=1, draws=100, families=1, further=0, spreads=spreads, trials=planned.trials // 3
    )
    assert passed(at_a_third.trials, 20) <= stats.binom.ppf(0.999, 20, at_a_third.pass_probability_exact) < 15


def test_what_no_number_of_trials_settles_is_said():
    with pytest.raises(InputError, match="no number of trials settles the bias of posteriors like these"):
        plan(POLICY, params=1, spreads=[[np.inf, 1, 1, 1]])
    made = plan(POLICY, params=1, spreads=[[np.inf, 1, 1, 1]], trials=1000)
    assert made.pass_probability_exact == 0
    assert made.to_json()["smallest_detectable"]["bias"] is None
    assert made.to_json()["smallest_detectable"]["log_width"] > 0.1
