"""Trained flows of the published network by name; torch is imported when one is asked for."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gaugeblock.core.errors import InputError, require

if TYPE_CHECKING:
    from studies.paper.paper_flow.flow import PaperFlow

FLOWS = Path(__file__).resolve().parent.parent / "flows"


def paper_flow(name: str, folder: Path = FLOWS) -> PaperFlow:
    """A trained flow by the name of its variant.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    require("torch", "sbi")
    import torch
    from safetensors.torch import load_file

    from studies.paper.paper_flow.flow import PaperFlow
    from studies.paper.paper_flow.network import build
    from studies.paper.paper_flow.simulations import prior_of
    from studies.paper.paper_flow.variants import Variant

    record = record_of(name, folder)
    variant = Variant(**record["variant"])
    prior = prior_of(variant)
    theta = torch.arange(2.0 * prior.size).reshape(2, -1)
    network = build(theta, record["channels"], seed=0, summaries=variant.summaries)
    network.load_state_dict(load_file(folder / f"{name}.safetensors"))
    return PaperFlow(network, prior, record)


def record_of(name: str, folder: Path = FLOWS) -> dict[str, Any]:
    """How a flow was trained: variant, losses, sha256 of the weights, command.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    path = folder / f"{name}.json"
    if not path.is_file():
        known = ", ".join(sorted(p.stem for p in folder.glob("*.json"))) or "none"
        raise InputError(f"no trained flow {name!r} of the published network; there are {known}")
    record: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return record
