"""The training loop of the default network: AdamW, one-cycle learning rate, fresh noise, averaged weights."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from gaugeblock.core.errors import InputError
from gaugeblock.estimators.npe.adamw import AdamW
from gaugeblock.estimators.npe.bank import Progress, stream
from gaugeblock.estimators.npe.checkpoint import load_checkpoint, save_checkpoint
from gaugeblock.estimators.npe.config import TrainingTable
from gaugeblock.estimators.npe.flows import Flow

WARM_UP = 0.2


class Pairs(Protocol):
    """What a network is trained on: rows of scores and data, such as a `Bank`."""

    def __len__(self) -> int: ...

    def pairs(self, rows: Any, rng: np.random.Generator) -> tuple[Any, Any]:
        """Scores ``(row, parameter)`` and data of the given rows."""
        ...


def one_cycle(step: int, steps: int, peak: float) -> float:
    """Learning rate of a step: cosine up from peak/25 over the first fifth, cosine down to nearly zero.

    >>> one_cycle(0, 100, 1.0), one_cycle(20, 100, 1.0)
    (0.04, 1.0)

    References
    ----------
    Smith & Topin (2019), Super-convergence.
    """
    turn = WARM_UP * steps
    if step < turn:
        low, high, place = peak / 25.0, peak, step / turn
    else:
        low, high, place = peak, peak * 1e-4, (step - turn) / max(steps - turn, 1.0)
    return low + (high - low) * 0.5 * (1.0 - math.cos(math.pi * min(place, 1.0)))


def descend(optimizer: torch.optim.Optimizer, loss: torch.Tensor, rate: float, clip: float) -> None:
    """One step of an optimizer with a single group of parameters, their gradient clipped."""
    (group,) = optimizer.param_groups
    group["lr"] = rate
    optimizer.zero_grad()
    loss.backward()
    torch.nn.utils.clip_grad_norm_(group["params"], clip)
    optimizer.step()


def negative_log_density(flow: Flow, score: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """What is made small, ``(row,)``: of one score each ``(row, parameter)``, given the data."""
    return -flow.log_prob(score[:, None], flow.context(x))[:, 0]


def train_default(
    network: Any,
    bank: Pairs,
    options: TrainingTable,
    *,
    checkpoint: Path,
    key: str,
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Train in place; returns the training curve. Interrupted and called again, ends at the same weights.

    The last rows of the bank, with noise of their own, are the validation set; the weights kept are a running
    average: that with the smallest validation loss, or the last.

    Raises
    ------
    InputError
        If no validation loss was finite.
    """
    size = len(bank) - held_out(len(bank), options)
    validation = _tensors(network, bank, slice(size, None), stream(options.seed, "validation"))
    parameters = [p for p in network.parameters() if p.requires_grad]
    optimizer = AdamW(
        parameters, lr=options.learning_rate, betas=(0.9, 0.99), weight_decay=options.weight_decay
    )
    average = {name: value.detach().clone() for name, value in network.named_parameters()}
    best = {name: value.clone() for name, value in average.items()}
    curve: dict[str, Any] = {"step": [], "training": [], "validation": [], "best": None}
    start = 0
    restored = load_checkpoint(checkpoint, key=key, network=network, optimizer=optimizer)
    if restored is not None:
        start, average, best, curve = restored
    recent: list[float] = []
    # Two a checkpoint: there the mean of recent losses starts anew, so a resumed curve is the same too.
    interval = max(1, options.checkpoint // 2)
    for step in range(start, options.steps):
        rng = stream(options.seed, "step", step)
        score, x = _tensors(network, bank, rng.integers(0, size, options.batch), rng)
        loss = negative_log_density(network, score, x).mean()
        descend(optimizer, loss, one_cycle(step, options.steps, options.learning_rate), options.clip)
        _blend(average, network, max(1.0 - options.average, 1.0 / (step + 1)))
        recent.append(float(loss.detach()))
        done = step + 1
        if done % interval == 0 or done == options.steps:
            value = _validation_loss(network, average, validation, options.batch)
            curve["step"].append(done)
            curve["training"].append(float(np.mean(recent)))
            curve["validation"].append(value)
            recent = []
            if math.isfinite(value) and (curve["best"] is None or value < curve["best"]):
                curve["best"] = value
                best = {name: tensor.clone() for name, tensor in average.items()}
        if done % (2 * interval) == 0:
            save_checkpoint(
                checkpoint, key=key, step=done, network=network, average=average, best=best,
                optimizer=optimizer, curve=curve,
            )  # fmt: skip
        if progress is not None:
            progress("steps", done, options.steps)
    if curve["best"] is None:
        raise InputError(
            f"training diverged: no finite loss in {options.steps} steps; lower training.learning_rate"
        )
    _place(network, best if options.keep == "best" else average)
    return curve


def held_out(rows: int, options: TrainingTable) -> int:
    """How many of so many rows, the last, are the validation set."""
    return max(1, round(options.validation * rows))


def placed(values: NDArray[Any], network: Any) -> torch.Tensor:
    """An array as a tensor, where the weights of a network are."""
    return torch.from_numpy(values).to(next(network.parameters()).device)


def _tensors(
    network: Any, bank: Pairs, rows: Any, rng: np.random.Generator
) -> tuple[torch.Tensor, torch.Tensor]:
    scores, x = bank.pairs(rows, rng)
    return placed(scores, network), placed(np.asarray(x).astype(np.float64), network)


def _blend(average: dict[str, torch.Tensor], network: Any, weight: float) -> None:
    with torch.no_grad():
        for name, value in network.named_parameters():
            average[name].lerp_(value, weight)


def _place(network: Any, values: dict[str, torch.Tensor]) -> None:
    with torch.no_grad():
        for name, parameter in network.named_parameters():
            parameter.copy_(values[name])


def _validation_loss(
    network: Any, average: dict[str, torch.Tensor], data: tuple[torch.Tensor, torch.Tensor], batch: int
) -> float:
    """Mean loss of the averaged weights; the network's own are put back."""
    own = {name: value.detach().clone() for name, value in network.named_parameters()}
    _place(network, average)
    with torch.no_grad():
        parts = [
            negative_log_density(network, score, x).double().sum()
            for score, x in zip(data[0].split(batch), data[1].split(batch), strict=True)
        ]
    _place(network, own)
    return float(torch.stack(parts).sum() / len(data[0]))
