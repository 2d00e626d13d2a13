"""A flow with the effect as nuisance: through `retrain`, and through what `gaugeblock train` reads."""

import json
from pathlib import Path

import numpy as np
import pytest

from gaugeblock.discovery.extend import extended, refit, retrain
from gaugeblock.simulators import build_simulator

pytest.importorskip("sbi")

from gaugeblock.estimators.npe import TrainingConfig, load, run_training

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "gain-marginalised.toml"
TINY = {
    "training.simulations": 400, "training.steps": 10, "training.batch": 100, "network.embedding": [16],
    "network.embedding_output": 4, "network.transforms": 1, "network.hidden": [16], "network.bins": 4,
}  # fmt: skip
CONFIG = {
    "simulator": {"name": "linear_gaussian"},
    "network": {"embedding": [64], "embedding_output": 8, "transforms": 2, "hidden": [32, 32], "bins": 6},
    "training": {"simulations": 20_000, "steps": 800, "batch": 256, "learning_rate": 5e-3, "seed": 2},
}


@pytest.fixture(scope="module")
def flow(line, parabola, tmp_path_factory):
    config = TrainingConfig.build(CONFIG)
    return retrain(line, parabola, config, folder=tmp_path_factory.mktemp("flow") / "model")


def test_it_is_marginal_over_the_effect(flow, line, parabola, bent, data):
    found = refit(line, parabola, data, by="flow", rng=np.random.default_rng(1), estimator=flow)
    assert found.names == bent.prior.names
    exact = bent.posterior_sample(data, 20_000, np.random.default_rng(2))
    sd = exact.std(axis=1)
    # Trained for seconds: means to half a standard deviation, widths to a quarter.
    assert np.all(np.abs(found.draws.mean(axis=1) - exact.mean(axis=1)) < 0.5 * sd)
    np.testing.assert_allclose(found.draws.std(axis=1) / sd, 1.0, atol=0.25)
    # Without the bend the level would be known to 0.175, half as well, and lie many of these away.
    assert np.all(found.draws[..., 0].std(axis=1) > 0.2)
    assert np.all(np.isfinite(found.diagnostics["khat"]))


def test_its_draws_refine_to_the_exact_posterior(flow, bent, data):
    from gaugeblock.estimators import build_estimator

    refined = build_estimator("importance_refined", bent, base=flow, evidence_draws=8000)
    evidence, error = refined.log_evidence(data, np.random.default_rng(3))
    assert np.all(error < 0.2)
    assert np.all(np.abs(evidence - bent.log_evidence(data)) < 4.5 * error)


@pytest.mark.usefixtures("xray_data")
def test_a_configuration_with_effects_trains_the_extended_simulator(tmp_path):
    folder = run_training(EXAMPLE, out=tmp_path / "model", overrides=TINY)
    described = json.loads((folder / "model.json").read_text())
    assert described["parameters"][-1] == "gain_slope_1.slope"
    assert described["prior"]["gain_slope_1.slope"] == {"distribution": "uniform", "low": 0.95, "high": 1.05}
    effect = described["simulator"]["effects"][0]
    assert effect["name"] == "gain_slope"
    # The same simulator as composition makes: the flow loads for it, and draws within its prior.
    from gaugeblock.simulators import Effect, Uniform

    simulator = extended(
        build_simulator("xray", response="epic-pn", level="medium"),
        Effect("gain_slope", {"slope": Uniform(0.95, 1.05)}),
    )
    x = simulator.simulate(simulator.prior.center[None], np.random.default_rng(1))
    draws = load(folder, simulator).sample(x, 50, np.random.default_rng(2))
    assert draws.shape == (1, 50, 6)
    assert np.all(simulator.prior.contains(draws))
    assert draws[..., -1].std() > 0
