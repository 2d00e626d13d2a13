"""A catalogue: many sources from a folder, those that share a response in one simulator."""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.simulators.marginals import Normal
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray.build import Priors, settled
from gaugeblock.simulators.xray.files import FilePath
from gaugeblock.simulators.xray.measured_background import WIDEST, MeasuredBackground
from gaugeblock.simulators.xray.observation import Observation, model_prior, source_counts
from gaugeblock.simulators.xray.reader import Reader, Reading, Spectrum
from gaugeblock.simulators.xray.siblings import Siblings
from gaugeblock.simulators.xray.simulator import XraySpectrum
from gaugeblock.simulators.xray.with_background import WithBackground

T = TypeVar("T")

STEP = 1.25
"""Scales that differ by more than this factor are never made equal."""


def with_equal_scales(items: Sequence[T], spectrum: Callable[[T], Spectrum]) -> list[list[T]]:
    """Those without background first, then groups whose scales differ by less than a quarter."""
    scales = [spectrum(item).background_scale for item in items]
    levels = np.array([0.0 if scale is None else float(np.exp(np.log(scale).mean())) for scale in scales])
    groups: list[list[T]] = []
    top = -1.0
    for i in np.argsort(-levels, kind="stable"):
        if not groups or levels[i] * STEP < top or (levels[i] == 0.0 and top > 0.0):
            groups.append([])
            top = levels[i]
        groups[-1].append(items[i])
    return groups


def thinned(spectra: Sequence[Spectrum], seeds: Sequence[Sequence[int]]) -> tuple[Array, Array]:
    """The largest scale ``(channel,)``, and counts ``(source, channel)`` of background regions thinned to it.

    A count in a background region of smaller scale, which stands for less in the source region, is kept with
    the ratio of the scales as its probability: the counts stay Poisson, exactly, with the larger scale.
    """
    scales = np.array([spectrum.background_scale for spectrum in spectra])
    scale = scales.max(axis=0)
    counts = [
        np.random.default_rng(list(seed)).binomial(
            np.asarray(spectrum.background), np.minimum(own / scale, 1.0)
        )
        for spectrum, own, seed in zip(spectra, scales, seeds, strict=True)
    ]
    return scale, np.array(counts, dtype=float)


def pooled(spectra: Sequence[Spectrum], scale: Array, counts: Array) -> MeasuredBackground:
    """The shape fitted to all background regions together; its prior as wide as they differ in level."""
    response = spectra[0].response
    exposures = np.array([spectrum.exposure for spectrum in spectra])
    background = MeasuredBackground.fit(
        counts.sum(axis=0),
        scale,
        response.channels,
        exposure=float(exposures.sum()),
        width=response.width,
    )
    if len(spectra) == 1:
        return background
    level = np.log((counts.sum(axis=1) + 0.5) / exposures)
    spread = float(np.clip(1.5 * level.std(ddof=1), 0.5, WIDEST))
    shift = float(level.mean() - np.log((counts.sum() + 0.5) / exposures.sum()))
    marginals = {
        # Lines stand on the level: they move with it.
        name: marginal
        if ".line_" in name
        else Normal(marginal.center + shift, max(spread, getattr(marginal, "sd", spread)))
        for name, marginal in background.prior.marginals.items()
    }
    return MeasuredBackground(background.shape, scale, Prior(marginals))


Progress = Callable[[int, int], None]

PATTERNS = (("*.pha", "*.pha.gz"), ("*.fits", "*.fits.gz", "*.pi", "*.pi.gz"))
"""What spectra are called; the second row is looked for where there is none of the first."""


@dataclass(frozen=True)
class Entry:
    """A source of a catalogue: its spectrum, name and redshift."""

    pha: Path
    name: str
    redshift: float


@dataclass(frozen=True, eq=False)
class _Source:
    entry: Entry
    reading: Reading


def entries(folder: FilePath) -> tuple[Entry, ...]:
    """The sources of a folder: those of its ``catalog.csv`` (pha, redshift), or else every spectrum in it.

    Paths in ``catalog.csv`` are relative to it; a column ``name`` is used where there is one, and a missing
    redshift is 0.

    Raises
    ------
    InputError
        If there is no such folder, no spectrum in it, or a line cannot be understood.
    """
    root = Path(folder)
    if not root.is_dir():
        raise InputError(f"catalogue {root}: no such folder")
    table = root / "catalog.csv"
    if table.is_file():
        return _listed(table)
    for patterns in PATTERNS:
        found = sorted({path for pattern in patterns for path in root.glob(pattern)})
        if found:
            return tuple(Entry(path, path.name, 0.0) for path in found)
    raise InputError(f"catalogue {root}: holds neither catalog.csv nor any *.pha")


def _listed(table: Path) -> tuple[Entry, ...]:
    with open(table, newline="", encoding="utf-8-sig") as file:
        rows = csv.DictReader(file, skipinitialspace=True)
        if "pha" not in (rows.fieldnames or ()):
            raise InputError(f"{table}: needs a header line with the columns pha and redshift")
        found = [_entry(table, rows.line_num, row) for row in rows]
    if not found:
        raise InputError(f"{table}: lists no spectrum")
    return tuple(found)


def _entry(table: Path, line: int, row: dict[str, Any]) -> Entry:
    pha, text = (row["pha"] or "").strip(), (row.get("redshift") or "").strip()
    if not pha:
        raise InputError(f"{table}, line {line}: names no pha")
    try:
        redshift = float(text or 0.0)
    except ValueError:
        redshift = np.nan
    if not (np.isfinite(redshift) and redshift > -1):
        raise InputError(f"{table}, line {line}: redshift {text!r} is not a number above -1")
    return Entry(table.parent / pha, (row.get("name") or "").strip() or Path(pha).name, redshift)


def read_catalog(
    folder: FilePath,
    *,
    model: str,
    priors: Priors = None,
    rmf: FilePath | None = None,
    arf: FilePath | None = None,
    background: bool = True,
    band: tuple[float, float] | None = None,
    regroup: str = "ungrouped",
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[Observation, ...]:
    """Read a catalogue: an `Observation` for every response, channels and background scale that differ.

    Sources of one response share their simulator, and `Observation.scale` has their exposures. Backgrounds of
    different scale cannot share one as they are: within steps of a quarter, counts of background regions are
    thinned, each kept with the probability that makes the scales equal, which leaves them Poisson and costs
    a fifth of them at most.

    Parameters
    ----------
    folder : path
        See `entries`.
    model, priors, band, regroup
        See `read_observation`. Default norms suit the faintest and the brightest source.
    rmf, arf : path, optional
        For all spectra, instead of those that headers name.
    background : bool
        Whether to use the backgrounds that headers name.
    seed : int
        Of the thinning; every source has a stream of its own, by its name.
    progress : callable, optional
        Told how many spectra of how many have been read.

    Raises
    ------
    InputError
        In one line that names the file, if one is missing or unreadable, or they do not fit together.
    """
    model, given = settled(model, priors)
    listed = entries(folder)
    reader = Reader(band=band, regroup=regroup, reached=True)
    sources = []
    for done, entry in enumerate(listed, start=1):
        without = None if background else "none"
        sources.append(_Source(entry, reader.read(entry.pha, rmf, arf, without)))
        if progress is not None:
            progress(done, len(listed))
    groups = _by(sources, lambda source: source.reading.identity)
    prior = _prior(model, given, groups)
    return tuple(observation for group in groups for observation in _observations(model, prior, group, seed))


def _by(sources: Iterable[_Source], key: Callable[[_Source], Any]) -> list[list[_Source]]:
    """Sources of equal key together, in order of first appearance."""
    groups: dict[Any, list[_Source]] = {}
    for source in sources:
        groups.setdefault(key(source), []).append(source)
    return list(groups.values())


def _prior(model: str, given: Prior | None, groups: Sequence[Sequence[_Source]]) -> Prior:
    """One prior for all, its norms those of the largest group's response and of all the sources' rates."""
    largest = max(groups, key=len)[0].reading.spectrum.response
    area = largest.with_exposure(1.0).sparse.sum()
    counts, seconds = [], []
    for group in groups:
        share = area / group[0].reading.spectrum.response.with_exposure(1.0).sparse.sum()
        for source in group:
            spectrum = source.reading.spectrum
            counts.append([source_counts(spectrum).sum() * share])
            seconds.append(spectrum.exposure)
    return model_prior(model, given, largest, np.array(counts), np.array(seconds))


def _observations(model: str, prior: Prior, group: Sequence[_Source], seed: int) -> Iterable[Observation]:
    """The sources of one response: those without background, and those of each background scale."""
    exposures = np.array([source.reading.spectrum.exposure for source in group])
    exposure = float(np.exp(np.median(np.log(exposures))))
    response = group[0].reading.spectrum.response.with_exposure(exposure)
    source = XraySpectrum(model, response, prior, integration="exact")
    siblings = Siblings()
    for part in with_equal_scales(group, lambda one: one.reading.spectrum):
        spectra = [one.reading.spectrum for one in part]
        counts = np.array([spectrum.counts for spectrum in spectra], dtype=float)
        simulator: Any = source
        if spectra[0].background is not None:
            seeds = [(seed, _number(one.entry.name)) for one in part]
            scale, behind = thinned(spectra, seeds)
            simulator = WithBackground(source, pooled(spectra, scale, behind), siblings=siblings)
            counts = np.concatenate([counts, behind], axis=1)
        yield Observation(
            simulator,
            counts,
            np.array([spectrum.exposure for spectrum in spectra]) / exposure,
            np.array([one.entry.redshift for one in part]),
            tuple(one.entry.name for one in part),
        )


def _number(name: str) -> int:
    """A source's own number, whatever else the catalogue holds."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:8])
