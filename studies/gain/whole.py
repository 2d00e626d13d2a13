"""Whole catalogues, analysed as a user would: the population fitted, the amplitude profiled."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name.marginal import marginal_scores
from gaugeblock.discovery.name.shared_profile import profile_models
from gaugeblock.discovery.name.stacked import stack
from gaugeblock.discovery.sources import Sources
from studies.gain.models import GAINS, TabulatedShared
from studies.gain.pools import CHUNK, DRAWS, GainPool
from studies.gain.table import said_by


def sources_of(pool: GainPool, size: int, seed: int, *, catalogue: int = 0) -> Sources:
    """One of the catalogues of `size` spectra into which a pool falls, in order."""
    first, last = catalogue * size, min((catalogue + 1) * size, pool.number)
    chunks = range(first // CHUNK, -(-last // CHUNK))
    counts = np.concatenate([pool.draw(chunk, seed)[1] for chunk in chunks])
    start = first - chunks[0] * CHUNK
    return Sources.of(pool.model, counts[start : start + last - first], scale=pool.scale)


def profiled(pool: GainPool, name: str, size: int, seed: int, catalogue: int) -> dict[str, float]:
    """Profile of a gain on one catalogue of a pool; `gain` is in log likelihood, interval of 90%."""
    sources = sources_of(pool, size, seed, catalogue=catalogue)
    shared: Any = TabulatedShared(name, pool.steps[name], pool.spectrum)
    fits = fit(sources.simulator, sources.counts, scale=sources.scale)
    found = profile_models([shared], [sources], fits=[fits])
    low, high = found.interval(0.9)
    neutral = GAINS[name].neutral
    return {
        "truth": pool.value - neutral,
        "value": found.value - neutral,
        "standard_error": found.standard_error,
        "sandwich_error": found.sandwich_error,
        "low": low - neutral,
        "high": high - neutral,
        "z": found.z,
        "gain": found.gain,
        "converged": float(found.converged),
    }


def marginalised(pool: GainPool, size: int, seed: int) -> dict[str, float]:
    """Marginal score of the published gain on a whole catalogue, its population fitted."""
    sources = sources_of(pool, size, seed)
    shared: Any = TabulatedShared("published_gain", pool.steps["published_gain"], pool.spectrum)
    fits = fit(sources.simulator, sources.counts, scale=sources.scale)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=[2]))
    found = marginal_scores(shared, sources, fits, draws=DRAWS, rng=rng)
    return said_by(stack(found.efficient())) | {"effective": float(np.median(found.effective))}


def as_dataset(rows: dict[str, dict[str, float]]) -> xr.Dataset:
    """Rows by case as a Dataset with dim ``case``."""
    names = list(next(iter(rows.values()))) if rows else []
    return xr.Dataset(
        {name: ("case", np.array([row[name] for row in rows.values()])) for name in names},
        coords={"case": list(rows)},
    )
