"""BayesFlow 2: a workflow of its documentation, whose approximator is saved as .keras.

python bayesflow_flow.py [--simulations N] [--noise SD] [--out model.keras]

The model is that of sbi_npe.py.
"""

import argparse
import os

# Keras asks for its backend when it is imported; torch and tensorflow do as well.
os.environ.setdefault("KERAS_BACKEND", "jax")

import bayesflow as bf
import keras
import numpy as np

parser = argparse.ArgumentParser()
parser.add_argument("--simulations", type=int, default=10_000)
parser.add_argument("--noise", type=float, default=0.5)
parser.add_argument("--epochs", type=int, default=15)
parser.add_argument("--seed", type=int, default=1)
parser.add_argument("--out", default="model.keras")
arguments = parser.parse_args()

keras.utils.set_random_seed(arguments.seed)
rng = np.random.default_rng(arguments.seed)
design = np.stack([np.ones(8), np.linspace(-1.0, 1.0, 8)], axis=1)


def prior():
    """Intercept and slope."""
    return {"theta": rng.standard_normal(2)}


def likelihood(theta):
    """Eight points of the line, with noise."""
    return {"x": design @ theta + arguments.noise * rng.standard_normal(8)}


simulator = bf.make_simulator([prior, likelihood])
workflow = bf.BasicWorkflow(
    simulator=simulator,
    inference_network=bf.networks.CouplingFlow(depth=2),
    inference_variables=["theta"],
    inference_conditions=["x"],
    initial_learning_rate=2e-3,
)
workflow.fit_offline(
    simulator.sample(arguments.simulations), epochs=arguments.epochs, batch_size=128, verbose=0
)
# Since 2.1 a workflow calls it its estimator.
saved = workflow.approximator if hasattr(workflow, "approximator") else workflow.estimator
saved.save(arguments.out)
