"""A posterior of sbi (0.23 or later), trained and pickled as its documentation shows it.

    python sbi_npe.py                                    a good one: its audit is a PASS
    python sbi_npe.py --simulations 200 --out few.pkl    too few simulations: FAIL
    python sbi_npe.py --noise 0.3 --out noise.pkl        a simulator with the wrong noise: FAIL

The model: a straight line through eight points, theta standard normal, noise of sd 0.5. It is what gaugeblock
calls linear_gaussian with two parameters; nothing of gaugeblock is used here.
"""

import argparse
import pickle

import numpy as np
import torch
from sbi.inference import NPE
from torch.distributions import MultivariateNormal


def simulate(number, noise, rng):
    """Parameters from the prior, and data: intercept and slope at eight points in [-1, 1]."""
    theta = rng.standard_normal((number, 2))
    design = np.stack([np.ones(8), np.linspace(-1.0, 1.0, 8)], axis=1)
    return theta, theta @ design.T + noise * rng.standard_normal((number, 8))


parser = argparse.ArgumentParser()
parser.add_argument("--simulations", type=int, default=20_000)
parser.add_argument("--noise", type=float, default=0.5)
parser.add_argument("--density-estimator", default="mdn", help="mdn, maf, nsf, ...")
parser.add_argument("--save", choices=["pickle", "torch", "estimator"], default="pickle")
parser.add_argument("--seed", type=int, default=1)
parser.add_argument("--out", default="posterior.pkl")
arguments = parser.parse_args()

torch.manual_seed(arguments.seed)
theta, x = simulate(arguments.simulations, arguments.noise, np.random.default_rng(arguments.seed))
theta, x = torch.as_tensor(theta, dtype=torch.float32), torch.as_tensor(x, dtype=torch.float32)

prior = MultivariateNormal(torch.zeros(2), torch.eye(2))
inference = NPE(prior=prior, density_estimator=arguments.density_estimator)
density_estimator = inference.append_simulations(theta, x).train(training_batch_size=1000, learning_rate=2e-3)
posterior = inference.build_posterior(density_estimator)

if arguments.save == "pickle":
    with open(arguments.out, "wb") as handle:
        pickle.dump(posterior, handle)
elif arguments.save == "torch":
    torch.save(posterior, arguments.out)
else:
    torch.save(density_estimator, arguments.out)
