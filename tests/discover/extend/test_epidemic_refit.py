"""Without X-rays: nested sampling and NUTS find one posterior of an epidemic with an effect."""

import numpy as np
import pytest

from gaugeblock.discovery.extend import extended, refit

pytest.importorskip("ultranest")
pytest.importorskip("numpyro")

pytestmark = pytest.mark.slow


def test_nested_sampling_and_nuts_agree_on_an_extended_epidemic(epidemic):
    entry = epidemic.effect_library(epidemic.prior.center[None])["imported_cases"]
    simulator = extended(epidemic, entry)
    x = simulator.simulate([[0.5, 0.2, 6.0]], np.random.default_rng(0))
    nested = refit(epidemic, entry, x, by="nested_sampling", rng=np.random.default_rng(1), draws=4000)
    chains = refit(epidemic, entry, x, by="nuts", rng=np.random.default_rng(2), draws=1600)
    assert np.all(chains.diagnostics["rhat"] < 1.05)
    # Each is worth at least 300 independent draws: 4.5 standard errors, fifteen numbers.
    level = np.array([0.05, 0.25, 0.5, 0.75, 0.95])[:, None]
    below = np.mean(chains.draws[0] < np.quantile(nested.draws[0], level[:, 0], axis=0)[:, None], axis=1)
    assert np.all(np.abs(below - level) < 4.5 * np.sqrt(level * (1 - level) * 2 / 300))
