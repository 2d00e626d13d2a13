"""On a real response: nested sampling and a re-weighted flow agree on an extended model."""

import numpy as np
import pytest

from gaugeblock.discovery.extend import refit
from gaugeblock.simulators import Effect, Uniform, build_simulator

for library in ("jaxspec", "ultranest", "sbi"):
    pytest.importorskip(library)

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("xray_data")]


@pytest.fixture(scope="module")
def simulator():
    return build_simulator("xray", response="epic-pn", level="medium")


def spectrum(simulator, effect):
    theta = simulator.prior.from_unit_cube([[0.5, 0.5, 0.6, 0.5, 0.6]])
    return simulator.with_effect(effect).simulate(theta, np.random.default_rng(0))


def test_nested_sampling_and_importance_agree_on_an_extended_spectrum(simulator):
    from gaugeblock.estimators.npe import load

    place = {"energy": 6.4, "sigma": 0.05}
    line = Effect("emission_line", {**place, "norm": Uniform(0.0, 1e-3)})
    x = spectrum(simulator, Effect("emission_line", {**place, "norm": 3e-4}))

    nested = refit(
        simulator, line, x, by="nested_sampling", rng=np.random.default_rng(1), draws=4000, live_points=200
    )
    flow = load("shipped:epic-pn-medium", simulator)
    weighted = refit(simulator, line, x, by="importance", rng=np.random.default_rng(3), estimator=flow)
    one, other = nested.draws[0], weighted.draws[0]
    # Each is worth at least 250 independent draws: 4.5 standard errors, thirty numbers.
    level = np.array([0.05, 0.25, 0.5, 0.75, 0.95])[:, None]
    below = np.mean(other < np.quantile(one, level[:, 0], axis=0)[:, None], axis=1)
    assert np.all(np.abs(below - level) < 4.5 * np.sqrt(level * (1 - level) * 2 / 250))
    error = np.hypot(nested.log_evidence_error, weighted.log_evidence_error)
    assert abs(nested.log_evidence - weighted.log_evidence)[0] < 4.0 * error[0]
