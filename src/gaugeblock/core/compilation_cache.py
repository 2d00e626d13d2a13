"""Compiled programs kept on disk, so that the next process need not compile them again."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from gaugeblock.core.digest import digest
from gaugeblock.core.processors import processor

LARGEST = 512 * 2**20
"""Bytes that all compiled programs may take; the oldest go first."""


def keep_compiled() -> Path | None:
    """Tell JAX, before anything imports it, to keep what it compiles; the folder, or None if it is not kept.

    The folder is ``compiled/KEY`` in the one that the variable ``GAUGEBLOCK_CACHE`` names (empty: nothing is
    kept), without it in the user's cache. KEY is of this processor and the versions that compile. A user's
    own ``JAX_COMPILATION_CACHE_DIR`` stands. Nothing is said where the folder cannot be written: only time is
    lost.
    """
    chosen = os.environ.get("GAUGEBLOCK_CACHE")
    if chosen == "" or "JAX_COMPILATION_CACHE_DIR" in os.environ or "jax" in sys.modules:
        return None
    try:
        made_by = [version(name) for name in ("jax", "jaxlib")]
        home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        kept = Path(chosen or Path(home) / "gaugeblock") / "compiled"
        folder = kept / digest([processor(), sys.version, made_by])[:16]
        folder.mkdir(parents=True, exist_ok=True)
        bounded(kept)
    except (PackageNotFoundError, OSError, RuntimeError):
        return None
    if not os.access(folder, os.W_OK):
        return None
    # Whatever takes long to compile also takes long to trace: all of it is kept.
    os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder.resolve())
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
    # XLA takes its own tuning hints for instructions that the processor lacks, and says so for each program.
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    return folder


def bounded(folder: Path, *, largest: int = LARGEST) -> None:
    """Remove the oldest files below a folder until the others take no more than `largest` bytes."""
    found = []
    for path in folder.rglob("*"):
        with suppress(OSError):
            if path.is_file():
                known = path.stat()
                found.append((known.st_mtime, known.st_size, path))
    total = 0
    for _, size, path in sorted(found, reverse=True):
        total += size
        if total > largest:
            # Another process may have done so already.
            with suppress(OSError):
                path.unlink()
