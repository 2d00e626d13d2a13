"""torch's AdamW, without importing torch's compiler."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import torch

# Devices for which torch has one kernel of all that a step does.
FUSED = frozenset({"cpu", "cuda"})


def _plain(method: Any) -> Any:
    return getattr(method, "__wrapped__", method)


class AdamW(torch.optim.AdamW):
    """torch's own, to the bit, and in one kernel where torch has one.

    torch wraps these methods to keep its compiler out of them, and imports the compiler for that: 1.2 CPU
    seconds of every process that trains.

    References
    ----------
    Loshchilov & Hutter (2019), Decoupled weight decay regularization.
    """

    def __init__(self, parameters: Iterable[torch.Tensor], **options: Any):
        weights = list(parameters)
        super().__init__(weights, **options, fused={weight.device.type for weight in weights} <= FUSED)

    add_param_group = _plain(torch.optim.AdamW.add_param_group)
    zero_grad = _plain(torch.optim.AdamW.zero_grad)
    state_dict = _plain(torch.optim.AdamW.state_dict)
    load_state_dict = _plain(torch.optim.AdamW.load_state_dict)
    step = torch.no_grad()(_plain(torch.optim.AdamW.step))
