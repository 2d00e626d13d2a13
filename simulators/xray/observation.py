"""From files to a simulator and the data that it should explain: one source, one or several instruments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray import data
from gaugeblock.simulators.xray.build import Priors, settled
from gaugeblock.simulators.xray.default_priors import default_prior
from gaugeblock.simulators.xray.expression import parameter_names, parse, with_sources
from gaugeblock.simulators.xray.files import FilePath
from gaugeblock.simulators.xray.joining import joint_spectra
from gaugeblock.simulators.xray.reader import Reader, Reading, Spectrum
from gaugeblock.simulators.xray.response import Response
from gaugeblock.simulators.xray.simulator import XraySpectrum
from gaugeblock.simulators.xray.with_background import with_background

Files = FilePath | Sequence[FilePath] | None
Band = tuple[float, float]
Bands = Band | Sequence[Band] | None
"""Energies in keV: of all spectra, or of one each."""


@dataclass(frozen=True, eq=False)
class Observation:
    """Counts of one source or of many that share a simulator.

    Attributes
    ----------
    simulator
        `XraySpectrum`, `WithBackground` or `JointSpectra`.
    counts : ndarray, shape (source, channel)
    scale : ndarray, shape (source,)
        Exposure in units of the simulator's.
    redshift : ndarray, shape (source,)
    names : tuple of str
    """

    simulator: Any
    counts: Array
    scale: Array
    redshift: Array
    names: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.counts)


def read_observation(
    pha: FilePath | Sequence[FilePath],
    *,
    model: str,
    priors: Priors = None,
    rmf: Files = None,
    arf: Files = None,
    background: Files = None,
    band: Bands = None,
    exposure: float | None = None,
    redshift: float = 0.0,
    names: Sequence[str] | None = None,
    regroup: str = "ungrouped",
    sys_err: bool = False,
) -> Observation:
    """One source from its spectrum, or from several instruments' spectra.

    Parameters
    ----------
    pha : path or sequence of paths
    model : str
        Model expression, or a file that XSPEC saved (``.xcm``).
    priors : Prior, name, path or table, optional
        As `build` takes them; parameters that they leave out have `default_prior`.
    rmf, arf, background : path or sequence of paths, optional
        Instead of those that headers name, one a spectrum; a background ``"none"`` does without.
    band : (low, high) or a sequence of them, optional
        Energies in keV, of all spectra or of one each.
    exposure : float, optional
        Seconds, instead of the header's; for a single spectrum.
    redshift : float
        Of the source: redshifts of the model that `priors` leave out are frozen at it.
    names : sequence of str, optional
        Of the instruments; else what the headers call them, or the files.
    regroup : {"ungrouped", "never", "always"}
        Whether channels are grouped by the detector's resolution; existing groups are kept by default.
    sys_err : bool
        Whether SYS_ERR is used as scatter beyond Poisson's, instead of being noted.

    Raises
    ------
    InputError
        In one line that names the file, if one is missing or unreadable, or they do not fit together.
    """
    paths = [pha] if isinstance(pha, str | Path) or not isinstance(pha, Sequence) else list(pha)
    if not paths:
        raise InputError("spectra: none given; name at least one PHA file")
    if exposure is not None and len(paths) > 1:
        raise InputError("exposure: can be given for a single spectrum only; correct the headers instead")
    readers = [
        Reader(band=one, regroup=regroup, reached=True, sys_err=sys_err) for one in _bands(band, len(paths))
    ]
    columns = [_each(role, files, len(paths)) for role, files in (("rmf", rmf), ("arf", arf))]
    behind = _each("background", background, len(paths))
    readings = [
        _shared(reader.read(_shipped(path) or path, _shipped(r), _shipped(a), _shipped(b), exposure=exposure))
        for reader, path, r, a, b in zip(readers, paths, *columns, behind, strict=True)
    ]
    model, given = settled(model, priors)
    model = at_redshift(model, given, redshift)
    prior = model_prior(
        model, given, readings[0].spectrum.response, source_counts(readings[0].spectrum)[None]
    )
    made = [_simulator(model, reading.spectrum, prior) for reading in readings]
    simulator = made[0][0]
    if len(made) > 1:
        simulator = joint_spectra([s for s, _ in made], names or _instruments(paths, readings))
    counts = np.concatenate([counts for _, counts in made])
    name = Path(paths[0]).name
    return Observation(simulator, counts[None], np.ones(1), np.array([float(redshift)]), (name,))


def _shared(reading: Reading) -> Reading:
    """A spectrum whose programs others of its instrument can use: many are searched once, each by itself."""
    response = replace(reading.spectrum.response, shared=True)
    return replace(reading, spectrum=replace(reading.spectrum, response=response))


def _each(role: str, files: Files, number: int) -> list[FilePath | None]:
    if files is None:
        return [None] * number
    listed = [files] if isinstance(files, str | Path) or not isinstance(files, Sequence) else list(files)
    if len(listed) == 1 and str(listed[0]).lower() == "none":
        return [listed[0]] * number
    if len(listed) != number:
        raise InputError(f"{role}: {len(listed)} given for {number} spectra; give one for each")
    return list(listed)


def _bands(given: Bands, number: int) -> list[Band | None]:
    if given is None:
        return [None] * number
    try:
        low, high = np.asarray(given, dtype=float).T
    except (TypeError, ValueError):
        raise InputError(
            f"band: give (low, high) in keV, or one such pair a spectrum; got {given!r}"
        ) from None
    if low.ndim == 0:
        low, high = np.repeat(low, number), np.repeat(high, number)
    if len(low) != number:
        raise InputError(f"band: {len(low)} given for {number} spectra; give one for all or one for each")
    return list(zip(low.tolist(), high.tolist(), strict=True))


def _shipped(file: FilePath | None) -> FilePath | None:
    """A file, or one that `gaugeblock data fetch` brings, where no other has that name."""
    if file is None or Path(file).is_file() or Path(file).name != str(file):
        return file
    known = {Path(name).name: name for name in data.files()}
    return data.path(known[str(file)]) if str(file) in known else file


def _simulator(model: str, spectrum: Spectrum, prior: Prior) -> tuple[Any, Array]:
    source = XraySpectrum(model, spectrum.response, prior, integration="exact")
    counts = spectrum.counts.astype(float)
    if spectrum.background is None or spectrum.background_scale is None:
        return source, counts
    joint = with_background(source, spectrum.background, spectrum.background_scale)
    return joint, np.concatenate([counts, spectrum.background])


def _instruments(paths: Sequence[FilePath], readings: Sequence[Reading]) -> list[str]:
    named = [reading.instrument.lower() for reading in readings]
    return named if all(named) and len(set(named)) == len(named) else [Path(path).stem for path in paths]


def source_counts(spectrum: Spectrum) -> Array:
    """Counts ``(channel,)`` with the scaled background taken off, a tenth of them at least."""
    counts = spectrum.counts.astype(float)
    if spectrum.background is None or spectrum.background_scale is None:
        return counts
    left = counts.sum() - float((spectrum.background * spectrum.background_scale).sum())
    return np.asarray(counts * max(left / max(counts.sum(), 1.0), 0.1))


def at_redshift(model: str, given: Prior | None, redshift: float) -> str:
    """The model with the redshifts that nobody gave a prior, a number or a tie at the source's."""
    free = set(parameter_names(parse(model))) - set(given.names if given is not None else ())
    ends = (".redshift", ".z")
    return with_sources(model, {name: float(redshift) for name in sorted(free) if name.endswith(ends)})


def model_prior(
    model: str, given: Prior | None, response: Response, counts: Array, exposure: Array | None = None
) -> Prior:
    """The prior of a model: what is given, and `default_prior` for the rest."""
    names = parameter_names(parse(model))
    marginals = {} if given is None else given.marginals
    if set(marginals) == set(names):
        return Prior({name: marginals[name] for name in names})
    return default_prior(model, response, counts, exposure, given=marginals)
