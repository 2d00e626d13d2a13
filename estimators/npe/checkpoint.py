"""What a training loop needs to go on where it was killed, in one safetensors file (never a pickle)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from gaugeblock.core.atomic import write_atomically


def save_checkpoint(
    path: Path,
    *,
    key: str,
    step: int,
    network: torch.nn.Module,
    average: dict[str, torch.Tensor],
    best: dict[str, torch.Tensor],
    optimizer: torch.optim.Optimizer,
    curve: dict[str, Any],
) -> None:
    """Store the state after `step` steps; `key` says of which run."""
    tensors = {f"network/{name}": value for name, value in network.state_dict().items()}
    tensors |= {f"average/{name}": value for name, value in average.items()}
    tensors |= {f"best/{name}": value for name, value in best.items()}
    for index, state in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer/{index}/{name}": torch.as_tensor(value) for name, value in state.items()}
    metadata = {"key": key, "step": str(step), "curve": json.dumps(curve)}
    # Clones, because safetensors refuses tensors that share memory.
    write_atomically(path, save({k: v.detach().clone().contiguous() for k, v in tensors.items()}, metadata))


def load_checkpoint(
    path: Path, *, key: str, network: torch.nn.Module, optimizer: torch.optim.Optimizer
) -> tuple[int, dict[str, torch.Tensor], dict[str, torch.Tensor], dict[str, Any]] | None:
    """Fill network and optimizer; give step, average, best and curve, or None if this run left nothing."""
    try:
        with safe_open(path, framework="pt") as stored:
            metadata = stored.metadata() or {}
            if metadata.get("key") != key:
                return None
            tensors = {name: stored.get_tensor(name) for name in stored.keys()}  # noqa: SIM118
    except (OSError, SafetensorError):
        return None
    groups: dict[str, dict[str, torch.Tensor]] = {"network": {}, "average": {}, "best": {}, "optimizer": {}}
    for name, value in tensors.items():
        group, _, rest = name.partition("/")
        groups[group][rest] = value
    network.load_state_dict(groups["network"])
    own = network.state_dict()
    states: dict[int, dict[str, torch.Tensor]] = {}
    for name, value in groups["optimizer"].items():
        index, _, rest = name.partition("/")
        states.setdefault(int(index), {})[rest] = value
    optimizer.load_state_dict({"state": states, "param_groups": optimizer.state_dict()["param_groups"]})
    average, best = (
        {name: value.to(own[name].device) for name, value in groups[group].items()}
        for group in ("average", "best")
    )
    return int(metadata["step"]), average, best, json.loads(metadata["curve"])
