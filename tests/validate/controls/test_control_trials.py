"""Controls of a few trials by hand: which draw plays the truth, how wide it is, and what a fault adds."""

import numpy as np
import pytest

from gaugeblock.core.streams import Rows
from gaugeblock.validate import make_trials, trials_tree
from gaugeblock.validate.controls.control_trials import (
    Pool,
    blurred,
    control_trials,
    displaced,
    half_width,
    log_wider,
    pool_of,
    without,
)
from gaugeblock.validate.learned.pool_coordinates import some_draws
from gaugeblock.validate.prepared import Prepared

RNG = np.random.default_rng(1)
DRAWS = RNG.normal(size=(6, 260, 2))
TRUTH = RNG.normal(size=(6, 2))


def test_half_widths_are_of_68_percent():
    values = RNG.normal(size=(3, 40, 2))
    low, high = np.quantile(values, [0.16, 0.84], axis=1, method="weibull")
    np.testing.assert_allclose(half_width(values)[:, 0], (high - low) / 2)
    values[1, :, 0] = 0.1 + 0.2  # equal, but for what interpolation rounds
    assert half_width(values)[1, 0, 0] == 0.0
    unit = np.array([[[2.0, 0.0]], [[1.0, 1.0]], [[0.5, 0.25]]])
    found = log_wider(values, unit)
    for k in range(3):
        for j in range(2):
            wide = half_width(values)[k, 0, j]
            known = wide > 0 and unit[k, 0, j] > 0
            assert found[k, j] == pytest.approx(
                np.log(wide / unit[k, 0, j]) if known else np.nan, nan_ok=True
            )
    assert np.isnan(found).sum() == 2


@pytest.mark.parametrize("weighted", [False, True])
def test_a_draw_of_some_plays_the_truth(weighted):
    """Of 260 draws every second, of weighted ones as many drawn anew; each with the same chance."""
    weight = RNG.exponential(size=(6, 260)) if weighted else None
    prepared = Prepared(trials_tree(make_trials(TRUTH, DRAWS, weight=weight)), 3)
    (block,) = prepared.blocks()
    lot = Rows(3, "test", np.arange(6))
    pool = pool_of(block, Rows(3, "test", np.arange(6)))
    draws = some_draws(DRAWS, lot, weight=weight, most=260) if weighted else DRAWS
    kept = draws[:, ::2]
    np.testing.assert_array_equal(pool.values, kept)
    chosen = np.floor(130 * lot.random((6, 1, 1))).astype(int)
    np.testing.assert_array_equal(pool.chosen, chosen)
    np.testing.assert_array_equal(pool.unit, half_width(kept))
    assert (pool.rows.start, pool.rows.stop) == (0, 6)
    few = Prepared(trials_tree(make_trials(TRUTH, DRAWS[:, :249])), 3)
    (block,) = few.blocks()
    assert pool_of(block, lot).values.shape[1] == 249


def test_the_last_draw_takes_the_place_of_the_chosen():
    values = np.arange(24.0).reshape(3, 4, 2)
    chosen = np.array([0, 2, 3])[:, None, None]
    wanted = [values[0, [3, 1, 2]], values[1, [0, 1, 3]], values[2, [0, 1, 2]]]
    np.testing.assert_array_equal(without(values, chosen), wanted)
    assert values[0, 0, 0] == 0.0


def test_what_faults_add():
    values = RNG.normal(size=(3, 4, 2))
    chosen = np.array([0, 2, 3])[:, None, None]
    pool = Pool(values, chosen, half_width(values), slice(1, 4), Rows(5, "noise", [1, 2, 3]))
    found = displaced(np.array([9.0, 0.5, -1.0, 0.0, 9.0]))(pool)
    for k, size in enumerate((0.5, -1.0, 0.0)):
        wanted = np.tile(size * pool.unit[k, 0], (4, 1))
        wanted[chosen[k, 0, 0]] = 0.0
        np.testing.assert_allclose(found[k], wanted)
    noise = Rows(5, "noise", [1, 2, 3]).standard_normal((3, 4, 2))
    found = blurred(0.7)(pool)
    for k in range(3):
        np.testing.assert_allclose(found[k], 0.7 * pool.unit[k] * (noise[k] - noise[k, chosen[k, 0, 0]]))


def test_a_control_s_blocks_are_its_pools_with_the_fault(monkeypatch):
    """Two trials a block; the truths it knows are those that play, widths are compared with no fault's."""
    monkeypatch.setattr("gaugeblock.validate.storage.VALUES", 260 * 2 * 2)
    density = RNG.normal(size=(6, 260))
    trials = make_trials(
        TRUTH, DRAWS, log_q=density, log_likelihood=density, log_prior=density, log_q_true=np.zeros(6),
        log_likelihood_true=np.zeros(6), log_prior_true=np.zeros(6), x=np.arange(6.0)[:, None],
    )  # fmt: skip
    prepared = Prepared(trials_tree(trials), 3)
    control = control_trials(prepared, "p", displaced(np.arange(6.0)))
    plain = control_trials(prepared, "p")
    blocks, bare = list(control.blocks()), list(plain.blocks())
    assert [len(block) for block in blocks] == [2, 2, 2]
    lot = Rows(3, "controls p", np.arange(6))
    chosen = np.floor(130 * lot.random((6, 1, 1))).astype(int)
    kept = DRAWS[:, ::2]
    truth = np.take_along_axis(kept, chosen, axis=1)[:, 0]
    moved = kept + np.arange(6.0)[:, None, None] * half_width(kept)
    np.put_along_axis(moved, np.broadcast_to(chosen, (6, 1, 2)), truth[:, None], axis=1)
    np.testing.assert_allclose(np.concatenate([block.draws for block in blocks]), without(moved, chosen))
    np.testing.assert_allclose(np.concatenate([block.draws for block in bare]), without(kept, chosen))
    for made in (blocks, bare):
        np.testing.assert_allclose(np.concatenate([block.theta_true for block in made]), truth)
        assert all(block.x is not None for block in made)
        for name in ("weight", "log_q", "log_likelihood", "log_prior", "log_q_true", "log_likelihood_true",
                     "log_prior_true"):  # fmt: skip
            assert all(getattr(block, name) is None for block in made)
    np.testing.assert_allclose(control.theta_true, truth)
    np.testing.assert_array_equal(prepared.theta_true, TRUTH)
    np.testing.assert_allclose(control.log_wider, log_wider(moved, half_width(kept)))
    assert not plain.log_wider.any()
    assert (control.seed, control.purpose, control.of) == (3, "p", prepared)
    for name in ("main", "not_finite", "unaffected", "trial", "order", "features"):
        assert getattr(control, name) is getattr(prepared, name)
