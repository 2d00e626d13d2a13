"""Published detectors of misspecification, written from their papers, each a number that is larger the odder.

Both are given thresholds on simulations, so that they raise as many false alarms as a check does.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
from scipy import stats

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import require

SCALES = (0.2, 0.5, 0.9, 1.3)
STEPS, BATCH = 1200, 64


def multiquadric(a: Any, b: Any, scales: tuple[float, ...] = SCALES) -> Any:
    """Sum of inverse multiquadric kernels of all pairs."""
    square = ((a[:, None] - b[None]) ** 2).sum(-1)
    width = a.shape[1]
    return sum(2 * width * s / (2 * width * s + square) for s in scales)


def schmitt(
    simulate: Callable[[int, np.random.Generator], tuple[Array, Array]],
    summaries: int,
    rng: np.random.Generator,
) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """Schmitt et al. (2023): a summary network that is trained to give N(0, 1), and the MMD from that.

    ``simulate(n, rng)`` gives parameters and exchangeable data ``(n, reading, channel)``. A deep set is
    trained with a Gaussian posterior and the MMD of its summaries from a standard normal, weight 1. Returns
    the detector of a single data set and the summaries behind it.
    """
    torch = require("torch", "sbi")
    torch.manual_seed(int(rng.integers(2**31)))
    theta, x = simulate(2, rng)
    parameters, channels = theta.shape[1], x.shape[2]
    inner = torch.nn.Sequential(
        torch.nn.Linear(channels, 32), torch.nn.SiLU(), torch.nn.Linear(32, 32), torch.nn.SiLU()
    )
    outer = torch.nn.Sequential(torch.nn.Linear(32, 32), torch.nn.SiLU(), torch.nn.Linear(32, summaries))
    head = torch.nn.Sequential(
        torch.nn.Linear(summaries, 32), torch.nn.SiLU(), torch.nn.Linear(32, 2 * parameters)
    )
    weights = [*inner.parameters(), *outer.parameters(), *head.parameters()]
    optimiser = torch.optim.Adam(weights, lr=2e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, STEPS)

    def summarised(data: Any) -> Any:
        return outer(inner(data).mean(dim=1))

    for _ in range(STEPS):
        theta, x = (torch.as_tensor(part, dtype=torch.float32) for part in simulate(BATCH, rng))
        s = summarised(x)
        mean, log_sd = head(s).chunk(2, dim=1)
        loss = (log_sd + 0.5 * ((theta - mean) / log_sd.exp()) ** 2).mean()
        z = torch.randn_like(s)
        loss = loss + multiquadric(s, s).mean() + multiquadric(z, z).mean() - 2 * multiquadric(s, z).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
    standard = np.random.default_rng(0).standard_normal((2000, summaries))

    def embed(data: Array) -> Array:
        with torch.no_grad():
            return np.asarray(summarised(torch.as_tensor(np.asarray(data), dtype=torch.float32)), dtype=float)

    # Of one data set the MMD is a constant less twice the mean kernel.
    return lambda data: -np.asarray(multiquadric(embed(data), standard).mean(axis=1)), embed


SPIKE, SLAB, DRAWS, COMPONENTS = 0.01, 0.25, 64, 8


def ward(simulated: Array, rng: np.random.Generator) -> Callable[[Array], Array]:
    """Ward et al. (2022): the largest posterior probability that a summary is misspecified.

    Error model y = x + e, e of each summary a spike N(0, 0.01^2) or a slab Cauchy(0, 0.25), half each, in
    units of the simulated summaries' sd. Their flow for x is a mixture of Gaussians here, so that the sum
    over all spikes and slabs needs no chain: exact but for draws of what is under a slab.
    """
    mixture = require("sklearn.mixture", "classifiers")
    centre, scale = simulated.mean(axis=0), simulated.std(axis=0)
    fitted = mixture.GaussianMixture(COMPONENTS, random_state=int(rng.integers(2**31)), reg_covar=1e-5)
    fitted.fit((simulated - centre) / scale)
    size = simulated.shape[1]
    normal = rng.standard_normal((DRAWS, size))

    def log_evidence(y: Array, slab: Array) -> Array:
        found = []
        spike = ~slab
        for weight, mean, covariance in zip(fitted.weights_, fitted.means_, fitted.covariances_, strict=True):
            total = np.full(len(y), np.log(weight))
            gain = np.zeros((int(slab.sum()), int(spike.sum())))
            within = covariance[np.ix_(slab, slab)]
            if spike.any():
                block = covariance[np.ix_(spike, spike)] + SPIKE**2 * np.eye(int(spike.sum()))
                total = total + stats.multivariate_normal(mean[spike], block).logpdf(y[:, spike])
                gain = np.linalg.solve(block, covariance[np.ix_(spike, slab)]).T
                within = within - gain @ covariance[np.ix_(spike, slab)]
            if slab.any():
                root = np.linalg.cholesky(within + 1e-9 * np.eye(len(within)))
                middle = mean[slab] + (y[:, spike] - mean[spike]) @ gain.T
                x = middle[:, None] + normal[:, slab] @ root.T
                density = stats.cauchy(scale=SLAB).pdf(y[:, None, slab] - x).prod(axis=2).mean(axis=1)
                total = total + np.log(density + 1e-300)
            found.append(total)
        return np.asarray(np.logaddexp.reduce(found, axis=0))

    def detector(summaries: Array) -> Array:
        y = (summaries - centre) / scale
        cases = np.array(list(product([False, True], repeat=size)))
        evidence = np.stack([log_evidence(y, slab) for slab in cases])
        evidence -= evidence.max(axis=0)
        probability = np.exp(evidence) / np.exp(evidence).sum(axis=0)
        # In logs, or all that is certain ties.
        odds = [
            np.log(probability[cases[:, j]].sum(axis=0) + 1e-300)
            - np.log(probability[~cases[:, j]].sum(axis=0) + 1e-300)
            for j in range(size)
        ]
        return np.asarray(np.max(odds, axis=0))

    return detector
