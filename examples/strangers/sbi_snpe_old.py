"""The same with sbi 0.22, whose pickles no later release reads; see sbi_npe.py for the model.

python sbi_snpe_old.py [--simulations N] [--noise SD] [--out posterior.pkl]
"""

import argparse
import pickle

import numpy as np
import torch
from sbi.inference import SNPE
from torch.distributions import MultivariateNormal


def simulate(number, noise, rng):
    """Parameters from the prior, and data: intercept and slope at eight points in [-1, 1]."""
    theta = rng.standard_normal((number, 2))
    design = np.stack([np.ones(8), np.linspace(-1.0, 1.0, 8)], axis=1)
    return theta, theta @ design.T + noise * rng.standard_normal((number, 8))


parser = argparse.ArgumentParser()
parser.add_argument("--simulations", type=int, default=20_000)
parser.add_argument("--noise", type=float, default=0.5)
parser.add_argument("--seed", type=int, default=1)
parser.add_argument("--out", default="posterior.pkl")
arguments = parser.parse_args()

torch.manual_seed(arguments.seed)
theta, x = simulate(arguments.simulations, arguments.noise, np.random.default_rng(arguments.seed))
theta, x = torch.as_tensor(theta, dtype=torch.float32), torch.as_tensor(x, dtype=torch.float32)

prior = MultivariateNormal(torch.zeros(2), torch.eye(2))
inference = SNPE(prior=prior, density_estimator="mdn")
density_estimator = inference.append_simulations(theta, x).train(training_batch_size=1000, learning_rate=2e-3)
posterior = inference.build_posterior(density_estimator)

with open(arguments.out, "wb") as handle:
    pickle.dump(posterior, handle)
