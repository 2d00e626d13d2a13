"""What is measured runs in a process of its own: on one core where that is asked for; it must end well."""

from __future__ import annotations

import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from gaugeblock.core.errors import InputError
from gaugeblock.core.executors import SINGLE

ONE_CORE = dict.fromkeys(SINGLE, "1")


def ran(words: Sequence[str], says: str, *, cwd: Path, env: Mapping[str, str], verdict: bool) -> str:
    """What a process printed; where it gives a `verdict`, codes of verdicts are good ends too.

    Raises
    ------
    InputError
        If it ends otherwise; `says` is what it was.
    """
    done = subprocess.run(words, cwd=cwd, env=env, capture_output=True, text=True, check=False)
    if done.returncode not in ((0, 1, 3) if verdict else (0,)):
        raise InputError(f"{says}: {done.stderr.strip().splitlines()[-1:]}")
    return done.stdout
