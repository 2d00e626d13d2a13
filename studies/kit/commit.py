"""Which commit a study is of: what is drawn from its digest could not be known before it was made."""

from __future__ import annotations

import hashlib
import subprocess
from pathlib import Path

from gaugeblock.core.errors import InputError

ROOT = Path(__file__).resolve().parents[2]


def committed(root: Path, name: str) -> str:
    """The commit that a name stands for.

    Raises
    ------
    InputError
        If there is none.
    """
    done = subprocess.run(
        ["git", "-C", str(root), "rev-parse", "--verify", "-q", f"{name}^{{commit}}"],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise InputError(f"{root}: no commit is called {name}; studies are drawn from what is committed")
    return done.stdout.strip()


def seed_of(study: str, commit: str) -> int:
    """The seed that a commit gives a study: anybody has the same.

    >>> seed_of("faults", "c0ffee") == seed_of("faults", "c0ffee") != seed_of("faults", "c0ffef")
    True
    """
    return int.from_bytes(hashlib.sha256(f"{study} {commit}".encode()).digest()[:7])
