"""What a block of trials holds, from simulators and estimators of a few lines."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from gaugeblock.auditing.samples import (
    Again,
    ImportanceTrials,
    JointTrials,
    MainTrials,
    Plan,
    checked,
    log_prior_and_likelihood,
    without_density,
)
from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import generator
from gaugeblock.simulators import Normal, Prior, Uniform

PLAN = Plan(
    number=20,
    draws=6,
    block=4,
    importance_number=9,
    importance_draws=5,
    joint_number=13,
    joint_draws=3,
    seed=7,
)
TRIALS = range(8, 12)
"""The third block."""


class Two:
    """Two readings around a mean and a positive width, in one shape or another."""

    prior = Prior({"mean": Normal(1.0, 2.0), "width": Uniform(0.5, 3.0)})
    circular = ("mean",)

    def simulate(self, theta: Any, rng: Any) -> Any:
        return rng.normal(theta[:, :1], theta[:, 1:], (len(theta), 2))

    def log_likelihood(self, theta: Any, x: Any) -> Any:
        assert np.isfinite(theta).all()
        assert (np.asarray(theta)[..., 1] > 0).all()
        return stats.norm(theta[..., :1], theta[..., 1:]).logpdf(x).sum(axis=-1)


class Plain:
    """Draws that do not look at the data, and what it was asked."""

    def __init__(self) -> None:
        self.asked: list[tuple[Any, int]] = []

    def sample(self, x: Any, n: int, rng: Any) -> Any:
        self.asked.append((np.array(x), n))
        return rng.random((len(x), n, 2)) + 1.0


class Dense(Plain):
    autocorrelated = True

    def log_prob(self, theta: Any, x: Any) -> Any:
        return np.asarray(theta).sum(axis=-1) + 10 * np.asarray(x)[:, :1]


class Evident(Plain):
    def sample_and_log_evidence(self, x: Any, n: int, rng: Any) -> Any:
        return self.sample(x, n, rng), np.arange(len(x)) + 0.5, np.full(len(x), 0.1)


class Exact(Two):
    def log_evidence(self, x: Any) -> Any:
        return np.asarray(x).sum(axis=1)


def rng(purpose: str) -> Any:
    return generator(7, f"audit {purpose}", 2)


THETA = Two.prior.sample(4, rng("truth"))
X = Two().simulate(THETA, rng("data"))
DRAWS = rng("draws").random((4, 6, 2)) + 1.0


def test_a_block_is_of_its_own_streams_and_all_of_it_is_kept() -> None:
    estimator = Plain()
    made = MainTrials(Two(), estimator, PLAN)(TRIALS)
    np.testing.assert_array_equal(made["theta_true"], THETA)
    np.testing.assert_array_equal(made["x"], X)
    np.testing.assert_array_equal(made["draws"], DRAWS)
    assert made["trial"].values.tolist() == [8, 9, 10, 11]
    assert made["parameter"].values.tolist() == ["mean", "width"]
    ((asked, n),) = estimator.asked
    np.testing.assert_array_equal(asked, X)
    assert n == 6
    assert not {"log_q", "log_q_true", "log_evidence", "log_likelihood", "no_log_prior"} & {
        *made,
        *made.attrs,
    }


def test_densities_stand_beside_their_draws() -> None:
    made = MainTrials(Two(), Dense(), PLAN)(TRIALS)
    np.testing.assert_allclose(made["log_q"], DRAWS.sum(axis=-1) + 10 * X[:, :1])
    np.testing.assert_allclose(made["log_q_true"], THETA.sum(axis=-1) + 10 * X[:, 0])
    plain = MainTrials(Two(), Plain(), PLAN)(TRIALS)
    markov = {name: (plain.attrs.get(name), made.attrs.get(name)) for name in {*plain.attrs, *made.attrs}}
    assert [name for name, (one, other) in markov.items() if one != other] == ["autocorrelated"]


def test_of_who_is_not_trusted_draws_alone_are_asked_for() -> None:
    estimator = Dense()
    estimator.untrusted = True  # type: ignore[attr-defined]
    made = MainTrials(Two(), estimator, PLAN)(TRIALS)
    assert not {"log_q", "log_q_true"} & set(made)
    assert sum(len(rows) for rows, _ in estimator.asked) == 4
    assert made["draws"].shape == (4, 6, 2)


def test_evidences_and_exact_ones_where_there_are_both() -> None:
    made = MainTrials(Exact(), Evident(), PLAN)(TRIALS)
    assert made["log_evidence"].values.tolist() == [0.5, 1.5, 2.5, 3.5]
    assert made["log_evidence_error"].values.tolist() == [0.1] * 4
    np.testing.assert_array_equal(made["log_evidence_true"], X.sum(axis=1))
    assert "log_evidence_true" not in MainTrials(Exact(), Plain(), PLAN)(TRIALS)
    assert "log_evidence_true" not in MainTrials(Two(), Evident(), PLAN)(TRIALS)


def test_further_draws_are_others_and_have_all_that_makes_their_weights() -> None:
    main = MainTrials(Two(), Dense(), PLAN)
    made = ImportanceTrials(Two(), Dense(), PLAN, main)(TRIALS)
    draws = rng("importance draws").random((4, 5, 2)) + 1.0
    np.testing.assert_array_equal(made["theta_true"], THETA)
    np.testing.assert_array_equal(made["draws"], draws)
    np.testing.assert_allclose(made["log_q"], draws.sum(axis=-1) + 10 * X[:, :1])
    np.testing.assert_allclose(made["log_prior"], Two.prior.log_prob(draws))
    np.testing.assert_allclose(made["log_likelihood"], Two().log_likelihood(draws, X[:, None]))
    assert set(ImportanceTrials(Two(), Plain(), PLAN, main)(TRIALS)) == {"theta_true", "draws"}
    assert isinstance(ImportanceTrials(Two(), Plain(), PLAN, main), Again)


def test_the_likelihood_is_that_of_the_truth_and_of_the_first_draws() -> None:
    made = JointTrials(Two(), Plain(), PLAN, MainTrials(Two(), Plain(), PLAN))(TRIALS)
    np.testing.assert_array_equal(made["draws"], DRAWS[:, :3])
    np.testing.assert_allclose(made["log_likelihood"], Two().log_likelihood(DRAWS[:, :3], X[:, None]))
    np.testing.assert_allclose(made["log_likelihood_true"], Two().log_likelihood(THETA, X))


def test_outside_the_prior_there_is_no_likelihood_and_of_what_is_no_number_nothing_is_known() -> None:
    draws = np.array([[[0.0, 1.0], [0.0, -1.0], [np.nan, 1.0], [0.0, np.inf]]])
    log_prior, likelihood = log_prior_and_likelihood(Two(), draws, np.array([[0.5, 1.5]]))
    known = stats.norm(1.0, 2.0).logpdf(0.0) - np.log(2.5)
    np.testing.assert_allclose(log_prior, [[known, -np.inf, np.nan, np.nan]])
    at = stats.norm(0.0, 1.0).logpdf([0.5, 1.5]).sum()
    np.testing.assert_allclose(likelihood, [[at, -np.inf, np.nan, np.nan]])


def test_what_simulators_and_estimators_may_not_give() -> None:
    class Wrong(Two):
        def __init__(self, change: Any):
            self.change = change

        def simulate(self, theta: Any, rng: Any) -> Any:
            return self.change(super().simulate(theta, rng))

    def said(simulator: Any, estimator: Any = None) -> str:
        with pytest.raises(InputError) as caught:
            MainTrials(simulator, estimator or Plain(), PLAN)(TRIALS)
        return str(caught.value)

    def spoilt(x: Any) -> Any:
        x[2, 1] = np.nan
        x[3, 0] = np.inf
        return x

    theta = np.array2string(THETA[2], precision=4)
    assert said(Wrong(spoilt)) == (
        f"the simulator gave NaN or infinite data for trial 10 (theta = {theta}); mend it, or narrow its "
        "prior"
    )
    assert said(Wrong(lambda x: x[:3])) == (
        "the simulator gave data of shape (3, 2) for 4 trials; its first axis must be the trial"
    )
    hidden = "the simulator's data has 4 masked values; fill them, or leave out what they belong to"
    assert said(Wrong(lambda x: np.ma.array(x, mask=np.arange(8).reshape(4, 2) % 2))) == hidden
    assert said(Wrong(lambda x: 1 / 0)) == (
        "the simulator failed on trials 8 to 11: ZeroDivisionError: division by zero"
    )

    class Few(Plain):
        def sample(self, x: Any, n: int, rng: Any) -> Any:
            return super().sample(x, n, rng)[:, 1:]

    shape = "the estimator gave draws of shape (4, 5, 2) for 4 trials; expected (4, 6, 2)"
    assert said(Two(), Few()) == shape
    assert np.array_equal(checked([[1, 2]], (1, 2)), [[1.0, 2.0]])
    assert checked([[1, 2]], (1, 2)).dtype == float
    with pytest.raises(InputError, match=r"^the estimator gave log_q of shape \(2,\) for 3 trials; expected"):
        checked([1, 2], (3,), "log_q")

    draws = np.zeros((6, 4, 2))
    with pytest.raises(InputError, match=r"expected \(4, 6, 2\): exchange their first two axes$"):
        checked(draws, (4, 6, 2))
    with pytest.raises(InputError, match=r"of shape \(3, 4, 2\) for 4 trials; expected \(4, 6, 2\)$"):
        checked(draws[:3], (4, 6, 2))

    class Dumb(Plain):
        def sample(self, x: Any, n: int, rng: Any) -> Any:
            raise KeyError("weights")

    assert said(Two(), Dumb()) == "the estimator failed on trials 8 to 11: KeyError: 'weights'"


def test_a_prior_without_a_density_says_so() -> None:
    assert without_density(Two.prior) == {}


def test_a_plan_that_ends_earlier() -> None:
    assert PLAN.at_most(11) == replace(PLAN, number=11, joint_number=11)
    assert PLAN.at_most(5) == replace(PLAN, number=5, importance_number=5, joint_number=5)
    assert PLAN.at_most(100) == PLAN
