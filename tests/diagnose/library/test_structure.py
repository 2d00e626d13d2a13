"""What shows in draws alone: planted, measured, said, and taken away."""

from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.library.structure import (
    autocorrelated,
    different,
    few_distinct,
    fixed_seed,
    thinned,
)
from gaugeblock.validate.autocorrelation import draw_order


def cases_of(draws, theta=None):
    rng = np.random.default_rng(9)
    theta = rng.normal(size=(len(draws), draws.shape[2])) if theta is None else theta
    return Cases(tuple("abc"[: draws.shape[2]]), np.arange(len(draws)), theta, draws)


def normal(*shape):
    return np.random.default_rng(4).normal(size=shape)


def test_draws_that_repeat_each_other_are_counted_and_made_different():
    """Of each trial 20 draws, each of them thrice; of the second parameter ten, six times each."""
    draws = np.repeat(normal(400, 20, 2), 3, axis=1)
    draws[..., 1] = draws[:, :, 1][:, (np.arange(60) // 6) * 6]
    draws = np.random.default_rng(5).permuted(draws, axis=1)
    cases = cases_of(draws)
    (repair,) = few_distinct(cases)
    assert repair.numbers == {"share": pytest.approx(20 / 60)}
    assert repair.neutral == 1.0
    assert repair.words == "only 33% of the draws of a trial are different ones"
    assert repair.apply.keywords == {"column": 0}
    mended = repair.apply(cases).draws
    assert mended.shape == (400, 20, 2)
    for before, after in zip(draws, mended, strict=True):
        np.testing.assert_array_equal(np.sort(after[:, 0]), np.unique(before[:, 0]))


def test_as_many_are_kept_as_nearly_all_trials_have_and_not_the_lowest():
    draws = normal(100, 40, 1)
    draws[:5, 10:] = draws[:5, :1]  # ten different ones in a twentieth of the trials
    kept = different(cases_of(draws), column=0).draws
    assert kept.shape == (100, 10, 1)
    for before, after in zip(draws, kept, strict=True):
        assert len(np.unique(after)) == 10
        assert np.isin(after, before).all()
    # By lot: the mean of what is kept is that of all, to five errors.
    excess = kept[5:].mean(axis=1) - draws[5:].mean(axis=1)
    assert abs(excess.mean()) < 5 * draws.std() / np.sqrt(950)
    one = np.zeros((6, 20, 1))
    assert different(cases_of(one), column=0).draws.shape == (6, 8, 1)


def test_few_repetitions_are_none_and_discrete_parameters_repeat_by_themselves():
    draws = normal(50, 100, 1)
    for same, found in ((9, 0), (10, 1), (11, 1)):
        some = draws.copy()
        some[:, -same:] = some[:, :1]
        assert len(few_distinct(cases_of(some))) == found
    whole = np.round(normal(50, 100, 1))
    assert few_distinct(cases_of(whole, np.round(normal(50, 1)))) == []
    assert len(few_distinct(cases_of(whole))) == 1
    both = np.concatenate([whole, draws], axis=2)
    assert few_distinct(cases_of(both)) == []


def chains(trials, number, hold):
    rng = np.random.default_rng(6)
    draws = np.empty((trials, number, 1))
    draws[:, 0] = rng.normal(size=(trials, 1))
    for k in range(1, number):
        draws[:, k] = hold * draws[:, k - 1] + np.sqrt(1 - hold**2) * rng.normal(size=(trials, 1))
    return draws


def test_chains_are_thinned_as_far_as_they_depend_on_their_order():
    """An autoregression of 0.8 makes 400 draws worth 400 (1 - 0.8) / (1 + 0.8), 44."""
    cases = cases_of(chains(300, 400, 0.8))
    (repair,) = autocorrelated(cases)
    assert repair.numbers["worth"] == pytest.approx(44, rel=0.25)
    assert repair.words == (f"draws depend on their order: 400 are worth {repair.numbers['worth']:.0f}")
    stride = repair.apply.keywords["stride"]
    assert 3 < stride < 30
    np.testing.assert_array_equal(repair.apply(cases).draws, cases.draws[:, ::stride])
    np.testing.assert_array_equal(thinned(cases, 7).draws, cases.draws[:, ::7])
    assert autocorrelated(cases_of(normal(300, 400, 1))) == []
    # Of 0.315 more than half are left, which is no chain, though their order tells.
    some = chains(300, 400, 0.315)
    assert draw_order(some).stride > 1
    assert autocorrelated(cases_of(some)) == []
    assert len(autocorrelated(cases_of(chains(300, 400, 0.4)))) == 1


def test_the_same_random_numbers_in_every_trial():
    numbers = normal(1, 40, 2)
    wide = np.exp(normal(600, 1, 2))
    cases = cases_of(numbers * wide + normal(600, 1, 2))
    (repair,) = fixed_seed(cases)
    # Of the same places in n trials the mean square is n; of 500 of them, at most, that are looked at.
    assert repair.numbers == {"mean square": pytest.approx(500.0)}
    assert repair.words == "the draws of all trials are made of the same random numbers"
    assert repair.apply(cases) is cases
    (few,) = fixed_seed(cases.taken(slice(100)))
    assert few.numbers == {"mean square": pytest.approx(100.0)}
    assert fixed_seed(cases_of(normal(600, 40, 2))) == []
    assert fixed_seed(cases.drawn(np.sort(cases.draws, axis=1))) == []
    ties = np.sort(np.round(cases.draws), axis=1)
    assert fixed_seed(cases.drawn(ties)) == []
    # An eighth of 500 trials that are alike make the mean square 1 + 500 / 64: it is to be 40.
    some = normal(600, 40, 2)
    some[:62] = (numbers * wide)[:62]
    assert fixed_seed(cases_of(some)) == []
    some[:250] = (numbers * wide)[:250]
    assert fixed_seed(cases_of(some))[0].numbers == {"mean square": pytest.approx(126, rel=0.1)}
