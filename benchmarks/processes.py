"""What is measured runs in a process of its own: on one core where that is asked for; it must end well."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gaugeblock.core.errors import InputError
from gaugeblock.core.executors import SINGLE

ONE_CORE = dict.fromkeys(SINGLE, "1")
GAUGEBLOCK = ("-m", "gaugeblock")
VERDICTS = (0, 1, 3)
"""Codes of good ends, where there is a verdict."""

# Linux counts what a process was before its program began among what it has used: as large as its parent.
FROM_A_SMALL_PROCESS = """
import json, resource, subprocess, sys
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(json.dumps([code, used.ru_utime + used.ru_stime, used.ru_maxrss]))
"""


def audit(settings: Mapping[str, Any]) -> list[str]:
    """Words of an audit with these settings."""
    return ["audit", *(word for key, value in settings.items() for word in ("--set", f"{key}={value}"))]


def ran(words: Sequence[str], says: str, *, cwd: Path, env: Mapping[str, str], verdict: bool) -> str:
    """What a process printed; where it gives a `verdict`, codes of verdicts are good ends too.

    Raises
    ------
    InputError
        If it ends otherwise; `says` is what it was.
    """
    done = subprocess.run(words, cwd=cwd, env=env, capture_output=True, text=True, check=False)
    if done.returncode not in (VERDICTS if verdict else (0,)):
        raise InputError(f"{says}: {done.stderr.strip().splitlines()[-1:]}")
    return done.stdout


def cost(
    words: Sequence[str],
    *,
    good: Sequence[int],
    cwd: Path | None = None,
    env: Mapping[str, str] | None = None,
) -> dict[str, float]:
    """CPU seconds of a Python program on one core, and the largest process's GB.

    Raises
    ------
    InputError
        If it ends with none of the `good` codes.
    """
    done = subprocess.run(
        [sys.executable, "-c", FROM_A_SMALL_PROCESS, sys.executable, *words],
        cwd=cwd, env={**os.environ, **ONE_CORE, **(env or {})}, capture_output=True, check=True,
    )  # fmt: skip
    code, seconds, kilobytes = json.loads(done.stdout)
    if code not in good:
        raise InputError(f"{' '.join(words)}: ended with {code}")
    return {"seconds": round(seconds, 2), "gb": round(kilobytes / 1e6, 3)}
