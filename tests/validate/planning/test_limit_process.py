"""Numbers of the limit process by hand, and its probabilities by simulating normal numbers anew."""

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.levels import LEVELS
from gaugeblock.validate.planning.limit_process import LimitProcess, correlation, hidden_by
from gaugeblock.validate.policy import make_policy

TOLERANCE = make_policy(
    {"tolerance": {"bias": 0.12, "log_width": 0.15, "coverage": 0.06}}, source="test"
).tolerance
WIDTHS = (0.5, 0.68, 0.9)
Z = stats.norm.ppf((1 + np.array(WIDTHS)) / 2)


def test_correlations_are_those_of_nested_intervals():
    found = correlation((0.2, 0.9))
    levels = np.array([*WIDTHS, 0.2, 0.9])
    assert found.shape == (6, 6)
    assert (found[0] == np.eye(6)[0]).all()
    for a in range(5):
        for b in range(5):
            low, high = sorted([levels[a], levels[b]])
            wanted = (low - low * high) / np.sqrt(low * (1 - low) * high * (1 - high))
            assert found[a + 1, b + 1] == pytest.approx(wanted)
    assert found[3, 5] == pytest.approx(1)


def errors(n, levels):
    """Of a median of ranks, of logs of quantiles, of shares with eight more inside and eight outside."""
    widths = np.array(WIDTHS)
    share = (n * np.array(levels) + 8) / (n + 16)
    return np.concatenate([
        [np.sqrt(np.pi / 3 / n) / stats.norm.ppf(0.84)],
        np.sqrt(widths * (1 - widths) / n) / (2 * stats.norm.pdf(Z) * Z),
        np.sqrt(share * (1 - share) / n),
    ])  # fmt: skip


def test_standard_errors_and_what_they_reach():
    process = LimitProcess(parameters=2, draws=50, levels=(0.3, 0.6), families=3, further=7, seed=2)
    error = errors(900, (0.3, 0.6))
    np.testing.assert_allclose(process.standard_errors(900), [error])
    critical = process.critical(900, 0.1)
    reach = critical + stats.norm.ppf(0.8)
    assert process.smallest_detectable(900, TOLERANCE, error_budget=0.1, power=0.8) == pytest.approx({
        "bias": 0.12 + reach * error[0], "log_width": 0.15 + reach * error[1:4].min(),
        "coverage": 0.06 + reach * error[4:].max(),
    })  # fmt: skip
    hidden = {"bias": 1.5 / 50, "log_width": 4 / 54, "coverage": 2.5 / 52.5}
    assert hidden_by(50) == pytest.approx(hidden)
    gap = 0.12 * (1 - hidden["coverage"])
    spread = 0.5 / 30  # of a half, the largest there is
    assert process.fail_probability(900, TOLERANCE, error_budget=0.1) == pytest.approx({
        "bias": stats.norm.cdf((2 * (1 - hidden["bias"]) - 1) * 0.12 / error[0] - critical),
        "log_width": stats.norm.cdf((2 * (1 - hidden["log_width"]) - 1) * 0.15 / error[1:4].min() - critical),
        "coverage": stats.norm.cdf((gap - 0.06) / spread - critical),
    })  # fmt: skip


def simulated(levels, number=200_000):
    """Sizes of a bias, three widths and gaps: brackets of one normal number, independent of the bias."""
    apart = sorted({*levels, *WIDTHS, *LEVELS})
    among = correlation(apart)[4:, 4:]
    root = np.linalg.cholesky(among + 1e-10 * np.eye(len(apart)))
    rng = np.random.default_rng(3)
    gaps = dict(zip(apart, np.abs(rng.normal(size=(number, len(apart))) @ root.T).T, strict=True))
    return np.abs(rng.normal(size=number)), gaps


@pytest.mark.parametrize(("parameters", "families", "further"), [(1, 1, 0), (3, 2, 0), (2, 4, 40)])
def test_critical_values_hold_all_together(parameters, families, further):
    """Of all parameters and as many independent comparisons, with the first look's 0.8 of the budget."""
    levels = (0.3, 0.6)
    bias, gaps = simulated(levels)
    largest = np.max([bias, *(gaps[level] for level in (*WIDTHS, *levels))], axis=0)
    process = LimitProcess(parameters=parameters, draws=50, families=families, further=further, levels=levels)
    critical = process.critical(400, 0.2)
    normal = -stats.norm.ppf(stats.t.sf(critical, 399))
    held = np.mean(largest <= normal) ** parameters * (1 - 2 * stats.norm.sf(normal)) ** further
    assert 1 - held == pytest.approx(0.16 / families, rel=0.03)


def test_probabilities_to_pass_are_those_of_all_within():
    levels = (0.3, 0.6)
    bias, gaps = simulated(levels)
    process = LimitProcess(parameters=2, draws=50, levels=levels)
    far = stats.t.ppf(1 - 0.05 * 0.8, 799)
    spare = np.array([0.12, *[0.15] * 3, *[0.06] * 2]) / errors(800, levels) - far
    sizes = np.column_stack([bias, *(gaps[level] for level in (*WIDTHS, *levels))])
    wanted = np.mean((sizes <= spare).all(axis=1)) ** 2
    assert 0.2 < wanted < 0.95
    assert process.pass_probability(800, TOLERANCE) == pytest.approx(wanted, abs=0.01)
    far = stats.t.ppf(1 - 0.05 * 0.8, 299)
    spare = 0.1 / errors(300, LEVELS)[4:] - far
    wanted = np.mean((np.column_stack([gaps[level] for level in LEVELS]) <= spare).all(axis=1))
    assert 0.2 < wanted < 0.98
    assert process.curve_pass_probability(300, 0.1) == pytest.approx(wanted, abs=0.01)


def test_of_parameters_of_different_shapes_each_has_its_own_chance_and_the_worst_is_stated():
    """By the same normal numbers: parameter by parameter, then together."""
    levels = (0.3, 0.6)
    bias, gaps = simulated(levels)
    sizes = np.column_stack([bias, *(gaps[level] for level in (*WIDTHS, *levels))])
    spreads = ((1.0, 1.1, 1.3, 2.5), (2.2, 0.7, 0.8, 0.9))
    process = LimitProcess(parameters=2, draws=50, levels=levels, spreads=spreads)
    error = np.array([[*(np.array(row) / np.sqrt(2500)), *errors(2500, levels)[4:]] for row in spreads])
    np.testing.assert_allclose(process.standard_errors(2500), error)
    far = stats.t.ppf(1 - 0.05 * 0.8, 2499)
    spare = np.array([0.12, *[0.15] * 3, *[0.06] * 2]) / error - far
    each = [np.mean((sizes <= row).all(axis=1)) for row in spare]
    assert abs(each[0] - each[1]) > 0.05
    assert 0.05 < each[0] * each[1] < 0.9
    assert process.pass_probability(2500, TOLERANCE) == pytest.approx(each[0] * each[1], abs=0.01)
    critical = process.critical(2500, 0.1)
    reach = critical + stats.norm.ppf(0.8)
    # Each width by the level that tells it best, then the parameter of which it is told worst.
    assert process.smallest_detectable(2500, TOLERANCE, error_budget=0.1, power=0.8) == pytest.approx({
        "bias": 0.12 + reach * 2.2 / np.sqrt(2500), "log_width": 0.15 + reach * 1.1 / np.sqrt(2500),
        "coverage": 0.06 + reach * error[:, 4:].max(),
    })  # fmt: skip
    hidden = hidden_by(50)
    found = process.fail_probability(2500, TOLERANCE, error_budget=0.1)
    for name, edge, spread in (("bias", 0.12, 2.2), ("log_width", 0.15, 1.1)):
        wanted = stats.norm.cdf((1 - 2 * hidden[name]) * edge / spread * np.sqrt(2500) - critical)
        assert found[name] == pytest.approx(wanted)
