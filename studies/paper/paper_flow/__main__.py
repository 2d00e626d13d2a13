"""Train flows of the published network: ``python -m studies.paper.paper_flow [NAME ...]``.

Weights and records go beside this package, checkpoints into the working directory; a training that was cut
off goes on. Some fifteen minutes of one core each.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import save

from gaugeblock.auditing.identity import versions
from gaugeblock.core.atomic import write_atomically
from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError
from gaugeblock.estimators.npe.checkpoint import load_checkpoint, save_checkpoint
from studies.paper.paper_flow.network import build
from studies.paper.paper_flow.shipped import FLOWS
from studies.paper.paper_flow.simulations import simulations
from studies.paper.paper_flow.variants import VARIANTS, Variant

BATCH, RATE, CLIP, PATIENCE, VALIDATION = 200, 5e-4, 5.0, 20, 0.1

Progress = Callable[[str, int, int], None]
State = dict[str, torch.Tensor]


@dataclass
class _Curve:
    training: list[float]
    validation: list[float]

    @property
    def best(self) -> int:
        """Epoch of the smallest validation loss, from 0."""
        return int(np.argmin(self.validation))

    def waited(self) -> bool:
        """Whether patience is at its end."""
        return bool(self.validation) and len(self.validation) - 1 - self.best >= PATIENCE


def train(names: dict[str, Variant], folder: Path, *, work: Path, progress: Progress | None = None) -> None:
    """Train variants that differ in their cap alone, and write their weights and records into a folder."""
    longest = max(names.values(), key=lambda variant: variant.cap)
    theta, counts = (torch.from_numpy(a.astype(np.float32)) for a in simulations(longest))
    order = np.random.default_rng([longest.torch_seed, 0]).permutation(len(theta))
    held = int(VALIDATION * len(theta))
    fitted, validated = order[held:], order[:held]
    network = build(theta[fitted], counts.shape[1], seed=longest.torch_seed, summaries=longest.summaries)
    optimizer = torch.optim.Adam(network.parameters(), lr=RATE)
    key = json.dumps(longest.describe(), sort_keys=True)
    checkpoint = work / f"{digest(longest.describe())[:12]}.safetensors"
    work.mkdir(parents=True, exist_ok=True)
    curve, best = _Curve([], []), _copy(network)
    kept = load_checkpoint(checkpoint, key=key, network=network, optimizer=optimizer)
    if kept is not None:
        _, best, _, stored = kept
        curve = _Curve(stored["training"], stored["validation"])
    for epoch in range(len(curve.training), longest.cap):
        if curve.waited():
            break
        rows = np.random.default_rng([longest.torch_seed, 1, epoch]).permutation(fitted)
        curve.training.append(_epoch(network, optimizer, theta, counts, rows))
        curve.validation.append(_loss(network, theta[validated], counts[validated]))
        if curve.best == epoch:
            best = _copy(network)
        for name, variant in names.items():
            if variant.cap == epoch + 1:
                # Before the checkpoint, which would skip this epoch.
                weights = best if curve.waited() else _copy(network)
                _write(folder, name, variant, weights, curve, counts.shape[1])
        save_checkpoint(
            checkpoint,
            key=key,
            step=epoch + 1,
            network=network,
            average=best,
            best=best,
            optimizer=optimizer,
            curve={"training": curve.training, "validation": curve.validation},
        )
        if progress is not None:
            progress(f"{'/'.join(names)}: loss {curve.validation[-1]:.3f}", epoch + 1, longest.cap)
    for name, variant in names.items():
        if variant.cap > len(curve.training):
            _write(folder, name, variant, best, curve, counts.shape[1])


def _epoch(network: Any, optimizer: Any, theta: torch.Tensor, counts: torch.Tensor, rows: Any) -> float:
    network.train()
    losses = []
    for start in range(0, len(rows) - BATCH + 1, BATCH):
        batch = rows[start : start + BATCH]
        loss = network.loss(theta[batch], condition=counts[batch]).mean()
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), CLIP)
        optimizer.step()
        losses.append(loss.detach())
    return float(torch.stack(losses).double().mean())


def _loss(network: Any, theta: torch.Tensor, counts: torch.Tensor) -> float:
    network.eval()
    with torch.no_grad():
        parts = [
            network.loss(t, condition=x).double().sum()
            for t, x in zip(theta.split(1000), counts.split(1000), strict=True)
        ]
    return float(torch.stack(parts).sum() / len(theta))


def _copy(network: Any) -> State:
    return {name: value.detach().clone() for name, value in network.state_dict().items()}


def _write(folder: Path, name: str, variant: Variant, weights: State, curve: _Curve, channels: int) -> None:
    """Weights first: a record without them is never left."""
    stored = save({key: value.contiguous() for key, value in weights.items()})
    epochs = min(len(curve.training), variant.cap)
    record = {
        "variant": variant.describe(),
        "channels": channels,
        "epochs": epochs,
        "weights": "last" if epochs == variant.cap and not _converged(curve, epochs) else "best",
        "best_epoch": int(np.argmin(curve.validation[:epochs])) + 1,
        "training": [round(value, 4) for value in curve.training[:epochs]],
        "validation": [round(value, 4) for value in curve.validation[:epochs]],
        "sha256": hashlib.sha256(stored).hexdigest(),
        "versions": versions(),
        "command": f"python -m studies.paper.paper_flow {name}",
    }
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(folder / f"{name}.safetensors", stored)
    write_atomically(folder / f"{name}.json", json.dumps(record, indent=1) + "\n")


def _converged(curve: _Curve, epochs: int) -> bool:
    return _Curve(curve.training[:epochs], curve.validation[:epochs]).waited()


def main() -> None:
    """Train what is named, all without names."""
    parser = argparse.ArgumentParser(prog="python -m studies.paper.paper_flow")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(VARIANTS))
    parser.add_argument("--out", type=Path, default=FLOWS, help="folder for weights and records")
    parser.add_argument("--work", type=Path, default=Path("paper-flow-checkpoints"))
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in VARIANTS]
    if unknown:
        raise InputError(f"no variant {unknown[0]!r}; there are {', '.join(VARIANTS)}")
    torch.set_num_threads(1)  # the same bits on any machine of this kind; more threads hardly help
    for group in _groups(options.names or list(VARIANTS)):
        train(group, options.out, work=options.work, progress=_tell)


def _groups(names: list[str]) -> list[dict[str, Variant]]:
    """Variants that are one training but for its cap, together."""
    groups: dict[str, dict[str, Variant]] = {}
    for name in names:
        variant = VARIANTS[name]
        groups.setdefault(str(variant.describe() | {"cap": None}), {})[name] = variant
    return list(groups.values())


def _tell(stage: str, done: int, total: int) -> None:
    sys.stderr.write(f"{stage}: epoch {done} of at most {total}\n")


if __name__ == "__main__":
    try:
        main()
    except InputError as error:
        sys.stderr.write(f"error: {error}\n")
        sys.exit(2)
