"""Marks on an audit's blocks: nobody but this user put them there.

Beside each block lies a digest of its place and its content, made with a key that lies outside the folder,
for its owner alone. A block without one, or with another's, is made again as if there were none: it has the
same bits, and a kill between a block and its mark is no harm.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
import stat
from functools import cache
from pathlib import Path

from gaugeblock.core.atomic import write_atomically, write_once
from gaugeblock.core.errors import InputError

LENGTH = 32
NAME = "blocks.key"
KEPT = "key"


def key_path() -> Path:
    """Where this user's key lies: in what the system calls the state of programs.

    >>> key_path().name
    'blocks.key'
    """
    named = os.environ.get("XDG_STATE_HOME", "")
    # A relative one is to be ignored, says the standard.
    folder = Path(named) if os.path.isabs(named) else Path(os.path.expanduser("~/.local/state"))
    return folder / "gaugeblock" / NAME


def key_name() -> str:
    """A name for this user's key, which does not tell it.

    Raises
    ------
    InputError
        If it is damaged, or others can read it.
    """
    key = key_at(key_path())
    return hmac.digest(key, b"name", "sha256").hex()[:16] if key else "none"


def enter_key(work: Path) -> str:
    """Enter the name of this user's key in a folder of blocks as the one that they are marked with; the name.

    Raises
    ------
    InputError
        If there is another.
    """
    here = key_name()
    if write_once(work / KEPT, here.encode()) != here.encode():
        raise InputError(
            f"{work}: its blocks are marked with another key than {key_path()}: let all machines see one "
            "(XDG_STATE_HOME names the folder above gaugeblock/), or begin anew in another folder"
        )
    return here


def mark(path: Path) -> None:
    """Put its digest beside a block that was just made."""
    write_atomically(_beside(path), _digest(path))


def marked(path: Path) -> bool:
    """Whether a block is there and has the digest beside it."""
    try:
        return hmac.compare_digest(_beside(path).read_bytes(), _digest(path).encode())
    except OSError:
        return False


def _beside(path: Path) -> Path:
    return path.with_suffix(".mark")


def _digest(path: Path) -> str:
    """Of the run, the name and the content: a block of another place, or of another run, does not fit."""
    found = hmac.new(key_at(key_path()), f"{path.parent.name}/{path.name}\0".encode(), hashlib.sha256)
    with open(path, "rb") as file:
        while part := file.read(1 << 20):
            found.update(part)
    return found.hexdigest()


@cache
def key_at(path: Path) -> bytes:
    """The key, made where there is none; empty where none can be kept, as for a user without a home."""
    if not path.is_absolute():
        return b""
    mine = secrets.token_bytes(LENGTH)
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        content = write_once(path, mine, private=True)
        known = os.lstat(path)
        shared = stat.S_IMODE(known.st_mode) & 0o077 or known.st_uid != os.geteuid()
        if shared and content == mine:  # the file system knows no permissions, or no users
            path.unlink()
            return b""
    except (OSError, InputError):
        return b""
    # A link is everybody's, by its mode.
    if len(content) != LENGTH or shared:
        raise InputError(f"{path}: is no key that its owner alone can read; remove it, and begin audits anew")
    return content
