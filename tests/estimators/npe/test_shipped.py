from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sbi")

from gaugeblock.estimators.npe import load, reference_model_path
from gaugeblock.validate.joint.importance import kish_fraction, log_weights

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "undertrained-model"


@pytest.mark.parametrize("folder", [reference_model_path(), EXAMPLE], ids=["reference", "undertrained"])
def test_the_flows_that_ship_load_and_say_how_they_were_made(folder):
    flow = load(folder)
    assert flow.data_shape == (102,)
    assert flow.record["command"].startswith("gaugeblock train examples/train-")
    draws = flow.sample(np.full((2, 102), 10), 5, np.random.default_rng(1))
    assert flow.prior.contains(draws).all()


def test_the_reference_flow_is_worth_nine_draws_in_ten(xray_data):
    # Median ESS 0.906 at 200 trials x 500 draws; of 60 trials it has a standard error of 0.01.
    # The seed is fixed; with others a flow as good as this one fails once in a thousand.
    from gaugeblock.simulators.xray import reference

    simulator, rng = reference("epic-pn", "medium"), np.random.default_rng(12)
    flow = load("shipped:epic-pn-medium", simulator)
    x = simulator.simulate(simulator.prior.sample(60, rng), rng)
    draws, log_q = flow.sample_and_log_prob(x, 300, rng)
    likelihood = simulator.log_likelihood(draws, x[:, None])
    weight = log_weights(log_q, likelihood, simulator.prior.log_prob(draws))
    assert np.median(kish_fraction(weight)) > 0.87
