"""Backgrounds that end inside the channels: files that hold nothing beyond, a step that no spline follows."""

import numpy as np
import pytest
from scipy.stats import binom, poisson

from gaugeblock.simulators.xray.measured_background import MeasuredBackground

GRID = np.linspace(0.3, 15.0, 148)
EDGES = np.column_stack([GRID[:-1], GRID[1:]])
CENTRE = EDGES.mean(axis=1)
LAST = CENTRE > 9.0
BEYOND = CENTRE > 10.0


def fitted(counts, **how):
    """Expected counts in the background region, and the fit."""
    made = MeasuredBackground.fit(counts, 0.5, EDGES, exposure=1.0, **how)
    return made.shape.rate(made.prior.center) / 0.5, made


def flat(number):
    """Rates that fall slowly, as a camera's do above a few keV: so many counts in all."""
    shape = CENTRE**-0.4
    return number * shape / shape.sum()


@pytest.mark.parametrize("number", [1_000, 10_000])
def test_a_step_is_a_step(number):
    rng = np.random.default_rng(number)
    rate = np.where(BEYOND, 0.0, flat(number))
    misfit = []
    for _ in range(10):
        expected, made = fitted(rng.poisson(rate))
        assert expected[BEYOND].sum() < 0.02 * np.sqrt(number)
        assert made.shape.knots[-1] == pytest.approx(10.0, abs=0.3)
        last = LAST & ~BEYOND
        misfit.append((expected[last].sum() - rate[last].sum()) / np.sqrt(rate[last].sum()))
    # Fits of their own counts: no farther from the truth than counts are, and to both sides of it.
    assert np.abs(misfit).max() < 4
    assert abs(np.mean(misfit)) < 4 / np.sqrt(10)


def test_a_line_before_the_end_is_found_and_the_end_stays():
    rate = flat(10_000) + 300 * np.exp(-0.5 * ((CENTRE - 8.0) / 0.12) ** 2)
    expected, made = fitted(np.random.default_rng(8).poisson(np.where(BEYOND, 0.0, rate)))
    assert len(made.shape.lines)
    assert made.shape.lines[0, 0] == pytest.approx(8.0, abs=0.2)
    assert expected[BEYOND].sum() < 2


def test_a_step_at_the_low_end_too():
    rng = np.random.default_rng(3)
    rate = np.where(CENTRE < 2.0, 0.0, flat(3_000))
    expected, made = fitted(rng.poisson(rate))
    assert expected[CENTRE < 2.0].sum() < 1
    assert made.shape.knots[0] == pytest.approx(2.0, abs=0.3)


@pytest.mark.parametrize("scale", [0.5, 1.5])
def test_what_fades_does_not_end(scale):
    """Counts that fall by factors of e leave empty channels too. At most 5% are taken for an end."""
    rng = np.random.default_rng(4)
    rate = 40 * np.exp(-CENTRE / scale)
    made = [fitted(rng.poisson(rate))[1] for _ in range(30)]
    ended = sum(one.shape.knots[-1] < GRID[-1] - 1e-9 for one in made)
    assert ended <= binom.ppf(0.999, 30, 0.05)


def test_what_has_no_empty_end_is_as_it_was():
    counts = np.random.default_rng(5).poisson(flat(5_000))
    assert counts[[0, -1]].all()
    assert fitted(counts)[1].shape.knots[[0, -1]] == pytest.approx([0.3, 15.0])


def test_few_counts_say_nothing_of_an_end():
    counts = np.zeros(len(CENTRE), dtype=int)
    counts[[3, 20, 60]] = 1
    assert fitted(counts)[1].shape.knots[-1] == pytest.approx(15.0)


def test_knots_of_ones_own_reach_where_they_are_put():
    counts = np.random.default_rng(6).poisson(np.where(BEYOND, 0.0, flat(5_000)))
    knots = [0.3, 1.0, 5.0, 15.0]
    assert fitted(counts, knots=knots)[1].shape.knots.tolist() == knots


def test_counts_beyond_the_end_are_no_surprise_to_nobody():
    """The rate beyond is small and not nothing: a single count there has a finite log likelihood."""
    expected, _ = fitted(np.random.default_rng(7).poisson(np.where(BEYOND, 0.0, flat(5_000))))
    assert np.isfinite(poisson.logpmf(1, expected[BEYOND])).all()
