"""Recovery, contraction and pairs: the arrays behind them, held against plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.reports.axes import draw_points
from gaugeblock.reports.trial_pictures import trial_picture, trial_picture_ids
from gaugeblock.validate import make_trials, trials_tree


@pytest.fixture(scope="module")
def tree():
    rng = np.random.default_rng(5)
    theta = 3 * rng.normal(size=(400, 3))
    draws = theta[:, None] + 2 * rng.normal(size=(400, 1, 3)) + 2 * rng.normal(size=(400, 200, 3))
    return trials_tree(make_trials(theta, draws, ["a", "b[1]", "c, d"]))


def test_every_parameter_and_pair_has_an_id_that_draws(tree):
    pyplot = pytest.importorskip("matplotlib.pyplot")
    ids = trial_picture_ids(tree)
    assert ids[0] == "recovery[a]"
    assert "pairs[b[1], c, d]" in ids
    assert len(ids) == len(set(ids)) == 9
    figure, grid = pyplot.subplots(3, 3)
    for identifier, axes in zip(ids, grid.ravel(), strict=True):
        assert draw_points(trial_picture(identifier, tree), ax=axes) is axes
        assert axes.get_title() == identifier
    pyplot.close(figure)


def test_recovery_is_mean_against_truth(tree):
    shown = trial_picture("recovery[b[1]]", tree)
    np.testing.assert_allclose(shown.x, tree["theta_true"][:, 1])
    np.testing.assert_allclose(shown.y, tree["draws"][..., 1].mean("draw"))
    share = np.cov(shown.x, shown.y)[0, 1] ** 2 / (shown.x.var(ddof=1) * shown.y.var(ddof=1))
    assert shown.remark == f"the means explain {share:.0%} of the variance of the truths"
    assert shown.diagonal[0] <= shown.x.min()


def test_contraction_is_against_the_truths_variance(tree):
    shown = trial_picture("contraction[a]", tree)
    sd = tree["draws"][..., 0].std("draw", ddof=1)
    np.testing.assert_allclose(shown.x, 1 - sd**2 / tree["theta_true"][:, 0].var(), atol=0.05)
    assert 0.4 < np.median(shown.x) < 0.65  # 1 - 4 / 9
    assert shown.band == (-2.0, 2.0)
    assert np.std(shown.y) == pytest.approx(1.0, rel=0.1)


def test_pairs_are_the_draws_of_one_trial(tree):
    shown = trial_picture("pairs[a, c, d]", tree, trial=7)
    np.testing.assert_array_equal(shown.y, tree["draws"][7, :, 2])
    assert shown.mark == (float(tree["theta_true"][7, 0]), float(tree["theta_true"][7, 2]))
    with pytest.raises(InputError, match="no trial 400"):
        trial_picture("pairs[a, c, d]", tree, trial=400)
