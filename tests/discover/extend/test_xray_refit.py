"""On a real response: the exact families agree on an extended model, and its evidence is quick enough."""

import numpy as np
import pytest

from gaugeblock.discover.confirm.evidence import delta_log_evidence
from gaugeblock.discover.extend import refit
from gaugeblock.simulators import Effect, Uniform, build_simulator
from gaugeblock.simulators.library import LibraryEffect

for library in ("jaxspec", "ultranest", "numpyro"):
    pytest.importorskip(library)

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("xray_data")]

OFFSET = LibraryEffect(
    name="gain_offset", parameters={"offset": Uniform(-0.1, 0.1)}, amplitude="offset", neutral=0.0, step=0.01,
    cause="", typical="",
)  # fmt: skip


@pytest.fixture(scope="module")
def simulator():
    return build_simulator("xray", response="epic-pn", level="medium")


def spectrum(simulator, effect):
    theta = simulator.prior.from_unit_cube([[0.5, 0.5, 0.6, 0.5, 0.6]])
    return simulator.with_effect(effect).simulate(theta, np.random.default_rng(0))


def test_nested_sampling_nuts_and_importance_agree_on_an_extended_spectrum(simulator):
    from gaugeblock.estimators.npe import load

    place = {"energy": 6.4, "sigma": 0.05}
    line = Effect("emission_line", {**place, "norm": Uniform(0.0, 1e-3)})
    x = spectrum(simulator, Effect("emission_line", {**place, "norm": 3e-4}))

    nested = refit(
        simulator, line, x, by="nested_sampling", rng=np.random.default_rng(1), draws=4000, live_points=200
    )
    chains = refit(
        simulator, line, x, by="nuts", rng=np.random.default_rng(2), draws=800, warmup=300, thinning=2
    )
    flow = load("shipped:epic-pn-medium", simulator)
    weighted = refit(simulator, line, x, by="importance", rng=np.random.default_rng(3), estimator=flow)
    one, others = nested.draws[0], (chains.draws[0], weighted.draws[0])
    # Each is worth at least 250 independent draws: 4.5 standard errors, sixty numbers.
    level = np.array([0.05, 0.25, 0.5, 0.75, 0.95])[:, None]
    for other in others:
        below = np.mean(other < np.quantile(one, level[:, 0], axis=0)[:, None], axis=1)
        np.testing.assert_array_less(np.abs(below - level), 4.5 * np.sqrt(level * (1 - level) * 2 / 250))
    error = np.hypot(nested.log_evidence_error, weighted.log_evidence_error)
    assert abs(nested.log_evidence - weighted.log_evidence)[0] < 4.0 * error[0]


def test_delta_log_evidence_of_a_spectrum(simulator):
    x = spectrum(simulator, Effect("gain_offset", {"offset": 0.04}))
    delta = delta_log_evidence(simulator, OFFSET, x[0], rng=np.random.default_rng(4), live_points=100)
    assert delta.error < 0.6
    curve = delta.sensitivity
    # Far inside its prior, or not seen at all: ten times the width costs log 10 beyond the first.
    wide = ~curve.lower_bound & (curve.factors >= 1.0)
    np.testing.assert_allclose(curve.value[wide] + np.log(curve.factors[wide]), delta.value, atol=1e-6)
