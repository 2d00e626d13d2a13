"""Train a Laplace network: emulator, first guess, compression of the bank, and then the flow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError
from safetensors.torch import load_file, save

from gaugeblock.core.atomic import write_atomically
from gaugeblock.estimators._rows import resample
from gaugeblock.estimators.npe.adamw import AdamW
from gaugeblock.estimators.npe.bank import Bank, Progress, kept, stream
from gaugeblock.estimators.npe.config import TrainingTable
from gaugeblock.estimators.npe.coordinates import from_scores
from gaugeblock.estimators.npe.laplace.compressor import Compressor
from gaugeblock.estimators.npe.laplace.network import LaplaceNetwork
from gaugeblock.estimators.npe.loop import descend, held_out, one_cycle, placed, train_default

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
    own = placed(bank.scores[rows], head)
    noise = rng.standard_normal((len(own), number, own.shape[1]))
    with torch.inference_mode():
        context = head.context(placed(bank.data[rows], head))
        drawn, density = head.draw(placed(noise.astype(np.float32), head), context)
        scores = torch.cat((own[:, None], drawn), dim=1)
        log_q = torch.cat((head.log_prob(own[:, None], context), density), dim=1).double().cpu().numpy()
    pool = scores.cpu().numpy()
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

    def pools(start: int, stop: int) -> tuple[NDArray[Any], ...]:
        data = noisy(simulated, start, chunk, seed)
        rng = stream(seed, "redraws", start)
        pieces = []
        for begin in range(start, stop, ROWS):
            own = slice(begin, min(begin + ROWS, stop))
            counts = data[own.start - start : own.stop - start]
            pieces.append(redrawn(head, compressed, counts, own, number=number, rng=rng))
        return tuple(np.concatenate(part) for part in zip(*pieces, strict=True))

    names = ("pool", "log_weight")
    pool, log_weight = in_chunks(
        "redraws", names, pools, rows=rows, chunk=chunk, folder=folder, told=progress
    )
    return RedrawnBank(compressed, pool, log_weight)


def in_chunks(
    stage: str,
    names: tuple[str, ...],
    make: Callable[[int, int], tuple[NDArray[Any], ...]],
    *,
    rows: int,
    chunk: int,
    folder: Path,
    told: Progress | None,
) -> tuple[NDArray[Any], ...]:
    """Arrays of all rows, made from `start` to `stop`; an interrupted run finds chunks again in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    parts = []
    for start in range(0, rows, chunk):
        stop = min(start + chunk, rows)
        parts.append(kept(folder / f"{start:08d}.npz", names, partial(make, start, stop)))
        if told is not None:
            told(stage, stop, rows)
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))


GUESS_STEPS = 3_000
BATCH, RATE = 1024, 4e-3
EXAMPLES = 20_000
CHUNK = 8192


def train_laplace(
    network: LaplaceNetwork,
    bank: Bank,
    options: TrainingTable,
    *,
    folder: Path,
    key: str,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Train in place; returns the training curve of the flow.

    What a stage leaves lies in `folder`, under `key`: one that was cut off repeats the emulator or a chunk.
    """
    compressor = network.compressor
    stored = folder / f"compressor-{key}.safetensors"
    if not _restored(compressor, stored):
        numbers = (options.emulator_steps, GUESS_STEPS)
        train_compressor(compressor, bank, seed=options.seed, steps=numbers, progress=progress)
        state = {name: value.contiguous() for name, value in compressor.state_dict().items()}
        write_atomically(stored, bytes(save(state)))

    def compress(start: int, _: int) -> tuple[NDArray[np.float32]]:
        x = noisy(bank, start, CHUNK, options.seed)
        return (compressor(placed(x, compressor)).cpu().numpy(),)

    (data,) = in_chunks(
        *("compressed", ("data",), compress),
        rows=len(bank),
        chunk=CHUNK,
        folder=folder / f"compressed-{key}",
        told=progress,
    )
    network.head.standardise(placed(data[:EXAMPLES], network))
    compressed = Bank(bank.scores, data, False, bank.simulator)
    curve = train_default(
        network.head,
        compressed,
        options,
        checkpoint=folder / "checkpoint.safetensors",
        key=key,
        progress=progress,
    )
    if not options.redraws:
        return curve
    redrawn = redrawn_bank(
        network.head,
        bank,
        compressed,
        number=options.redraws,
        rows=len(bank) - held_out(len(bank), options),
        chunk=CHUNK,
        seed=options.seed,
        folder=folder / f"redraws-{key}",
        progress=progress,
    )
    again = train_default(
        network.head,
        redrawn,
        options,
        checkpoint=folder / "checkpoint-redraws.safetensors",
        key=key,
        progress=progress,
    )
    steps = [options.steps + step for step in again["step"]]
    return {
        "step": curve["step"] + steps,
        "training": curve["training"] + again["training"],
        "validation": curve["validation"] + again["validation"],
        "best": again["best"],
    }


def train_compressor(
    compressor: Compressor,
    bank: Bank,
    *,
    seed: int,
    steps: tuple[int, int],
    progress: Progress | None = None,
) -> None:
    """Choose groups, then fit the emulator to expected counts and the first guess to noisy ones."""
    expected = placed(bank.data[:EXAMPLES], compressor)
    compressor.choose_groups(expected)
    groups = compressor.groups
    compressor.emulator.standardise(compressor.grouped(expected)[:, :groups])
    noisy = np.asarray(bank.observe(slice(0, EXAMPLES), stream(seed, "features")), dtype=np.float64)
    compressor.features.fit(compressor.grouped(placed(noisy, compressor)).cpu().numpy())

    def emulated(rows: NDArray[Any], rng: np.random.Generator) -> torch.Tensor:  # noqa: ARG001
        mean = compressor.grouped(placed(bank.data[rows], compressor))[:, :groups].clamp(min=1e-6)
        away = compressor.emulator(placed(bank.scores[rows], compressor)) - torch.log(mean)
        # Counts span decades: the logarithm keeps the brightest from deciding alone.
        return torch.log1p((mean * away**2).sum(dim=-1)).mean()

    def guessed(rows: NDArray[Any], rng: np.random.Generator) -> torch.Tensor:
        x = placed(np.asarray(bank.observe(rows, rng), dtype=np.float64), compressor)
        away = compressor.guess(compressor.features(compressor.grouped(x)))
        return ((away - placed(bank.scores[rows], compressor)) ** 2).mean()

    for stage, module, loss, number in (
        ("emulator", compressor.emulator, emulated, steps[0]),
        ("first guess", compressor.guess, guessed, steps[1]),
    ):
        optimizer = AdamW(module.parameters(), lr=RATE, weight_decay=0.0)
        for step in range(number):
            rng = stream(seed, stage, step)
            value = loss(rng.integers(0, len(bank), BATCH), rng)
            descend(optimizer, value, one_cycle(step, number, RATE), 20.0)
            if progress is not None:
                progress(stage, step + 1, number)
    compressor.requires_grad_(False)


def _restored(compressor: Compressor, path: Path) -> bool:
    try:
        compressor.load_state_dict(load_file(path))
    except (OSError, SafetensorError):
        return False
    compressor.requires_grad_(False)
    return True
