"""A seed that nobody can foresee, kept beside the blocks that were made with it."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from gaugeblock.auditing.workplace import private_folder
from gaugeblock.core.errors import InputError

BITS = 63


def kept_seed(folder: Path, key: str) -> int:
    """The seed of the run `key` in `folder`: of the operating system's entropy, or that of an earlier start.

    Only its owner can read the file. Whoever knew the seed could draw the truths again.

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> kept_seed(folder, "one") == kept_seed(folder, "one") != kept_seed(folder, "other")
    True

    Raises
    ------
    InputError
        If the folder cannot be written to.
    """
    path = folder / f"{key}.seed"
    try:
        private_folder(folder)
        try:
            return int(path.read_text(encoding="ascii"))
        except (FileNotFoundError, ValueError):  # none, or one that was cut off before it was ever used
            path.unlink(missing_ok=True)
        seed = secrets.randbits(BITS)
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(str(seed))
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    return seed
