"""Pools of simulated spectra, fitted once: their scores are resampled into any number of catalogues."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache, partial
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.core.digest import digest
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name.marginal import marginal_scores
from gaugeblock.discovery.name.shared_score import SharedScores, join, shared_scores
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators.effects import Effect
from studies.gain.models import (
    EXACT,
    GAINS,
    JAXSPEC,
    MEDIUM,
    PARAMETERS,
    Spectrum,
    TabulatedShared,
    nuisance_templates,
)
from studies.kit.resume import Pieces, joined

CHUNK = 500
"""Spectra that are simulated, fitted and stored together."""


@dataclass(frozen=True)
class GainPool:
    """Spectra of one level with one hidden gain. `steps` are those of the templates, by effect."""

    level: str
    hidden: str
    value: float
    number: int
    marginal: int = 0
    """How many of them have marginal scores of `published_gain` too."""
    spectrum: Spectrum = JAXSPEC
    small: bool = False

    @property
    def name(self) -> str:
        """Of its checkpoint."""
        hidden = f"{self.hidden}_{self.value:g}" if self.hidden else "clean"
        return f"{self.level}_{hidden}{'_small' if self.small else ''}"

    @property
    def steps(self) -> dict[str, float]:
        """Half widths of the templates' differences: of the size of what is looked for."""
        if self.small:
            return {"published_gain": 0.006, "gain_slope": 0.004, "gain_offset": 0.01}
        return {"published_gain": 0.03, "gain_slope": 0.01, "gain_offset": 0.01}

    @property
    def scale(self) -> float:
        """Exposure in units of a bright spectrum's."""
        return MEDIUM if self.level == "medium" else 1.0

    @property
    def model(self) -> Any:
        """What is fitted: the spectrum without a gain."""
        return self.spectrum.fitted

    @property
    def flow(self) -> str:
        """A shipped one that was trained on such spectra, if any was when this was measured."""
        return "shipped:epic-pn-medium" if self.level == "medium" else ""

    def draw(self, chunk: int, seed: int) -> tuple[Array, Array]:
        """Theta and counts of one chunk, by the simulator itself."""
        key = [int(digest([self.name, chunk])[:8], 16)]
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
        simulator = simulator_of(self.spectrum, self.hidden, self.value)
        theta = simulator.prior.sample(CHUNK, rng)
        return theta, rng.poisson(simulator.expected(theta) * self.scale).astype(float)

    def again(self, theta: Array, _seed: int, rng: np.random.Generator) -> Array:
        """Other counts of the same sources, without a gain."""
        return rng.poisson(self.model.expected(theta) * self.scale).astype(float)


@dataclass(frozen=True, eq=False)
class ScoredPool:
    """A pool's scores: templates are the slope and the published gain, nuisances those of `models`."""

    scores: SharedScores
    marginal: Array
    population: Array


DRAWS = 192
"""Posterior draws a spectrum."""

TEMPLATES = ("published_gain", "gain_slope")

LARGE = tuple((name, value) for name in TEMPLATES for value in (1.03, 0.97))
"""Gains of 3 per cent: effect and value."""


@cache
def simulator_of(spectrum: Spectrum, hidden: str, value: float) -> Any:
    """The simulator that hides a gain, compiled once."""
    simulator = spectrum.simulator
    return simulator.with_effect(Effect(hidden, {GAINS[hidden].amplitude: value})) if hidden else simulator


def score(pool: GainPool, chunk: int, seed: int, number: int) -> dict[str, Array]:
    """Scores of one chunk, as arrays to be stored."""
    counts = pool.draw(chunk, seed)[1][:number]
    sources = Sources.of(pool.model, counts, scale=pool.scale)
    fitted = fit(sources.simulator, counts, scale=sources.scale, seed=chunk)
    spectrum, theta = pool.spectrum, fitted.theta[:, :PARAMETERS]
    shared = [TabulatedShared(name, pool.steps[name], spectrum.source) for name in TEMPLATES]
    values = [s.templates(theta, s.neutral, sources.scale, sources.redshift) for s in shared]
    beside = nuisance_templates(theta, sources.scale, spectrum.source, pool.steps)
    templates = spectrum.over(np.concatenate(values, axis=1))
    found = shared_scores(counts, fitted, templates, spectrum.over(beside))
    return {name.name: getattr(found, name.name).astype(np.float32) for name in fields(found)}


def marginal(pool: GainPool, chunk: int, seed: int, number: int) -> dict[str, Array]:
    """Marginal scores of the published gain in one chunk, and of the population, at the prior.

    The prior is the truth here; a catalogue's own tilt is fitted in `whole`.
    """
    counts = pool.draw(chunk, seed)[1][:number]
    sources = Sources.of(pool.model, counts, scale=pool.scale)
    fitted = fit(sources.simulator, counts, scale=sources.scale, seed=chunk)
    shared: Any = TabulatedShared("published_gain", pool.steps["published_gain"], pool.spectrum)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=[chunk, 1]))
    found = marginal_scores(shared, sources, fitted, draws=DRAWS, iterations=0, rng=rng)
    return {"marginal": found.score, "population": found.population}


def scored(pool: GainPool, pieces: Pieces, *, seed: int) -> ScoredPool:
    """All of a pool, chunk after chunk."""
    wanted, averaged = {}, {}
    for chunk in range(-(-pool.number // CHUNK)):
        number = min(CHUNK, pool.number - chunk * CHUNK)
        wanted[f"{pool.name}_{number}_{chunk}"] = partial(score, pool, chunk, seed, number)
        if chunk * CHUNK < pool.marginal:
            averaged[f"{pool.name}_marginal_{number}_{chunk}"] = partial(marginal, pool, chunk, seed, number)
    parts = _floats(pieces.made(wanted, kind=pool.name))
    others = _floats(pieces.made(averaged, kind=f"{pool.name}, marginal")) if averaged else []
    names = [field.name for field in fields(SharedScores)]
    return ScoredPool(
        join([SharedScores(*(part[name] for name in names)) for part in parts]),
        joined(others, "marginal") if others else np.empty((0, 1)),
        joined(others, "population") if others else np.empty((0, 0)),
    )


def _floats(made: dict[str, Any]) -> list[dict[str, Array]]:
    return [{name: values.astype(float) for name, values in part.items()} for part in made.values()]


def pools(*, share: float = 1.0) -> dict[str, GainPool]:
    """All pools by name; `share` makes them smaller, for tests."""

    def n(number: int) -> int:
        return max(2, round(number * share))

    found = [
        GainPool("bright", "", 0.0, n(10_000)),
        *(GainPool("bright", "published_gain", value, n(10_000)) for value in (1.03, 0.97)),
        *(GainPool("bright", "gain_slope", value, n(5_000)) for value in (1.03, 0.97)),
        GainPool("medium", "", 0.0, n(10_000), n(10_000)),
        *(GainPool("medium", "published_gain", value, n(10_000), n(4_000)) for value in (1.03, 0.97)),
        *(GainPool("medium", "gain_slope", value, n(5_000)) for value in (1.03, 0.97)),
        GainPool("bright", "", 0.0, n(20_000), spectrum=EXACT, small=True),
        *(
            GainPool("bright", name, value, n(5_000), spectrum=EXACT, small=True)
            for name in ("published_gain", "gain_slope")
            for value in (1.003, 0.997)
        ),
    ]
    return {pool.name: pool for pool in found}
