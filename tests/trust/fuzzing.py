"""Mutated files of all kinds, each read in a fork of this process; what became of them, as JSON.

What is accepted is read a second time, by a reader that has nothing of ours (`derived`), and held against it.

``python -m tests.trust.corpus FOLDER NUMBER``: a process of its own, warm and with one thread, because one in
which JAX runs already must not fork.
"""

from __future__ import annotations

import gzip
import importlib.util
import io
import os
import resource
import signal
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from tests.trust.derived import DERIVED, within

from gaugeblock.auditing.config import read_config
from gaugeblock.auditing.provenance import finished_audit
from gaugeblock.auditing.trials_from import any_trials
from gaugeblock.core.errors import InputError
from gaugeblock.validate.trials import main_trials

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


def outcome(read: Callable[[Path], dict[str, Any]], path: Path) -> str:
    """What became of one file, in a process of its own: read, refused, or how that ended."""
    child = os.fork()
    if child == 0:
        code = 3
        try:
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.alarm(SECONDS)
            used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
            held = read(path)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                code = 0 if within(DERIVED[path.name](path), held) else 5
        except InputError as error:
            code = 1 if "\n" not in str(error) else 4
        except BaseException:
            code = 3
        finally:
            os._exit(code)
    status = os.waitpid(child, 0)[1]
    if os.WIFSIGNALED(status):
        return f"killed by {signal.Signals(os.WTERMSIG(status)).name}"
    return {0: "read", 1: "refused", 4: "several lines", 5: "read as something else"}.get(
        os.WEXITSTATUS(status), "another error"
    )


def spectrum() -> bytes:
    """A spectrum as OGIP has it."""
    from astropy.io import fits

    columns = [
        fits.Column("CHANNEL", "J", array=np.arange(1, 41)),
        fits.Column("COUNTS", "J", array=np.arange(40) % 7),
        fits.Column("GROUPING", "I", array=np.tile([1, -1], 20)),
    ]
    table = fits.BinTableHDU.from_columns(columns, name="SPECTRUM")
    table.header.update(EXPOSURE=1000.0, DETCHANS=40, RESPFILE="none", HDUCLAS2="TOTAL")
    return written(table)


def response() -> bytes:
    """A response whose rows are of different lengths, which lie apart from the table."""
    from astropy.io import fits

    edges = np.linspace(0.5, 5.0, 31)
    rows = [np.full(1 + k % 5, 1 / (1 + k % 5)) for k in range(30)]
    columns = [
        fits.Column("ENERG_LO", "E", unit="keV", array=edges[:-1]),
        fits.Column("ENERG_HI", "E", unit="keV", array=edges[1:]),
        fits.Column("N_GRP", "I", array=np.ones(30)),
        fits.Column("F_CHAN", "I", array=1 + np.arange(30)),
        fits.Column("N_CHAN", "I", array=[len(row) for row in rows]),
        fits.Column("MATRIX", "PE()", array=np.array(rows, dtype=object)),
    ]
    bounds = [
        fits.Column("CHANNEL", "J", array=np.arange(1, 41)),
        fits.Column("E_MIN", "E", unit="keV", array=np.linspace(0.5, 5.5, 41)[:-1]),
        fits.Column("E_MAX", "E", unit="keV", array=np.linspace(0.5, 5.5, 41)[1:]),
    ]
    return written(
        fits.BinTableHDU.from_columns(columns, name="MATRIX"),
        fits.BinTableHDU.from_columns(bounds, name="EBOUNDS"),
    )


def written(*tables: Any) -> bytes:
    """A FITS file with these extensions."""
    from astropy.io import fits

    kept = io.BytesIO()
    fits.HDUList([fits.PrimaryHDU(), *tables]).writeto(kept)
    return kept.getvalue()


def trials(path: Path) -> dict[str, Any]:
    return {str(name): values.values for name, values in main_trials(any_trials(path)).variables.items()}


def config(path: Path) -> dict[str, Any]:
    """As it was written, with defaults between; tables for anything are as they are."""
    held = read_config(path)
    simulator = {"name": held.simulator.name, **held.simulator.options}
    return {**held.model_dump(), "simulator": simulator, "validators": list(held.validators or ())}


KINDS: dict[str, tuple[bytes, Callable[[Path], dict[str, Any]]]] = {
    "trials.nc": (gzip.decompress((HOSTILE / "sound.nc.gz").read_bytes()), trials),
    "trials.npz": (arrays(), trials),
    "audit.toml": (TOML, config),
    "verdict.json": (JSON, lambda path: finished_audit(path.parent)),
}
if importlib.util.find_spec("astropy") is not None:
    from gaugeblock.simulators.xray.files import load
    from gaugeblock.simulators.xray.pha import load_pha
    from gaugeblock.simulators.xray.rmf import read_rmf

    def pha(path: Path) -> dict[str, Any]:
        held = load_pha("PHA", path)
        return {**vars(held), "grouping": np.zeros(40) if held.grouping is None else held.grouping}

    def rmf(path: Path) -> dict[str, Any]:
        held = load("RMF", path, read_rmf)
        return {**vars(held), "matrix": held.matrix.toarray()}

    KINDS |= {"source.pha": (spectrum(), pha), "source.rmf": (response(), rmf)}


def warm(folder: Path) -> None:
    """Read the sound files once, so that no fork imports what readers import on their way."""
    for name, (content, read) in KINDS.items():
        (folder / name).write_bytes(content)
        read(folder / name)
        DERIVED[name](folder / name)


def fuzzed(folder: Path, number: int) -> dict[str, dict[str, int]]:
    """How often each outcome came, by kind of file; the sound files first, under ``"sound"``."""
    found = {"sound": Counter[str]()} | {name: Counter[str]() for name in KINDS}
    for name, (content, read) in KINDS.items():
        (folder / name).write_bytes(content)
        found["sound"][f"{name} {outcome(read, folder / name)}"] += 1
    rng = np.random.default_rng(20)
    for place in range(number):
        name = list(KINDS)[place % len(KINDS)]
        content, read = KINDS[name]
        (folder / name).write_bytes(mutated(content, rng))
        found[name][outcome(read, folder / name)] += 1
    return {name: dict(counts) for name, counts in found.items()}
