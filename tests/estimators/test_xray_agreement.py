"""On a real response, with medium counts, the two exact families find one posterior."""

import numpy as np
import pytest

from gaugeblock.estimators import build_estimator
from gaugeblock.simulators import build_simulator

for library in ("jaxspec", "ultranest", "numpyro"):
    pytest.importorskip(library)

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("xray_data")]


def test_nested_sampling_and_nuts_agree_on_a_medium_epic_pn_spectrum():
    simulator = build_simulator("xray", response="epic-pn", level="medium")
    theta = simulator.prior.from_unit_cube([[0.5, 0.5, 0.6, 0.5, 0.6]])
    x = simulator.simulate(theta, np.random.default_rng(0))
    nested = build_estimator("nested_sampling", simulator).run(x[0], np.random.default_rng(3))
    chains = build_estimator("nuts", simulator, warmup=400, thinning=4).run(
        np.repeat(x, 4, axis=0), 150, np.random.default_rng(4)
    )
    assert chains.divergences.sum() < 0.02 * 4 * 150 * 4

    one = nested.resample(4000, np.random.default_rng(5))
    other = chains.draws.reshape(-1, 5)
    # By probabilities, not moments: towards a bound of the prior the tails are so heavy that two
    # exact samples differ in sd. Both are worth at least 300 independent draws: 4.5 standard errors,
    # twenty-five numbers, fewer than 1 seed in 5,000.
    level = np.array([0.05, 0.25, 0.5, 0.75, 0.95])[:, None]
    below = np.mean(other < np.quantile(one, level[:, 0], axis=0)[:, None], axis=1)
    assert np.all(np.abs(below - level) < 4.5 * np.sqrt(level * (1 - level) * 2 / 300))
    rank = np.argsort(np.argsort(other, axis=0), axis=0), np.argsort(np.argsort(one, axis=0), axis=0)
    np.testing.assert_allclose(np.corrcoef(rank[0].T), np.corrcoef(rank[1].T), atol=0.25)

    # What UltraNest recorded is the simulator's own likelihood at its own points.
    again = simulator.log_likelihood(nested.theta, x[0])
    np.testing.assert_allclose(nested.log_likelihood, again, rtol=1e-9)
