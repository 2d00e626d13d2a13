"""The command line in this process, which has imported everything already."""

from __future__ import annotations

import io
import signal
import sys
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import NamedTuple
from unittest.mock import patch

import pytest

from gaugeblock.cli.commands import main

ROOT = Path(__file__).resolve().parents[2]


class Said(NamedTuple):
    """What a process would have left."""

    returncode: int
    stdout: str
    stderr: str


def inside(*arguments: object, cwd: Path = ROOT, stdin: str = "") -> Said:
    """`gaugeblock` with these arguments."""
    words, out, err = ["gaugeblock", *map(str, arguments)], io.StringIO(), io.StringIO()
    interrupt = signal.getsignal(signal.SIGINT)
    try:
        with (
            chdir(cwd), redirect_stdout(out), redirect_stderr(err), patch.object(sys, "argv", words),
            patch.object(sys, "stdin", io.StringIO(stdin)), pytest.raises(SystemExit) as ended,
        ):  # fmt: skip
            main()
    finally:
        signal.signal(signal.SIGINT, interrupt)
    code = ended.value.code
    return Said(code if isinstance(code, int) else int(code is not None), out.getvalue(), err.getvalue())
