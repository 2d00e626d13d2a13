"""LAMPE's NPE, trained by the loop of its tutorial; its state dict is saved.

    python lampe_npe.py [--noise SD] [--epochs N] [--out npe.pt]

`build` makes the estimator as it is before training: it is the builder that an audit needs beside the file.
The model is that of sbi_npe.py.
"""

import argparse
from itertools import islice

import numpy as np
import torch
from lampe.data import JointLoader
from lampe.inference import NPE, NPELoss
from lampe.utils import GDStep


def build(options):
    """Two parameters given eight data."""
    return NPE(2, 8, transforms=options.get("transforms", 2), hidden_features=[64, 64])


def main():
    """Train and save."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--noise", type=float, default=0.5)
    parser.add_argument("--epochs", type=int, default=16)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", default="npe.pt")
    arguments = parser.parse_args()

    torch.manual_seed(arguments.seed)
    design = np.stack([np.ones(8), np.linspace(-1.0, 1.0, 8)], axis=1)
    matrix = torch.as_tensor(design.T, dtype=torch.float32)
    prior = torch.distributions.MultivariateNormal(torch.zeros(2), torch.eye(2))

    def simulator(theta):
        mean = theta @ matrix
        return mean + arguments.noise * torch.randn_like(mean)

    loader = JointLoader(prior, simulator, batch_size=256, vectorized=True)
    estimator = build({})
    loss = NPELoss(estimator)
    optimizer = torch.optim.AdamW(estimator.parameters(), lr=2e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, arguments.epochs)
    step = GDStep(optimizer, clip=1.0)
    estimator.train()
    for _ in range(arguments.epochs):
        for theta, x in islice(loader, 64):
            step(loss(theta, x))
        schedule.step()
    torch.save(estimator.state_dict(), arguments.out)


if __name__ == "__main__":
    main()
