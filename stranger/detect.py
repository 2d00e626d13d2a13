"""Which format a stranger's file has: by its suffix and its first bytes, never by loading it."""

from __future__ import annotations

import re
import zipfile
from pathlib import Path

from gaugeblock.core.errors import InputError

SUFFIXES = {".py": "python", ".keras": "bayesflow", ".safetensors": "torch_state", ".eqx": "jax_leaves"}
NPY = b"\x93NUMPY"
ZIP = b"PK\x03\x04"
# How much of a pickle is looked at: the class of the outermost object is named in its first bytes.
START = 4096
# A dotted name of a module, and the name after it: GLOBAL, or two strings as protocol 4 writes them.
NAMED = re.compile(rb"(?:c|\x8c.)(sbi(?:\.\w+)+)(?:\n|\x94\x8c.)(\w+)", re.DOTALL)
ORDERED = re.compile(rb"collections(?:\n|\x94\x8c.)OrderedDict", re.DOTALL)
# Parts of sbi whose objects are posteriors, or build one.
WHOLE = (b"sbi.inference.",)


def detect(path: Path) -> str:
    """Name of the format that can load a file or folder.

    A state dict of PyTorch, leaves of JAX and a pickled network need a builder beside it; what is found here
    is only how to read the file, and whether that succeeds is seen in the sandbox.

    Raises
    ------
    InputError
        If there is no such file, or neither its suffix nor its first bytes say what it is.
    """
    if not path.exists():
        raise InputError(f"{path}: no such file; give the stranger's model file or folder")
    if path.is_dir():
        if (path / "model.py").is_file():
            return "python"
        raise InputError(f"{path}: a folder without model.py; say how it is to be loaded: estimator.format")
    if not path.is_file():  # whoever opened a named pipe would wait for its other end
        raise InputError(f"{path}: is no plain file; give the stranger's model file or folder")
    if path.suffix in SUFFIXES:
        return SUFFIXES[path.suffix]
    found = _by_bytes(path)
    if found is None:
        raise InputError(
            f"{path}: neither suffix nor first bytes say what it is; say how it is to be loaded: "
            "estimator.format, or --estimator-format"
        )
    return found


def _by_bytes(path: Path) -> str | None:
    try:
        with open(path, "rb") as file:
            start = file.read(START)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
    if start.startswith(NPY):
        return "jax_leaves"
    if start.startswith(ZIP):
        return _archive(path)
    # Protocols 2 to 5 begin with their number.
    if start[:1] == b"\x80" and start[1:2] in b"\x02\x03\x04\x05":
        return _pickle(start)
    return None


def _archive(path: Path) -> str | None:
    """What torch.save wrote, or Keras under another suffix."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            if {"config.json", "metadata.json"} <= set(names):
                return "bayesflow"
            pickled = next((name for name in names if name.endswith("/data.pkl") or name == "data.pkl"), None)
            if pickled is None:
                return None
            with archive.open(pickled) as member:
                start = member.read(START)
    except (zipfile.BadZipFile, OSError, ValueError, RuntimeError, NotImplementedError, EOFError):
        return None
    return _pickle(start) or "torch_state"


def _pickle(start: bytes) -> str | None:
    """By the first class that the pickle names: that of the outermost object."""
    named, ordered = NAMED.search(start), ORDERED.search(start)
    if named is not None and (ordered is None or named.start() < ordered.start()):
        return "sbi_posterior" if named[1].startswith(WHOLE) else "sbi_density_estimator"
    return "torch_state" if ordered is not None else None
