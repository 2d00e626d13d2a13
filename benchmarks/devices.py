"""The same work on one core, on all of them and on a GPU: python -m benchmarks.devices [--rows ROW ...]

Each row in processes of its own: elapsed seconds, the median of equal repeats after one that is not counted
(it compiles), and how far the GPU's numbers are from the CPU's. A command counts whole, with its start and
imports. Rows that are in the JSON file already are not measured again. `--page` fills docs/performance.md.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from benchmarks.kept import arguments, keep, stored
from benchmarks.processes import ONE_CORE, ran
from numpy.typing import NDArray
from studies.kit import page

from gaugeblock.core.errors import InputError

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
PLACES = {"one core": "cpu", "all cores": "cpu", "GPU": "cuda"}
REPEATS, SPECTRA, DRAWS, SIMULATED = 5, 200, 1000, 20_000
# Steps of a training that are not counted, and those that are.
BEFORE, STEPS = 50, 200

Arrays = tuple[NDArray[Any], ...]
Measured = tuple[list[float], Arrays]


def repeated(work: Callable[[], Arrays]) -> Measured:
    """Seconds of each repeat, and what the last one gave."""
    found, taken = work(), []
    for _ in range(REPEATS):
        start = time.perf_counter()
        found = work()
        taken.append(time.perf_counter() - start)
    return taken, found


def reference(level: str) -> Any:
    """The simulator of a reference case."""
    from gaugeblock.simulators import build_simulator

    return build_simulator("xray", response="epic-pn", level=level)


def spectra(simulator: Any, number: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Parameters and counts, on every device the same: rounding in the twelfth digit decides no count."""
    rng = np.random.default_rng(1)
    theta = simulator.prior.sample(number, rng)
    return theta, rng.poisson(simulator.expected(theta))


def shipped(level: str) -> tuple[Any, Any, NDArray[Any]]:
    """A shipped flow, its simulator, and counts of `SPECTRA` spectra."""
    from gaugeblock.estimators.npe import load

    simulator = reference(level)
    return load(f"shipped:epic-pn-{level}", simulator), simulator, spectra(simulator, SPECTRA)[1]


def draws(level: str) -> Measured:
    """Draws of a shipped flow, with their densities; draws are compared as normal scores."""
    from gaugeblock.estimators.npe.coordinates import to_scores

    flow, simulator, x = shipped(level)
    taken, (drawn, log_q) = repeated(lambda: flow.sample_and_log_prob(x, DRAWS, np.random.default_rng(2)))
    return taken, (to_scores(simulator.prior, drawn), log_q)


def densities(level: str) -> Measured:
    """Densities of given parameters under a shipped flow."""
    flow, simulator, x = shipped(level)
    theta = np.broadcast_to(spectra(simulator, DRAWS)[0], (SPECTRA, DRAWS, simulator.prior.size))
    return repeated(lambda: (flow.log_prob(theta, x),))


def summaries(level: str) -> Measured:
    """What a shipped flow makes of spectra before it draws."""
    flow, _, x = shipped(level)
    x = np.resize(x, (SIMULATED, *flow.data_shape))
    return repeated(lambda: (flow.embed(x),))


def expected(level: str) -> Measured:
    """Expected counts, in double precision."""
    simulator = reference(level)
    theta = simulator.prior.sample(SIMULATED, np.random.default_rng(1))
    return repeated(lambda: (simulator.expected(theta),))


def likelihoods(level: str) -> Measured:
    """Likelihoods of many parameters for one spectrum each."""
    simulator = reference(level)
    theta, x = spectra(simulator, SIMULATED)
    return repeated(lambda: (simulator.log_likelihood(theta, x),))


class _Enough(Exception):
    """So many steps have been counted."""


def training(level: str, stage: str) -> Measured:
    """Seconds of `STEPS` of a shipped flow's training; two trainings drift apart, so nothing is compared."""
    from gaugeblock.estimators.npe import read_config, train

    config = read_config(
        ROOT / "examples" / f"train-epic-pn-{level}.toml",
        overrides={"training.simulations": SIMULATED, "training.threads": len(os.sched_getaffinity(0))},
    )
    at: list[float] = []

    def told(now: str, done: int, total: int) -> None:  # noqa: ARG001
        if now == stage:
            at.append(time.perf_counter())
            if len(at) > BEFORE + STEPS:
                raise _Enough

    with tempfile.TemporaryDirectory() as folder:
        try:
            train(reference(level), config, folder=f"{folder}/model", progress=told)
        except _Enough:
            return [at[BEFORE + STEPS] - at[BEFORE]], ()
    raise InputError(f"the training of {level} has no {BEFORE + STEPS} steps of {stage!r}")


@dataclass(frozen=True)
class Row:
    """Work in a process of its own, or words of a command of gaugeblock."""

    says: str
    work: Callable[[], Measured] | None = None
    command: Sequence[str] = ()


ROWS: Mapping[str, Row] = {
    "draws": Row("200,000 draws and densities, default flow", lambda: draws("medium")),
    "laplace": Row("the same, Laplace flow", lambda: draws("bright")),
    "densities": Row("200,000 densities asked for, default flow", lambda: densities("medium")),
    "summaries": Row("summaries of 20,000 spectra", lambda: summaries("medium")),
    "training": Row("200 steps of training, default flow", lambda: training("medium", "steps")),
    "emulator": Row("200 steps of a Laplace flow's emulator", lambda: training("bright", "emulator")),
    "expected": Row("expected counts of 20,000 spectra", lambda: expected("medium")),
    "likelihoods": Row("likelihoods of 20,000 parameters", lambda: likelihoods("medium")),
    "audit": Row("the default audit, whole", command=("audit", "--quiet")),
}  # fmt: skip


def apart(found: Arrays, other: Arrays) -> float | None:
    """The largest difference, in units of one plus the number's size; None where nothing is compared.

    >>> apart((np.array([1.0, 3.0]),), (np.array([1.0, 3.4]),))
    0.1
    """
    worst = [float(np.max(np.abs(a - b) / (1.0 + np.abs(a)))) for a, b in zip(found, other, strict=True)]
    return float(f"{max(worst):.2g}") if worst else None


def measured(name: str, place: str, folder: Path) -> tuple[list[float], Arrays]:
    """A row at one of the places.

    Raises
    ------
    InputError
        If what is timed fails.
    """
    row, out = ROWS[name], folder / f"{name}.npz"
    env = {**os.environ, "GAUGEBLOCK_DEVICE": PLACES[place], "XLA_PYTHON_CLIENT_PREALLOCATE": "false"}
    words = [sys.executable, "-m", "benchmarks.devices", "--one", name, "--out", str(out)]
    if row.command:
        words = [sys.executable, "-m", "gaugeblock", *row.command, "--out", str(folder / "audit")]
        if place == "all cores":
            words += ["--workers", str(len(os.sched_getaffinity(0)))]
    if place == "one core":
        env |= ONE_CORE
        words = ["taskset", "-c", str(min(os.sched_getaffinity(0))), *words]
    start = time.perf_counter()
    ran(words, f"{row.says}, {place}", cwd=ROOT, env=env, verdict=bool(row.command))
    elapsed = time.perf_counter() - start
    if row.command:
        return [elapsed], ()
    with np.load(out) as kept:
        return list(kept["seconds"]), tuple(kept[f"array{k}"] for k in range(len(kept.files) - 1))


def compared(names: Sequence[str], path: Path) -> dict[str, Any]:
    """Measure each row that the file lacks at every place, and keep it at once."""
    import torch

    found, here = stored(path), {"cores": len(os.sched_getaffinity(0)), "GPU": torch.cuda.get_device_name(0)}
    if (there := {key: found.get(key, here[key]) for key in here}) != here:
        raise InputError(f"{path.name} was measured on {there}, and this is {here}: take another --out")
    rows = found.setdefault("rows", {})
    for name in names:
        if name not in rows:
            taken: dict[str, Any] = {}
            arrays: dict[str, Arrays] = {}
            for place in PLACES:
                with tempfile.TemporaryDirectory() as folder:
                    seconds, arrays[place] = measured(name, place, Path(folder))
                taken[place] = [round(float(second), 4) for second in seconds]
            taken["apart"] = apart(arrays["all cores"], arrays["GPU"])
            rows[name] = taken
        found |= here
        keep(found, path, "python -m benchmarks.devices")
        sys.stderr.write(f"{ROWS[name].says}: {rows[name]}\n")
    return found


def shown(found: Mapping[str, Any]) -> str:
    """The table of docs/performance.md."""
    cells = []
    for name, row in ROWS.items():
        if name in found["rows"]:
            taken = found["rows"][name]
            one, every, gpu = (median(taken[place]) for place in PLACES)
            times = [f"{seconds:.3g}" for seconds in (one, every, gpu)]
            differs = "" if taken["apart"] is None else f"{taken['apart']:.1g}"
            cells.append([row.says, *times, f"{one / gpu:.3g}", f"{every / gpu:.2g}", differs])
    header = ["", "one core (s)", f"{found['cores']} cores (s)", f"{found['GPU']} (s)"]
    return page.table([*header, "one core / GPU", "all cores / GPU", "apart"], cells)


def main(words: Sequence[str] | None = None) -> int:
    """Measure, or fill the page."""
    options = arguments(__doc__, "rows", ROWS, HERE / "devices.json")
    options.add_argument("--one", choices=ROWS, help="one row, here and now, its numbers into --out")
    chosen = options.parse_args(words)
    if chosen.page:
        page.fill(chosen.docs / "performance.md", {"devices": shown(stored(chosen.out))})
    elif chosen.one:
        work = ROWS[chosen.one].work
        assert work is not None, "a command is no work of this process"
        seconds, arrays = work()
        np.savez(chosen.out, seconds=seconds, **{f"array{k}": a for k, a in enumerate(arrays)})
    else:
        compared(chosen.rows, chosen.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
