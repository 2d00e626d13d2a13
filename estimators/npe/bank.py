"""The bank of simulations a network is trained on: made once, in chunks that survive an interruption."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.atomic import atomic_path, write_atomically
from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError
from gaugeblock.estimators.npe.coordinates import to_scores
from gaugeblock.simulators.data_sets import check_rows
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.protocol import Described, HasExposures, HasNoise, Simulator

CHUNK = 8192
Progress = Callable[[str, int, int], None]
"""Called as ``progress(stage, done, total)``."""


def stream(seed: int, purpose: str, number: int = 0) -> np.random.Generator:
    """The generator of one purpose and number: no state to store, so a resumed run draws the same."""
    words = [int(b) for b in purpose.encode()]
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(*words, number)))


def describe_simulator(simulator: Simulator) -> dict[str, Any]:
    """Plain data that identifies a simulator; its prior alone where it does not describe itself."""
    if isinstance(simulator, Described):
        description: dict[str, Any] = json.loads(json.dumps(simulator.describe()))
        return description
    return {"simulator": type(simulator).__name__, "prior": simulator.prior.describe()}


def exposures_of(simulator: Simulator) -> tuple[float, float] | None:
    """Ends of the exposures that a simulator's data come with, None where they come with none."""
    return simulator.exposure_distribution.support if isinstance(simulator, HasExposures) else None


@dataclass(frozen=True)
class Bank:
    """Simulations: `scores` ``(n, parameter)`` float32, and either data or their noise-free mean.

    With `fresh` the data are means, and `observe` draws new noise at each call: no network can learn the
    noise of a bank by heart.
    """

    scores: NDArray[np.float32]
    data: NDArray[Any]
    fresh: bool
    simulator: Any

    def __len__(self) -> int:
        return len(self.scores)

    def observe(self, rows: NDArray[np.int64] | slice, rng: np.random.Generator) -> NDArray[Any]:
        """Data of the given rows."""
        return np.asarray(self.simulator.observe(self.data[rows], rng)) if self.fresh else self.data[rows]

    def pairs(
        self, rows: NDArray[np.int64] | slice, rng: np.random.Generator
    ) -> tuple[NDArray[np.float32], NDArray[Any]]:
        """Scores and data of the given rows."""
        return self.scores[rows], self.observe(rows, rng)

    @classmethod
    def simulate(
        cls,
        simulator: Simulator,
        n: int,
        *,
        seed: int,
        folder: Path,
        fresh: bool = True,
        progress: Progress | None = None,
    ) -> Bank:
        """Simulate n rows, reading back what an interrupted run of the same simulator and seed has left.

        Raises
        ------
        InputError
            If the simulator gives data that are not finite, or the wrong number of rows.
        """
        fresh = fresh and isinstance(simulator, HasNoise)
        # Columns are in the prior's order, which a description sorted by names hides.
        said = {"simulator": describe_simulator(simulator), "parameters": list(simulator.prior.names)}
        key = json.dumps({**said, "seed": seed, "chunk": CHUNK, "fresh": fresh}, sort_keys=True)
        place = folder / "bank"
        if place.is_dir() and _read_key(place) != key:
            shutil.rmtree(place)
        place.mkdir(parents=True, exist_ok=True)
        write_atomically(place / "key.json", key)
        chunks = []
        for number, start in enumerate(range(0, n, CHUNK)):
            rows = min(CHUNK, n - start)
            make = partial(_simulate_chunk, simulator, rows, fresh, stream(seed, "bank", number))
            chunks.append(kept(place / f"{number:06d}-{rows}.npz", ("theta", "data"), make))
            if progress is not None:
                progress("simulations", start + rows, n)
        theta, data = (np.concatenate(parts) for parts in zip(*chunks, strict=True))
        return cls(to_scores(simulator.prior, theta).astype(np.float32), data, fresh, simulator)


def fingerprint(prior: Prior, values: Any) -> str:
    """Short sha256 of plain data and a prior, for resume keys."""
    return digest({"prior": prior.describe(), "values": values})[:16]


def _simulate_chunk(
    simulator: Any, rows: int, fresh: bool, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[Any]]:
    theta = simulator.prior.sample(rows, rng)
    data = np.asarray(simulator.expected(theta) if fresh else simulator.simulate(theta, rng))
    check_rows(data, rows)
    if not np.all(np.isfinite(data)):
        bad = int(np.flatnonzero(~np.isfinite(data.reshape(rows, -1)).all(axis=1))[0])
        values = ", ".join(f"{k}={v:.6g}" for k, v in zip(simulator.prior.names, theta[bad], strict=True))
        raise InputError(
            f"the simulator gave data that are not finite at {values}; a flow cannot train on them"
        )
    return theta, data.astype(np.float32) if fresh else data


def kept(
    path: Path, names: tuple[str, ...], make: Callable[[], tuple[NDArray[Any], ...]]
) -> tuple[NDArray[Any], ...]:
    """Arrays that an interrupted run has left in a file, or made now and left there for the next one."""
    try:
        with np.load(path) as stored:
            return tuple(stored[name] for name in names)
    except (OSError, ValueError, KeyError, BadZipFile):
        arrays = make()
    content: dict[str, Any] = dict(zip(names, arrays, strict=True))
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **content)
    return arrays


def _read_key(place: Path) -> str | None:
    try:
        return (place / "key.json").read_text()
    except OSError:
        return None
