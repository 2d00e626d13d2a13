"""SHA-256 of plain data and of files: what provenance and resume keys are made of."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from gaugeblock.core.errors import InputError


def digest(content: object) -> str:
    """SHA-256 of plain data, in hexadecimal: of its JSON with sorted keys.

    >>> digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1})
    True
    """
    return hashlib.sha256(json.dumps(content, sort_keys=True, default=str).encode()).hexdigest()


def file_digest(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None
