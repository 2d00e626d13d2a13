"""Reading a file that somebody else wrote: what goes wrong becomes one line that names the file."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import TypeVar

from gaugeblock.core.errors import InputError

FilePath = str | PathLike[str]
T = TypeVar("T")


def load(role: str, path: FilePath, read: Callable[[Path], T]) -> T:
    """Read one file, or say in one line which file is wrong and how.

    Raises
    ------
    InputError
        If the file is missing, truncated, not FITS, or not of this role.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError(f"{role} {file}: no such file; check the path")
    try:
        with warnings.catch_warnings():
            # Unit strings that astropy does not know concern nobody; a file cut short does.
            warnings.simplefilter("ignore")
            warnings.filterwarnings("error", message=".*truncated.*")
            return read(file)
    except InputError as error:
        raise InputError(f"{role} {file}: {error}") from None
    except Exception as error:
        # Anything can come out of a parser that is fed a broken file (OSError, KeyError, zlib.error, ...).
        reason = " ".join(str(error).split()).rstrip(".") or type(error).__name__
        raise InputError(
            f"{role} {file}: cannot be read as an OGIP {role} file ({reason}); "
            "check that it is complete and of the right kind"
        ) from None
