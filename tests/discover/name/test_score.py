"""Score tests: standard normal without the effect, exact where theory is, blind where data are."""

import numpy as np
import pytest
from scipy.stats import kstest

from gaugeblock.discovery.engine import beyond
from gaugeblock.discovery.fitting import Fit, fit
from gaugeblock.discovery.library import Candidates
from gaugeblock.discovery.name.null import largest_null
from gaugeblock.discovery.name.score import allowed, scores
from gaugeblock.discovery.name.shapes import templates
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.effects import Effect


@pytest.fixture(scope="module")
def quiet(power_law):
    """Four hundred sources without any effect, fitted, with their templates and scores."""
    simulator, rng = power_law(), np.random.default_rng(4)
    theta = np.stack([np.exp(rng.uniform(6.5, 9.0, 400)), rng.uniform(0.5, 2.5, 400)], axis=1)
    sources = Sources.of(simulator, simulator.simulate(theta, rng))
    fitted = fit(simulator, sources.counts, start=theta)
    found = templates(Candidates.of(simulator, theta), sources, fitted)
    return sources, fitted, found, scores(sources.counts, fitted, found.values)


def test_z_is_standard_normal_after_the_fit(quiet):
    # 108 templates, 400 sources: the mean of z has a standard error of 0.05, its sd one of 0.035.
    z = quiet[3].z
    assert np.abs(z.mean(axis=0)).max() < 4 * 0.05
    assert np.abs(z.std(axis=0) - 1.0).max() < 4.5 * 0.035


def test_without_the_projection_it_would_not_be(quiet):
    sources, fitted, found, _ = quiet
    root = np.sqrt(fitted.expected)[:, None]
    shape = found.values / root
    plain = (shape * ((sources.counts - fitted.expected)[:, None] / root)).sum(-1) / np.linalg.norm(
        shape, axis=-1
    )
    assert plain.std(axis=0).min() < 0.8


def test_p_global_is_uniform_without_an_effect(quiet):
    _, fitted, found, tested = quiet
    p = [
        beyond(
            largest_null(
                fitted.expected[i], tested.shape[i], tested.skew[i], found.sign, replicates=199,
                rng=np.random.default_rng(1000 + i),
            ),
            allowed(tested.z[i], found.sign).max(),
        )
        for i in range(200)
    ]  # fmt: skip
    assert kstest(p, "uniform").pvalue > 1e-3
    assert min(p) >= 1 / 200


def test_information_is_the_projected_fisher_information(power_law):
    # Against the inverse of the whole Fisher matrix: its element for the amplitude is 1 / information.
    simulator = power_law()
    theta = np.array([[5000.0, 1.2]])
    sources = Sources.of(simulator, np.round(simulator.expected(theta)))
    fitted = fit(simulator, sources.counts)
    found = templates(Candidates.of(simulator, theta), sources, fitted)
    tested = scores(sources.counts, fitted, found.values)
    for t in (0, 40, 100):
        columns = np.concatenate([fitted.jacobian[0], found.values[0, t][:, None]], axis=1)
        fisher = columns.T @ (columns / fitted.expected[0][:, None])
        assert tested.information[0, t] == pytest.approx(1.0 / np.linalg.inv(fisher)[-1, -1], rel=1e-6)
        assert tested.smallest_detectable()[0, t] == pytest.approx(5 * np.sqrt(np.linalg.inv(fisher)[-1, -1]))
    assert np.all((tested.kept > 0) & (tested.kept <= 1))


def test_parameters_with_a_prior_take_only_what_data_tell_of_them():
    """Two sources by matrices: ``1 - A (A'A + L)^-1 A'``, cumulants of the projected template, their z."""
    rng = np.random.default_rng(8)
    mean, slope = rng.uniform(2.0, 9.0, (2, 12)), rng.normal(size=(2, 12, 2))
    precision, values = np.array([0.0, 3.0]), rng.normal(size=(2, 3, 12)) * [[[1.0], [-2.0], [0.0]]]
    fitted = Fit(np.zeros((2, 2)), mean, slope, precision, *np.zeros((2, 2)), np.ones(2, dtype=bool))
    counts = rng.poisson(mean)
    found = scores(counts, fitted, values)
    for i in range(2):
        root = np.sqrt(mean[i])
        own = slope[i] / root[:, None]
        left = np.eye(12) - own @ np.linalg.solve(own.T @ own + np.diag(precision), own.T)
        for t in range(2):
            whole = values[i, t] / root
            information = whole @ left @ whole
            unit = left @ whole / np.sqrt(information)
            z, skew = unit @ ((counts[i] - mean[i]) / root), (unit**3 / root).sum()
            assert found.information[i, t] == pytest.approx(information)
            assert found.kept[i, t] == pytest.approx(information / (whole @ whole))
            assert found.amplitude[i, t] == pytest.approx(z / np.sqrt(information))
            assert found.skew[i, t] == pytest.approx(skew)
            assert found.smallest_detectable(3.0)[i, t] == pytest.approx(3.0 / np.sqrt(information))
            np.testing.assert_allclose(found.shape[i, t], unit, atol=1e-9)
            # A Poisson variable of this skewness: of 1 / skew^2 counts, as far off as z in their root.
            u = max(z * skew, -1.0)
            deviance = 2.0 * ((1.0 + u) * np.log1p(u) - u) if u > -1.0 else 2.0
            assert found.z[i, t] == pytest.approx(np.sign(z) * np.sqrt(deviance) / abs(skew), rel=1e-4)
    # What nothing shows has no z, and would have to be infinite to be seen.
    assert not found.z[:, 2].any()
    assert not found.kept[:, 2].any()
    assert not found.shape[:, 2].any()
    assert (found.smallest_detectable()[:, 2] > 1e100).all()


def test_a_template_inside_the_nuisances_has_no_z(power_law):
    simulator = power_law()
    theta = np.array([[5000.0, 1.2]])
    sources = Sources.of(simulator, simulator.simulate(theta, np.random.default_rng(5)))
    fitted = fit(simulator, sources.counts)
    tested = scores(sources.counts, fitted, fitted.expected[:, None] * 0.1)
    assert tested.z[0, 0] == 0.0
    assert tested.kept[0, 0] == 0.0


def test_the_amplitude_is_read_off(power_law):
    plain, rng = power_law(), np.random.default_rng(6)
    hidden = plain.with_effect(Effect("dip", {"energy": 2.0, "depth": -0.1}))
    theta = np.repeat([[20_000.0, 1.5]], 200, axis=0)
    sources = Sources.of(plain, hidden.simulate(theta, rng))
    fitted = fit(plain, sources.counts, start=theta)
    entry = plain.effect_library(theta)["dip"]
    near = int(np.argmin(np.abs(np.asarray(entry.scanned["energy"]) - 2.0)))
    found = templates(Candidates.of(plain, theta, only=("dip",)), sources, fitted)
    tested = scores(sources.counts, fitted, found.values)
    # The nearest scanned energy is not 2 keV exactly, so a little of the depth is lost, never gained.
    mean = tested.amplitude[:, near].mean()
    assert -0.105 < mean < -0.085


def test_one_sided_effects_count_one_side():
    z = np.array([[-3.0, 2.0, -4.0]])
    assert allowed(z, np.array([1, 0, -1])).tolist() == [[-3.0, 2.0, 4.0]]
