"""One parameter at a time: what was planted is measured and taken away again."""

import numpy as np
import pytest
from scipy import stats

from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.library.marginal import clipped_tails, outliers, scale, shift, skew, stray


def exact(trials=3000, draws=100, *, law=None):
    """Two parameters, of widths that differ from trial to trial, in units that differ."""
    rng = np.random.default_rng(4)
    size = np.exp(0.5 * rng.normal(size=(trials, 1, 1))) * [1.0, 20.0]
    whole = rng.normal(size=(trials, 1, 2)) + size * (law or rng.normal)(size=(trials, draws + 1, 2))
    return Cases(("a", "b"), np.arange(trials), whole[:, 0], whole[:, 1:]), size


def about(cases, factor):
    middle = np.median(cases.draws, axis=1, keepdims=True)
    return cases.drawn(middle + factor * (cases.draws - middle))


def test_shifts_in_half_widths_and_in_units():
    cases, size = exact()
    wide, unit = 0.9945 * size, np.median(0.9945 * size, axis=0)
    for planted, place in (([0.4, -0.3] * wide, 0), ([0.3, -0.3] * np.ones_like(wide) * unit, 1)):
        moved = cases.drawn(cases.draws + planted)
        found = shift(moved)
        assert [each.variant for each in found] == ["of their half-widths", "in their own units"]
        for each in found:
            below = (each.apply(moved).draws < cases.theta[:, None]).mean(axis=(0, 1))
            np.testing.assert_allclose(below, 0.5, atol=1e-3)
        repair = found[place]
        wanted = (0.4, -0.3) if place == 0 else (0.3, -0.3) * unit[0]
        np.testing.assert_allclose(list(repair.numbers.values()), wanted, rtol=0.25)
        step = moved.draws - repair.apply(moved).draws
        np.testing.assert_allclose(step.mean(axis=(0, 1)), planted.mean(axis=0).ravel(), rtol=0.25)
        assert np.ptp(step, axis=0).max() > 1 if place == 0 else np.ptp(step, axis=0).max() < 1e-9


@pytest.mark.parametrize(
    ("factor", "kind"), [((0.6, 0.6), "narrow"), ((1.5, 1.5), "wide"), ((0.6, 1.5), "narrow or wide")]
)
def test_widths_are_measured_each_and_all_alike(factor, kind):
    cases, _ = exact()
    wrong = about(cases, np.array(factor))
    each, alike = scale(wrong)
    assert (each.variant, alike.variant) == ("each", "all alike")
    assert f"too {kind}: " in each.words
    assert list(each.numbers.values()) == pytest.approx(factor, rel=0.06)
    np.testing.assert_allclose(each.apply(wrong).draws.std(axis=1), cases.draws.std(axis=1), rtol=0.06)
    assert len(set(alike.numbers.values())) == 1
    if factor[0] == factor[1]:
        assert alike.numbers["a"] == pytest.approx(factor[0], rel=0.05)


def test_draws_of_two_modes_are_stretched_about_their_mean_too():
    rng = np.random.default_rng(5)

    def modes(size):
        return rng.choice([-3.0, 3.0], size, p=[0.3, 0.7]) + 0.3 * rng.normal(size=size)

    cases, _ = exact(law=modes)
    mean = cases.draws.mean(axis=1, keepdims=True)
    wrong = cases.drawn(mean + 0.7 * (cases.draws - mean))
    *_, last = scale(wrong)
    assert last.variant == "about the mean"
    assert last.numbers["a"] == pytest.approx(0.7, abs=0.05)
    np.testing.assert_allclose(last.apply(wrong).draws.mean(axis=1), mean[:, 0], atol=1e-6)


@pytest.mark.parametrize("lopsided", [0.3, -0.3])
def test_lopsided_draws_are_straightened(lopsided):
    cases, _ = exact()
    middle = np.median(cases.draws, axis=1, keepdims=True)
    off = cases.draws - middle
    wrong = cases.drawn(middle + off * np.exp(lopsided * np.sign(off) * [1.0, 0.0]))
    (repair,) = skew(wrong)
    assert repair.numbers["a"] == pytest.approx(lopsided, abs=0.06)
    assert repair.numbers["b"] == pytest.approx(0.0, abs=0.06)
    straight = stats.skew(repair.apply(wrong).draws, axis=1).mean(axis=0)
    assert np.abs(straight).max() < 0.15 < abs(stats.skew(wrong.draws, axis=1).mean(axis=0)[0])


def test_stray_draws_are_left_out_where_there_are_a_few():
    cases, size = exact()
    rng = np.random.default_rng(6)
    for share in (0.0, 0.03, 0.22):
        far = rng.permuted(np.tile(np.arange(100) < 100 * share, (3000, 1)), axis=1)[..., None]
        sign = np.where(np.arange(100) % 2, 1, -1)[:, None]
        wrong = cases.drawn(cases.draws + far * sign * [0.0, 1.0] * 60 * size)
        found = outliers(wrong)
        assert len(found) == (share == 0.03)
        for repair in found:
            assert repair.numbers["share"] == pytest.approx(far.mean())
            mended = repair.apply(wrong).draws
            assert (np.abs(mended - cases.middle[:, None]) < 8 * size).all()
            assert np.isin(mended[7, :, 0], wrong.draws[7, ~far[7, :, 0], 0]).all()


def test_tails_that_were_cut_off_are_drawn_out():
    cases, _ = exact(draws=200)
    low, high = np.quantile(cases.draws, [0.04, 0.96], axis=1)[:, :, None]
    rng = np.random.default_rng(7)
    inside = np.sort(np.where((cases.draws < low) | (cases.draws > high), np.nan, cases.draws), axis=1)
    number = np.count_nonzero(np.isfinite(inside), axis=1)
    pick = (rng.random(cases.draws.shape) * number[:, None]).astype(int)
    wrong = cases.drawn(np.take_along_axis(inside, pick, axis=1))
    (repair,) = clipped_tails(wrong)
    assert repair.numbers["share"] == pytest.approx(0.04, abs=0.006)
    np.testing.assert_allclose(
        repair.apply(wrong).draws.std(axis=1).mean(axis=0), cases.draws.std(axis=1).mean(axis=0), rtol=0.05
    )
    assert not clipped_tails(about(cases, 1.4))


def test_a_draw_is_stray_beyond_eight_half_widths_and_not_at_eight():
    """Of whole numbers, where that can be: the middle is 0, the central 68% end at 1 either way."""
    draws = np.zeros((2, 101, 1))
    draws[:, :25], draws[:, -25:] = -1.0, 1.0
    draws[0, -1], draws[1, 0] = 8.0, -9.0
    cases = Cases(("k",), np.arange(2), np.zeros((2, 1)), draws)
    assert cases.half_width.tolist() == [[1.0], [1.0]]
    found = stray(cases)
    assert found.shape == (2, 101)
    assert np.argwhere(found).tolist() == [[1, 0]]
