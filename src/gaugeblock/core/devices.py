"""Where torch and JAX compute: what was asked for, else what GAUGEBLOCK_DEVICE says, else the CPU.

The CPU unless somebody asks: a GPU that happens to be there would change the bits of an audit.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any

from gaugeblock.core.errors import InputError, require

VARIABLE, CPU = "GAUGEBLOCK_DEVICE", "cpu"


def torch_device(asked: str | None = None, *, where: str = "device") -> str:
    """Where a flow computes, as torch calls it: ``cpu`` or ``cuda:0``; `where` is who asked.

    Raises
    ------
    InputError
        If there is no such device.
    """

    def there() -> int:
        cuda = require("torch", "sbi").cuda
        return int(cuda.device_count()) if cuda.is_available() else 0

    return _decided(asked, where, "torch", there)


def jax_device() -> Any:
    """Where our own calls of JAX compute, as JAX's object: for them there is the variable alone.

    Raises
    ------
    InputError
        If there is no such device.
    """
    jax = require("jax", "xray")

    def cuda() -> list[Any]:
        try:
            return list(jax.local_devices(backend="cuda"))
        except RuntimeError:
            return []

    name = _decided(None, VARIABLE, "JAX", lambda: len(cuda()))
    return jax.local_devices(backend=CPU)[0] if name == CPU else cuda()[int(name.partition(":")[2])]


def tell_jax() -> None:
    """Say to JAX, before anything imports it, that it has the CPU alone, or a GPU that torch needs too.

    A user's own settings of JAX stand.
    """
    if (os.environ.get(VARIABLE) or CPU) == CPU:
        os.environ.setdefault("JAX_PLATFORMS", CPU)
    else:
        os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")


def device_kinds(flows: Iterable[str] = ()) -> list[str]:
    """The host, and by whom other devices are used, under the names that their makers give.

    Of flows, given as torch calls their devices, and of JAX once it is loaded: what our calls of it use, and
    its own default, to which a user's simulator may leave it.
    """
    torch, jax = sys.modules.get("torch"), sys.modules.get("jax")
    # By its kind and not its number: two of a kind round alike.
    used = {("torch", torch.cuda.get_device_name(one) if torch and "cuda" in one else one) for one in flows}
    if jax is not None:
        used.add(("JAX by default", jax.local_devices()[0].device_kind))
        # Somebody else may have loaded it; whoever computes with it is told.
        with suppress(InputError):
            used.add(("JAX", jax_device().device_kind))
    return [CPU, *sorted(f"{who} on {kind}" for who, kind in used if kind != CPU)]


def _decided(asked: str | None, where: str, library: str, there: Callable[[], int]) -> str:
    if asked is None:
        asked, where = os.environ.get(VARIABLE) or CPU, VARIABLE
    match = re.fullmatch(r"auto|cpu|cuda(?::(\d{1,3}))?", str(asked))
    if match is None:
        raise InputError(f'{where} {asked!r}: no such device; take "auto", "cpu", "cuda" or "cuda:1"')
    if asked == CPU:
        return CPU
    number, index = there(), int(match[1] or 0)
    if index < number:
        return f"cuda:{index}"
    if asked == "auto":
        return CPU
    raise InputError(
        f"{where} {asked!r}: {library} sees {number} CUDA devices here; take "
        f'"auto" or "cpu", or install a {library} with CUDA'
    )
