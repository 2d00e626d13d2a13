"""A flow of zuko, trained by the loop of its documentation; its state dict is saved.

    python zuko_flow.py [--simulations N] [--noise SD] [--out flow.pt]

`build` makes the flow as it is before training: it is the builder that an audit needs beside the file. The
model is that of sbi_npe.py.
"""

import argparse

import numpy as np
import torch
import zuko


def build(options):
    """Two parameters given eight data."""
    return zuko.flows.NSF(2, context=8, transforms=options.get("transforms", 2), hidden_features=(64, 64))


def simulate(number, noise, rng):
    """Parameters from the prior, and data: intercept and slope at eight points in [-1, 1]."""
    theta = rng.standard_normal((number, 2))
    design = np.stack([np.ones(8), np.linspace(-1.0, 1.0, 8)], axis=1)
    return theta, theta @ design.T + noise * rng.standard_normal((number, 8))


def main():
    """Train and save."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--simulations", type=int, default=20_000)
    parser.add_argument("--noise", type=float, default=0.5)
    parser.add_argument("--epochs", type=int, default=15)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", default="flow.pt")
    arguments = parser.parse_args()

    torch.manual_seed(arguments.seed)
    theta, x = simulate(arguments.simulations, arguments.noise, np.random.default_rng(arguments.seed))
    theta, x = torch.as_tensor(theta, dtype=torch.float32), torch.as_tensor(x, dtype=torch.float32)
    trainset = torch.utils.data.TensorDataset(theta, x)
    trainloader = torch.utils.data.DataLoader(trainset, batch_size=256, shuffle=True)

    flow = build({})
    optimizer = torch.optim.Adam(flow.parameters(), lr=2e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, arguments.epochs)
    for _ in range(arguments.epochs):
        for some, their in trainloader:
            loss = -flow(their).log_prob(some).mean()
            loss.backward()
            optimizer.step()
            optimizer.zero_grad()
        schedule.step()
    torch.save(flow.state_dict(), arguments.out)


if __name__ == "__main__":
    main()
