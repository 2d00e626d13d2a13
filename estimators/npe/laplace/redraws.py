"""Other parameters for the same data: a bank whose rows have posterior draws beside their own parameters.

A row has one draw of its posterior, the parameters it was simulated from, and a network that sees it often
learns that one draw by heart. Where the likelihood is known there can be more: draws of a flow and the row's
own parameters, picked by their importance weights, are a posterior sample again (iterated sampling importance
resampling), so a pool of a few stands for the posterior of the row and not for one point of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from gaugeblock.core.atomic import atomic_path
from gaugeblock.estimators._rows import resample
from gaugeblock.estimators.npe.bank import Bank, Progress, stream
from gaugeblock.estimators.npe.coordinates import from_scores

ROWS = 1024
"""Rows that are weighed at once."""


@dataclass(frozen=True)
class RedrawnBank:
    """A bank, and for its first rows pools of scores ``(row, draw, parameter)`` with log weights.

    Rows beyond the pools, those held out, keep their own parameters.
    """

    bank: Bank
    pool: NDArray[np.float32]
    log_weight: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.bank)

    def pairs(
        self, rows: NDArray[np.int64] | slice, rng: np.random.Generator
    ) -> tuple[NDArray[np.float32], NDArray[Any]]:
        """Scores and data of rows: each pick of a pool is a new one."""
        own, data = self.bank.pairs(rows, rng)
        place = np.arange(len(self))[rows]
        pooled = np.flatnonzero(place < len(self.pool))
        if not len(pooled):
            return own, data
        place = place[pooled]
        picked = resample(self.log_weight[place], rng.random((len(place), 1)))[:, 0]
        scores = own.copy()
        scores[pooled] = self.pool[place, picked]
        return scores, data


def noisy(bank: Bank, start: int, number: int, seed: int) -> NDArray[np.float64]:
    """Data of the chunk that begins at `start`, with the one noise that it is compressed and weighed with."""
    rows = slice(start, min(start + number, len(bank)))
    return np.asarray(bank.observe(rows, stream(seed, "noise", start)), dtype=np.float64)


def redrawn(
    head: Any,
    bank: Bank,
    data: NDArray[np.float64],
    rows: slice,
    *,
    number: int,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Pools ``(row, 1 + number, parameter)`` of some rows, and their log weights.

    `bank` holds what the head reads, `data` the counts ``(row, channel)`` it was read off.

    References
    ----------
    Tjelmeland (2004), Using all Metropolis-Hastings proposals; Naesseth, Lindsten & Blei (2020), Markovian
    score climbing.
    """
    own = torch.from_numpy(bank.scores[rows])
    noise = rng.standard_normal((len(own), number, own.shape[1]))
    with torch.inference_mode():
        context = head.context(torch.from_numpy(bank.data[rows]))
        drawn = head.draw(torch.from_numpy(noise.astype(np.float32)), context)
        scores = torch.cat((own[:, None], drawn), dim=1)
        log_q = head.log_prob(scores, context).double().numpy()
    pool = scores.numpy()
    theta = from_scores(bank.simulator.prior, pool)
    log_weight = bank.simulator.log_likelihood(theta, data[:, None])
    # In scores the prior is a standard normal.
    log_weight = log_weight - 0.5 * (pool.astype(float) ** 2).sum(axis=-1) - log_q
    return pool, np.where(np.isfinite(log_weight), log_weight, -np.inf)


def redrawn_bank(
    head: Any,
    simulated: Bank,
    compressed: Bank,
    *,
    number: int,
    rows: int,
    chunk: int,
    seed: int,
    folder: Path,
    progress: Progress | None = None,
) -> RedrawnBank:
    """Pools for the first `rows`, in chunks that an interrupted run finds again in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    parts = []
    for start in range(0, rows, chunk):
        stop = min(start + chunk, rows)
        path = folder / f"{start:08d}.npz"
        if path.is_file():
            with np.load(path) as kept:
                parts.append((kept["pool"], kept["log_weight"]))
        else:
            data = noisy(simulated, start, chunk, seed)
            rng = stream(seed, "redraws", start)
            pieces = [
                redrawn(
                    head,
                    compressed,
                    data[begin - start : min(begin + ROWS, stop) - start],
                    slice(begin, min(begin + ROWS, stop)),
                    number=number,
                    rng=rng,
                )
                for begin in range(start, stop, ROWS)
            ]
            pool, log_weight = (np.concatenate(part) for part in zip(*pieces, strict=True))
            parts.append((pool, log_weight))
            with atomic_path(path) as temporary, temporary.open("wb") as file:
                np.savez(file, pool=pool, log_weight=log_weight)
        if progress is not None:
            progress("redraws", stop, rows)
    pool, log_weight = (np.concatenate(part) for part in zip(*parts, strict=True))
    return RedrawnBank(compressed, pool, log_weight)
