"""Mutated files of all kinds, each read in a fork of a warm process: one line or a sound answer, never more.

`GAUGEBLOCK_FUZZ=5000 pytest tests/trust/test_fuzz.py` reads as many; CI reads 300.
"""

from __future__ import annotations

import gzip
import io
import os
import resource
import signal
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gaugeblock.auditing.config import read_config
from gaugeblock.auditing.provenance import finished_audit
from gaugeblock.auditing.trials_from import any_trials
from gaugeblock.core.errors import InputError

NUMBER = int(os.environ.get("GAUGEBLOCK_FUZZ", "300"))
SECONDS, MEMORY = 20, 2 << 30
HOSTILE = Path(__file__).parent / "hostile"
TOML = b"""
validators = ["draws", "sbc"]
simulator = {name = "linear_gaussian", parameters = 1, data = 1}
trials = {number = 10, draws = 10, seed = 3}
[policy]
base = "strict"
[policy.tolerance]
bias = 0.2
"""
JSON = (
    b'{"verdict": "PASS", "gates": [], "provenance": {"seed": 1, "format": 2, "policy": {"tolerance": {}}}}'
)


def arrays() -> bytes:
    rng, kept = np.random.default_rng(1), io.BytesIO()
    np.savez_compressed(kept, theta_true=rng.normal(size=(9, 2)), draws=rng.normal(size=(9, 20, 2)))
    return kept.getvalue()


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """Some bytes changed, cut out, doubled or set to what breaks lengths, or the end lost."""
    found = bytearray(content)
    for _ in range(int(rng.integers(1, 6))):
        place, kind = int(rng.integers(len(found))), int(rng.integers(5))
        size = int(rng.integers(1, 17))
        if kind == 0:
            found[place] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            found[place : place + size] = bytes([int(rng.choice([0, 1, 127, 128, 255]))]) * size
        elif kind == 2:
            del found[place : place + size]
        elif kind == 3:
            found[place:place] = found[place : place + size]
        else:
            found[place : place + size] = rng.bytes(size)
        if not found:
            break
    return bytes(found[: int(rng.integers(len(found)))] if found and rng.random() < 0.1 else found)


def outcome(read: Callable[[Path], object], path: Path) -> str:
    """What became of one file, in a process of its own: read, refused, or how that ended."""
    child = os.fork()
    if child == 0:
        code = 3
        try:
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.alarm(SECONDS)
            used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
            read(path)
            code = 0
        except InputError as error:
            code = 1 if "\n" not in str(error) else 4
        except BaseException:
            code = 3
        finally:
            os._exit(code)
    status = os.waitpid(child, 0)[1]
    if os.WIFSIGNALED(status):
        return f"killed by {signal.Signals(os.WTERMSIG(status)).name}"
    return {0: "read", 1: "refused", 4: "several lines"}.get(os.WEXITSTATUS(status), "another error")


def test_mutated_files_end_in_one_line(tmp_path: Path) -> None:
    sound = gzip.decompress((HOSTILE / "sound.nc.gz").read_bytes())
    kinds: dict[str, tuple[bytes, Callable[[Path], object]]] = {
        "trials.nc": (sound, any_trials),
        "trials.npz": (arrays(), any_trials),
        "audit.toml": (TOML, read_config),
        "verdict.json": (JSON, lambda path: finished_audit(path.parent)),
    }
    rng, seen, wrong = np.random.default_rng(20), Counter[str](), []
    for number in range(NUMBER):
        name = list(kinds)[number % len(kinds)]
        content, read = kinds[name]
        path = tmp_path / name
        path.write_bytes(mutated(content, rng))
        found = outcome(read, path)
        seen[f"{name} {found}"] += 1
        if found not in ("read", "refused"):
            wrong.append(f"{number}: {name} {found}")
    assert not wrong, f"{wrong[:10]} of {dict(seen)}"
    for name in kinds:
        assert seen[f"{name} refused"] > NUMBER // 20, seen


@pytest.mark.parametrize("name", ["trials.nc", "audit.toml"])
def test_what_is_sound_is_read(tmp_path: Path, name: str) -> None:
    content = TOML if name == "audit.toml" else gzip.decompress((HOSTILE / "sound.nc.gz").read_bytes())
    (tmp_path / name).write_bytes(content)
    read = read_config if name == "audit.toml" else any_trials
    assert outcome(read, tmp_path / name) == "read"
