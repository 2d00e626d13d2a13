"""Audits of strangers that mean harm, through the command, and a look at what each left behind."""

from __future__ import annotations

import dataclasses
import os
import secrets
import signal
import sys
import tempfile
import textwrap
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from gaugeblock.cli import main

CANARY = "the canary sings"
# What an attack says where it got what it wanted: never to be seen in anything that an audit shows.
ESCAPED = "ESCAPED"
# Small enough to hurt nobody should one of them not hold; time enough for a busy machine.
LIMITS: dict[str, float] = {
    "memory_gb": 0.4,
    "cpu_seconds": 30,
    "processes": 24,
    "file_mb": 8,
    "wall_seconds": 40,
    "startup_seconds": 60,
    "total_seconds": 120,
}
PREAMBLE = """
import os, socket, signal, sys, time
import numpy as np

def honest(x, n, seed):
    return np.random.default_rng(seed).standard_normal((len(x), n, 2))

def sample(x, n, seed):
    return honest(x, n, seed)
"""
# A program that speaks the protocol itself, and can break every rule of it; no numpy, so it starts at once.
# It is asked for one trial at a time, so that it need not look how many there are in a call.
SPEAKER = """
import json, os, struct, sys, time
source, target = sys.stdin.buffer, sys.stdout.buffer

def request():
    header = json.loads(source.read(int.from_bytes(source.read(4), "big")))
    for _ in header.get("arrays", []):
        source.read(int.from_bytes(source.read(8), "big"))
    return header

def framed(text):
    return len(text).to_bytes(4, "big") + text

def say(**header):
    target.write(framed(json.dumps(header).encode()))
    target.flush()

def npy(descr="'<f8'", shape="(1, 10, 2)", order="False", content=bytes(160)):
    text = f"{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}}}".encode()
    return b"\\x93NUMPY\\x01\\x00" + struct.pack("<H", len(text)) + text + content

def block(content, announced=None):
    target.write((len(content) if announced is None else announced).to_bytes(8, "big") + content)
    target.flush()

def introduce(**more):
    request()
    said = {"answer": "describe", "parameters": None, "can": ["sample"], "versions": {}, "library": ""}
    say(**{**said, **more})

def draws():
    say(answer="sample", arrays=["draws"])
"""


@dataclasses.dataclass(frozen=True)
class Audited:
    """What an audit said, how it ended, and where its files are."""

    code: int
    stdout: str
    stderr: str
    out: Path

    @property
    def reason(self) -> str:
        """The one line that says what was wrong."""
        assert self.code == 2, (self.code, self.stdout)
        assert self.stderr.startswith("gaugeblock: "), self.stderr
        assert self.stderr.count("\n") == 1, self.stderr
        return self.stderr


@dataclasses.dataclass(frozen=True)
class Place:
    """Where things of the machine are that no stranger may reach: an attack is told all of it."""

    folder: Path
    out: Path
    canary: Path


@pytest.fixture(params=("first", "second"))
def place(tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Place]:
    """Every attack comes twice: what the first left behind, the second would meet."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    monkeypatch.setenv("GAUGEBLOCK_CANARY", CANARY)
    # Two rounds share nothing but the machine.
    folder = tmp_path / str(request.param)
    folder.mkdir()
    canary = folder / "canary.txt"
    canary.write_text(CANARY)
    canary.chmod(0o644)
    yield Place(folder=folder, out=folder / "out", canary=canary)
    assert canary.read_text() == CANARY
    assert sorted(file.name for file in folder.iterdir() if file.name not in ("out", "canary.txt")) == []
    assert os.listdir(temporary) == []


def _mounts() -> str:
    return Path("/proc/self/mountinfo").read_text()


def _processes(token: str) -> dict[int, str]:
    """Our children, zombies too, and whoever has the token among its words."""
    found = {}
    for name in filter(str.isdigit, os.listdir("/proc")):
        try:
            words = Path(f"/proc/{name}/cmdline").read_bytes().decode(errors="replace")
            parent = int(Path(f"/proc/{name}/stat").read_text().rpartition(")")[2].split()[1])
        except (FileNotFoundError, ProcessLookupError):
            continue
        if parent == os.getpid() or token in words:
            found[int(name)] = words
    return found


@contextmanager
def _nothing_left(token: str) -> Iterator[None]:
    before = (_mounts(), _processes(token))
    yield
    assert (_mounts(), _processes(token)) == before
    assert [thread for thread in threading.enumerate() if thread.name == "stranger watchdog"] == []


@pytest.fixture
def attack(
    sandbox: Any,
    tmp_path: Path,
    place: Place,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> Callable[..., Audited]:
    """Audit a stranger: source text of a file, of a program (`speaks`), or the path of a model."""

    def run(
        stranger: str | Path,
        *words: str,
        speaks: bool = False,
        limits: dict[str, float] | None = None,
        number: int = 10,
        validator: str = "draws",
    ) -> Audited:
        token = f"hostile_{secrets.token_hex(8)}"
        if isinstance(stranger, str):
            path = tmp_path / f"{token}.py"
            path.write_text((SPEAKER if speaks else PREAMBLE) + textwrap.dedent(stranger))
        else:
            path = stranger
        program = ("--estimator-command", f"{{python}} {path}") if speaks else ("--estimator", str(path))
        toy = {"simulator.parameters": 2, "simulator.data": 3}
        toy |= {"trials.number": number, "trials.draws": 10, "trials.block": 1 if speaks else number}
        held = {f"estimator.limits.{key}": value for key, value in {**LIMITS, **(limits or {})}.items()}
        settings = [word for key, value in {**toy, **held}.items() for word in ("--set", f"{key}={value}")]
        given = (
            "--simulator",
            "linear_gaussian",
            "--validator",
            validator,
            "--quiet",
            "--out",
            str(place.out),
        )
        monkeypatch.setattr(sys, "argv", ["gaugeblock", "audit", *program, *given, *settings, *words])
        handler = signal.getsignal(signal.SIGINT)
        with _nothing_left(token):
            try:
                with pytest.raises(SystemExit) as ended:
                    main()
            finally:
                signal.signal(signal.SIGINT, handler)
        stdout, stderr = capfd.readouterr()
        if isinstance(stranger, str):
            path.unlink()
        assert ESCAPED not in stdout + stderr
        assert CANARY not in stdout + stderr
        assert isinstance(ended.value.code, int)
        return Audited(ended.value.code, stdout, stderr, place.out)

    return run
