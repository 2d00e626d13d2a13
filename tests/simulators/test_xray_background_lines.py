"""Lines in a measured background: found where the detector has them, not where counts scatter."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("jaxspec")

from gaugeblock.simulators.xray.measured_background import LINES, BackgroundShape, MeasuredBackground

GRID = np.linspace(0.3, 10.0, 195)
EDGES = np.stack([GRID[:-1], GRID[1:]], axis=1)
SMOOTH = np.exp(-EDGES.mean(axis=1) / 3.0) + 0.2
ALUMINIUM, COPPER = 1.49, 8.05


def line(energy: float, sigma: float) -> np.ndarray:
    """A line of unit area over the channels."""
    shape = np.exp(-0.5 * ((EDGES.mean(axis=1) - energy) / sigma) ** 2)
    return shape / shape.sum()


def drawn(number: float, lines: dict[float, float], seed: int) -> np.ndarray:
    """Counts of a smooth background of so many counts, and of lines of so many each."""
    mean = number * SMOOTH / SMOOTH.sum()
    for energy, counts in lines.items():
        mean = mean + counts * line(energy, 0.04 * np.sqrt(energy))
    return np.random.default_rng(seed).poisson(mean)


def fitted(counts: np.ndarray, **options: object) -> MeasuredBackground:
    return MeasuredBackground.fit(counts, 0.5, EDGES, exposure=1e4, **options)


def misfit(background: MeasuredBackground, counts: np.ndarray) -> float:
    """Deviance of the fit in standard deviations of what the truth would have."""
    mean = background.shape.rate(background.prior.center) * 1e4 / 0.5

    def deviance(of: np.ndarray) -> np.ndarray:
        safe = np.where(of > 0, of, 1)
        return 2 * (mean - of + of * np.log(safe / mean)).sum(axis=-1)

    null = deviance(np.random.default_rng(0).poisson(mean, (1000, len(mean))))
    return float((deviance(counts) - null.mean()) / null.std())


def test_the_detectors_own_lines_are_found_and_followed():
    counts = drawn(6000, {ALUMINIUM: 300, COPPER: 150}, seed=1)
    found = fitted(counts)
    energies = sorted(found.shape.lines[:, 0])
    assert len(energies) in (2, 3)
    assert abs(energies[0] - ALUMINIUM) < 0.06
    assert min(abs(energy - COPPER) for energy in energies) < 0.12
    assert misfit(found, counts) < 2.0
    assert misfit(fitted(counts, knots=found.shape.knots), counts) > 8.0
    names = found.prior.names
    assert names[len(found.shape.knots)] == "background_1.line_1"
    assert len(names) == found.shape.basis.shape[-1]


def test_no_line_where_there_is_none():
    with_lines = sum(
        len(fitted(drawn(number, {}, seed)).shape.lines) > 0
        for number in (30, 600, 6000)
        for seed in range(40)
    )
    # At most one in a hundred: of 120 backgrounds, five would come once in 100 such runs.
    assert with_lines <= 4


def test_a_single_count_is_no_line():
    steep = 2000 * np.exp(-3.0 * EDGES.mean(axis=1))
    counts = np.random.default_rng(5).poisson(steep)
    counts[170] += 1
    assert counts[100:].sum() == 1
    assert len(fitted(counts).shape.lines) == 0


def test_there_is_an_end_to_lines():
    comb = {1.0 + 0.7 * k: 400.0 for k in range(12)}
    assert len(fitted(drawn(3000, comb, seed=2)).shape.lines) <= LINES


def test_knots_of_ones_own_are_all_there_is():
    counts = drawn(6000, {ALUMINIUM: 300}, seed=3)
    assert fitted(counts, knots=[0.3, 2.0, 10.0]).shape.lines.shape == (0, 2)


def test_the_derivative_knows_the_lines():
    shape = BackgroundShape.over(EDGES, EDGES[:, 1] - EDGES[:, 0], [0.3, 2.0, 10.0], [[1.49, 0.05]])
    at = np.array([0.1, -0.2, 0.3, 1.2])
    step = 1e-6
    numeric = np.stack(
        [(shape.rate(at + step * unit) - shape.rate(at - step * unit)) / (2 * step) for unit in np.eye(4)], -1
    )
    np.testing.assert_allclose(shape.derivative(at), numeric, rtol=1e-6, atol=1e-10)
