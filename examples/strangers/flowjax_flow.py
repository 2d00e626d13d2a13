"""A flow of flowjax, trained by its `fit_to_data`; its leaves are saved by equinox.

    python flowjax_flow.py [--simulations N] [--noise SD] [--out flow.eqx]

`build` makes the flow as it is before training: it is the builder that an audit needs beside the file. The
model is that of sbi_npe.py.
"""

import argparse

import equinox as eqx
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from flowjax.distributions import Normal
from flowjax.flows import masked_autoregressive_flow
from flowjax.train import fit_to_data


def build(options):
    """Two parameters given eight data."""
    return masked_autoregressive_flow(
        key=jr.key(0),
        base_dist=Normal(jnp.zeros(2)),
        cond_dim=8,
        flow_layers=options.get("layers", 2),
        nn_width=32,
    )


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
    parser.add_argument("--epochs", type=int, default=30)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", default="flow.eqx")
    arguments = parser.parse_args()

    theta, x = simulate(arguments.simulations, arguments.noise, np.random.default_rng(arguments.seed))
    flow, _ = fit_to_data(
        jr.key(arguments.seed),
        build({}),
        data=(jnp.asarray(theta), jnp.asarray(x)),
        learning_rate=1e-3,
        batch_size=256,
        max_epochs=arguments.epochs,
        show_progress=False,
    )
    eqx.tree_serialise_leaves(arguments.out, flow)


if __name__ == "__main__":
    main()
