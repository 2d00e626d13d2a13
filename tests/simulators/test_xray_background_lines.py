"""Lines in a measured background: found where the detector has them, not where counts scatter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize

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


def test_the_prior_is_five_standard_errors_around_the_likeliest_rates():
    """By SciPy's minimiser and differences: a Poisson likelihood, held at the mean by 3 in the logarithm."""
    edges = np.stack([np.arange(1.0, 9.0), np.arange(2.0, 10.0)], axis=1)
    scale, seconds, knots = np.array([0.5, 0.5, 0.25, 1, 1, 2, 0.5, 0.5]), 700.0, [1.0, 2.5, 9.0]
    width = np.array([1.0, 1.0, 0.5, 1.0, 0.25, 1.0, 1.0, 1.0])
    x, w = np.polynomial.legendre.leggauss(3)
    at = edges.mean(axis=1)[:, None] + 0.5 * x

    def expected(log_rate):
        rate = np.exp(CubicSpline(np.log(knots), log_rate, bc_type="natural")(np.log(at)))
        return 0.5 * width * (rate @ w) * seconds / scale

    # Every standard deviation is 0.2 at least and 2 at most.
    some = np.array([40, 0, 9, 3, 14, 200, 3, 60])
    for counts, low, high in ((some, 0.3, 2.0), (0 * some, 2.0, 2.0), (10_000 * some, 0.2, 0.2)):
        level = np.log((counts.sum() + 0.5) / (seconds / scale * width).sum())

        def objective(log_rate, counts=counts, level=level):
            mean = expected(log_rate)
            return (mean - counts * np.log(mean)).sum() + ((log_rate - level) ** 2).sum() / 18

        best = minimize(objective, np.full(3, level), method="Nelder-Mead",
                        options={"xatol": 1e-9, "fatol": 1e-12, "maxiter": 4000}).x  # fmt: skip
        h = 1e-5
        slope = np.stack([(expected(best + h * e) - expected(best - h * e)) / (2 * h) for e in np.eye(3)])
        information = slope / expected(best) @ slope.T + np.eye(3) / 9
        error = 5 * np.sqrt(np.diag(np.linalg.inv(information)))
        prior = MeasuredBackground.fit(counts, scale, edges, exposure=seconds, width=width, knots=knots).prior
        assert prior.names == tuple(f"background_1.rate_{k}" for k in (1, 2, 3))
        np.testing.assert_allclose([one.center for one in prior.marginals.values()], best, atol=1e-4)
        sd = [one.sd for one in prior.marginals.values()]
        np.testing.assert_allclose(sd, np.clip(error, 0.2, 2.0), rtol=1e-4)
        assert low <= min(sd) <= max(sd) <= high


def test_knots_and_lines_are_those_that_a_search_by_hand_finds():
    counts = drawn(3000, {ALUMINIUM: 250}, seed=42)
    found = fitted(counts)
    # Knots, as fractions of log energy and of the counts, whose mean is cut evenly.
    grid = np.append(EDGES[:, 0], EDGES[-1, 1])
    log = np.log(grid / grid[0]) / np.log(grid[-1] / grid[0])
    sums = np.append(0.0, np.cumsum(counts)) / counts.sum()

    def places(number):
        return np.exp(np.interp(np.arange(number) / (number - 1), 0.5 * (log + sums), np.log(grid)))

    def deviance(made):
        mean = made.shape.rate(made.prior.center) * 1e4 / 0.5
        return 2 * (mean - counts + counts * np.log(np.where(counts > 0, counts, 1) / mean)).sum()

    tried = {number: fitted(counts, knots=places(number)) for number in range(6, 15)}
    number = min(tried, key=lambda number: deviance(tried[number]) + 2 * number)
    np.testing.assert_allclose(found.shape.knots, places(number), rtol=1e-6)
    # The line by whose counts' deviance the smooth fit misses most, of three widths at every channel.
    mean = tried[number].shape.rate(tried[number].prior.center) * 1e4 / 0.5
    centre, most = EDGES.mean(axis=1), -np.inf
    for energy, wide in zip(centre, EDGES[:, 1] - EDGES[:, 0], strict=True):
        for width in (0.02, 0.04, 0.08):
            sigma = max(width * np.sqrt(energy), 0.5 * wide)
            bump = np.exp(-0.5 * ((centre - energy) / sigma) ** 2)
            seen, expected = (counts * bump).sum(), (mean * bump).sum()
            apart = seen * np.log(seen / expected) - (seen - expected) if seen > expected else -np.inf
            if apart > most:
                most, line_found = apart, [energy, sigma]
    np.testing.assert_allclose(found.shape.lines[0], line_found, rtol=1e-9)
    # The fit with it is the likeliest one: no line is pulled to nothing, no rate to the mean.
    level = np.log((counts.sum() + 0.5) / (1e4 / 0.5 * np.diff(EDGES, axis=1).sum()))
    pull = found.prior.center - np.where(["rate" in name for name in found.prior.names], level, 0.0)
    mean = found.shape.rate(found.prior.center) * 1e4 / 0.5
    rise = (
        mean[:, None] * np.log(found.shape.rate(found.prior.center + np.eye(len(pull)) * 1e-6) * 2e4 / mean).T
    )
    np.testing.assert_allclose(1e6 * rise.T @ (counts / mean - 1.0), pull / 9, atol=0.01)


def test_knots_begin_at_a_thousandth_of_a_kev_whatever_the_order_of_channels():
    edges = np.stack([np.arange(0.0, 6.0), np.arange(1.0, 7.0)], axis=1)
    counts = np.array([30, 20, 10, 10, 5, 5])
    made, turned = (
        MeasuredBackground.fit(counts[way], 1.0, edges[way], exposure=10.0)
        for way in (slice(None), [0, 2, 1, 3, 4, 5])
    )
    assert made.shape.knots[[0, -1]] == pytest.approx([1e-3, 6.0])
    np.testing.assert_allclose(turned.shape.knots, made.shape.knots, rtol=1e-9)
