"""A device for machines without one: its tensors hold numbers on the host, and mix with nothing.

It bears the name of torch's device "meta", which every build of torch has. Nothing of that device is used but
the name: numbers are real, and the same bits as on the host.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch.utils._python_dispatch import (
    TorchDispatchMode,
    _disable_current_modes,
    return_and_correct_aliasing,
)
from torch.utils._pytree import tree_leaves, tree_map_only

NAME = "meta"
# What may be done on the host: numbers are made, cut to size and brought.
ON_THE_HOST = {
    "_to_copy", "arange", "as_strided", "clone", "copy_", "detach", "empty", "expand", "full", "lift_fresh",
    "ones", "permute", "scalar_tensor", "select", "set_", "slice", "split", "unsqueeze", "view", "zeros",
}  # fmt: skip


class Held(torch.Tensor):
    """A tensor that says it is on the device."""

    @staticmethod
    def __new__(cls, held: torch.Tensor) -> Any:
        return torch.Tensor._make_wrapper_subclass(
            cls,
            held.shape,
            strides=held.stride(),
            storage_offset=held.storage_offset(),
            dtype=held.dtype,
            device=NAME,
        )

    def __init__(self, held: torch.Tensor):
        self.held = held

    @classmethod
    def __torch_dispatch__(cls, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        return computed(function, args, kwargs or {})


class Device(TorchDispatchMode):
    """Inside, the device is there; `done` counts what was computed on it.

    Two devices in one operation are an error, and so is work of the `host` unless that is allowed.
    """

    def __init__(self, *, host: bool = False) -> None:
        super().__init__()
        self.host, self.done = host, 0

    def __torch_dispatch__(self, function: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        tensors = [leaf for leaf in tree_leaves((args, kwargs or {})) if isinstance(leaf, torch.Tensor)]
        there = any(isinstance(tensor, Held) for tensor in tensors)
        self.done += there
        name = function.overloadpacket.__name__
        # Every device takes single numbers of the host, such as an optimizer's count of steps.
        here = any(one.ndim and not isinstance(one, Held) for one in tensors)
        # What is on a device may be picked by numbers of the host, after a wait.
        allowed = self.host and (not there or name == "index")
        if name not in ON_THE_HOST and here and not allowed:
            raise AssertionError(f"{name} of tensors on {', '.join(str(one.device) for one in tensors)}")
        return computed(function, args, kwargs or {})


def computed(function: Any, args: Any, kwargs: dict[str, Any]) -> Any:
    """The same on the host's numbers, and the answer back on the device that it belongs on."""
    asked = kwargs.get("device")
    there = (
        any(isinstance(leaf, Held) for leaf in tree_leaves((args, kwargs)))
        if asked is None
        else torch.device(asked).type == NAME
    )
    own_args, own = tree_map_only(Held, lambda one: one.held, (args, kwargs))
    if asked is not None:
        own["device"] = "cpu"
    answer = function(*own_args, **own)
    if there:
        answer = tree_map_only(torch.Tensor, Held, answer)
    return return_and_correct_aliasing(function, args, kwargs, answer)


def on_the_host(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function that may compute there, as one may that makes the first weights."""

    def called(*args: Any, **kwargs: Any) -> Any:
        with _disable_current_modes():
            return function(*args, **kwargs)

    return called
