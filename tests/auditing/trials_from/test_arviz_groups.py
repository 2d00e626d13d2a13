"""Trials in ArviZ's groups: they come back as they were, and its functions work on them."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from gaugeblock import make_trials, to_arviz, trials_from_arviz
from gaugeblock.core.errors import InputError


@pytest.fixture(scope="module")
def trials() -> xr.Dataset:
    """Posteriors of `a` are right, those of `b` half as wide as they should be."""
    rng = np.random.default_rng(4)
    theta = rng.normal(size=(600, 2))
    x = theta + 0.5 * rng.normal(size=theta.shape)
    noise = np.sqrt(0.2) * rng.normal(size=(600, 80, 2)) * [1.0, 0.5]
    return make_trials(theta, 0.8 * x[:, None] + noise, ["a", "b"], x=x)


def test_they_come_back_as_they_were(trials):
    back = trials_from_arviz(to_arviz(trials), autocorrelated=False)
    xr.testing.assert_equal(back, trials)


def test_truths_do_not_come_back_as_data(trials):
    assert "x" not in trials_from_arviz(to_arviz(trials.drop_vars("x")))


def test_transforms_are_uniform_where_posteriors_are_right(trials):
    pit = to_arviz(trials)["prior_sbc"]
    assert pit["a"].dims == ("chain", "draw")
    assert stats.kstest(pit["a"].values[0], "uniform").pvalue > 0.01
    assert stats.kstest(pit["b"].values[0], "uniform").pvalue < 1e-6
    below = (trials["draws"] < trials["theta_true"]).mean("draw")
    np.testing.assert_allclose(pit["b"].values[0], below.sel(parameter="b"), atol=0.02)


def test_one_trial_is_a_posterior_of_its_own_and_arviz_sums_it_up(trials):
    one = to_arviz(trials.assign_coords(trial=np.arange(600) + 10), trial=13)
    assert one["constant_data"]["b"] == trials["theta_true"][3, 1]
    np.testing.assert_array_equal(one["posterior"]["a"].values[0], trials["draws"][3, :, 0])
    np.testing.assert_array_equal(one["observed_data"]["x"], trials["x"][3])
    summary = pytest.importorskip("arviz_stats").summary(one, round_to="none")
    assert summary.loc["b", "mean"] == pytest.approx(float(trials["draws"][3, :, 1].mean()))
    with pytest.raises(InputError, match="no trial 9: they have the numbers 10 to 609"):
        to_arviz(trials.assign_coords(trial=np.arange(600) + 10), trial=9)
