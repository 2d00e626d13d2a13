from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.validate.learned.discriminant import fit_discriminant
from gaugeblock.validate.learned.observations import differences_of_means, local_c2st


def problem(n, *, seed, fault=0.0, draws=30):
    """theta ~ N(0, 1)^2, x ~ N(theta, 1); draws displaced by `fault` sd where x_0 > 1."""
    rng = np.random.default_rng([seed, n])
    theta = rng.normal(size=(n, 2))
    x = theta + rng.normal(size=(n, 2))
    shift = fault * (x[:, :1] > 1)[:, None]
    return theta, x[:, None] / 2 + np.sqrt(0.5) * (rng.normal(size=(n, draws, 2)) + shift), x


def at(place, fault=0.0, *, seed=0, draws=200):
    rng = np.random.default_rng(seed)
    centre = np.array([place, 0.0])
    return centre / 2 + np.sqrt(0.5) * (rng.normal(size=(draws, 2)) + fault), centre


def test_a_fault_shows_at_the_observation_where_it_is():
    trials = problem(3000, seed=1, fault=1.0)
    (bad, there), (good, elsewhere) = at(2.0, 1.0), at(-2.0)
    found = local_c2st(
        *trials, np.stack([bad, good]), np.stack([there, elsewhere]), rng=np.random.default_rng(2)
    )
    assert found.p_value[0] == 1e-3
    assert found.statistic[0] > 5 * found.statistic[1]
    assert found.p_global == 1e-3


def test_size_at_an_observation():
    """150 exact estimators, 60 trials, 99 refits: both p-values within the 0.999 binomial limit at 5%."""
    p = []
    for seed in range(150):
        observed, where = at(0.5, seed=seed, draws=40)
        rng = np.random.default_rng(seed)
        found = local_c2st(*problem(60, seed=seed, draws=8), observed, where, permutations=99, rng=rng)
        p.append((found.p_value[0], found.p_global))
    most = stats.binom.ppf(0.999, 150, 0.05)
    assert (np.count_nonzero(np.array(p) <= 0.05, axis=0) <= most).all()
    assert np.min(p) >= 0.01


def test_refits_are_what_refitting_would_give():
    """The difference of means for any choice of truths, beside the one computed from scratch."""
    rng = np.random.default_rng(3)
    phi = rng.normal(size=(40, 5, 4))
    called = rng.integers(0, 5, size=(6, 40))
    found = differences_of_means(phi.reshape(200, 4), called, 5)
    for replicate in range(6):
        mask = np.zeros((40, 5), dtype=bool)
        mask[np.arange(40), called[replicate]] = True
        np.testing.assert_allclose(found[replicate], phi[mask].mean(axis=0) - phi[~mask].mean(axis=0))


def test_the_discriminant_is_linear_in_the_labels():
    """Swapping all labels turns the discriminant round; that is what makes refits cheap."""
    rng = np.random.default_rng(4)
    one, other = rng.normal(size=(100, 2)), rng.normal(size=(100, 2)) + 0.5
    here, there = fit_discriminant(one, other), fit_discriminant(other, one)
    np.testing.assert_allclose(here(one), -there(one), atol=1e-6)  # learned in single precision


def test_the_same_generator_gives_the_same_answer():
    trials, (observed, where) = problem(200, seed=5), at(0.0)
    first, second = (
        local_c2st(*trials, observed, where, permutations=50, rng=np.random.default_rng(6)) for _ in range(2)
    )
    np.testing.assert_array_equal(first.null, second.null)
    assert first.refits == 50


def test_bad_input_is_said_in_one_line():
    theta, draws, x = problem(60, seed=7)
    observed, where = at(0.0)
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="at least 50"):
        local_c2st(theta[:40], draws[:40], x[:40], observed, where, rng=rng)
    with pytest.raises(InputError, match="L >= 2"):
        local_c2st(theta, draws[:, :1], x, observed, where, rng=rng)
    with pytest.raises(InputError, match="x_features"):
        local_c2st(theta, draws, x[:30], observed, where, rng=rng)
    with pytest.raises(InputError, match="do not go with"):
        local_c2st(theta, draws, x, observed, where[:1], rng=rng)
    with pytest.raises(InputError, match="NaN"):
        local_c2st(theta, draws * np.nan, x, observed, where, rng=rng)
