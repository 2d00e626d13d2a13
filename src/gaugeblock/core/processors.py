"""Processors: sums round otherwise on another kind, so what two kinds made is not put together unasked."""

from __future__ import annotations

import json
import platform
from functools import cache
from pathlib import Path

from gaugeblock.core.atomic import write_once
from gaugeblock.core.devices import device_kinds
from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError

FIRST, OTHERS = "processor.json", "processor-*.json"
# Instructions that decide which of a library's kernels runs.
VECTOR = ("avx", "fma", "sse4", "amx", "asimd", "sve")


def processor(*flows: str) -> str:
    """What numbers are made on here: processor, vector instructions by a short digest, and devices.

    `flows` are the devices that an estimator's torch computes on.
    """
    return f"{_chip()} ({', '.join(device_kinds(flows))})"


@cache
def _chip() -> str:
    """Of Linux's table; elsewhere what Python knows."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    table = {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)}
    name = table.get("model name") or platform.processor() or "unknown"
    flags = sorted(
        flag
        for flag in (table.get("flags") or table.get("Features") or "").split()
        if flag.startswith(VECTOR)
    )
    return f"{platform.machine()} {name}, vectors {digest(flags)[:8]}"


def one_kind(folder: Path, *flows: str, mixed: bool = False) -> None:
    """Enter this processor in a folder of work as the one that it is made on, or as one more if `mixed`.

    `flows` are devices, as in `processor`.

    Raises
    ------
    InputError
        If another kind is entered, and they must not be mixed.
    """
    here = json.dumps(processor(*flows)).encode()
    if write_once(folder / FIRST, here) == here:
        return
    if mixed:
        write_once(folder / OTHERS.replace("*", digest(here.decode())[:8]), here)
        return
    raise InputError(
        f"{folder} was made on {_read(folder / FIRST)}, and {platform.node()} is {processor(*flows)}, "
        "which may round otherwise: go on there, begin anew in another folder, or give up equal bits with "
        "--allow-mixed"
    )


def kinds(folder: Path, *, mixed: bool = False) -> list[str]:
    """All processors that a folder of work was made on; none where nothing was made.

    Raises
    ------
    InputError
        If there are several, and they must not be mixed.
    """
    found = [_read(path) for path in (*folder.glob(FIRST), *sorted(folder.glob(OTHERS)))]
    if len(found) > 1 and not mixed:
        raise InputError(
            f"{folder} was made on {' and on '.join(found)}, which may round otherwise: begin anew in "
            "another folder, or give up equal bits with --allow-mixed"
        )
    return found


def _read(path: Path) -> str:
    try:
        return str(json.loads(path.read_bytes()))
    except (OSError, ValueError):
        raise InputError(f"{path} cannot be read; remove the folder {path.parent}") from None
