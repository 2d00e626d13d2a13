"""Discovery on measured spectra: read files, search, write discovery.json, discovery.nc and report.html."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gaugeblock.auditing.identity import versions
from gaugeblock.core.atomic import atomic_path, write_atomically
from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError
from gaugeblock.discovery import Discovery, Sources, discover, discover_catalogue
from gaugeblock.reports.verdict_json import plain
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.registry import load_object

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What was measured and how it should be explained, as the command line gives it."""

    pha: tuple[Path, ...] = ()
    catalog: Path | None = None
    model: str
    priors: Path | None = None
    band: tuple[float, float] | None = None
    rmf: tuple[Path, ...] = ()
    arf: tuple[Path, ...] = ()
    background: tuple[str, ...] = ()
    redshift: float = 0.0
    regroup: str = "ungrouped"


def read(measured: Measured, *, progress: Progress, seed: int = 0) -> list[Sources]:
    """The sources that files hold, one group a response.

    Raises
    ------
    InputError
        If neither spectra nor a catalogue are named, or both, or a file cannot be read.
    """
    from gaugeblock.simulators.xray.catalog import read_catalog
    from gaugeblock.simulators.xray.observation import read_observation

    if bool(measured.pha) == (measured.catalog is not None):
        raise InputError("discover: name either PHA files of one source, or --catalog with a folder of many")
    if measured.catalog is not None:
        if len(measured.rmf) > 1 or len(measured.arf) > 1:
            raise InputError("discover: a catalogue takes one --rmf and one --arf at most")
        found = read_catalog(
            measured.catalog,
            model=measured.model,
            priors=measured.priors,
            rmf=next(iter(measured.rmf), None),
            arf=next(iter(measured.arf), None),
            background=measured.background != ("none",),
            band=measured.band,
            regroup=measured.regroup,
            seed=seed,
            progress=lambda done, total: progress("reading spectra", done, total),
        )
    else:
        found = (
            read_observation(
                measured.pha,
                model=measured.model,
                priors=measured.priors,
                rmf=measured.rmf or None,
                arf=measured.arf or None,
                background=measured.background or None,
                band=measured.band,
                redshift=measured.redshift,
                regroup=measured.regroup,
            ),
        )
    return [Sources(o.simulator, o.counts, o.scale, o.redshift, o.names) for o in found]


def run(
    measured: Measured,
    out: Path,
    *,
    seed: int = 0,
    own: Sequence[str] = (),
    only: Sequence[str] = (),
    replicates: int = 999,
    evidence: bool | None = None,
    command: str = "",
    progress: Progress,
) -> Discovery:
    """Discover and write the files into `out`.

    Parameters
    ----------
    own : sequence of str
        Effects of one's own as ``module:object``, a `LibraryEffect` or several.
    only : sequence of str
        Effects to which the search is restricted.
    evidence : bool or None
        Whether to run nested sampling for the evidence of the named effect; None: where it is quick.

    Raises
    ------
    InputError
        In one line: for files that cannot be read or options that make no sense.
    """
    groups = read(measured, progress=progress, seed=seed)
    steps = _Steps(progress)
    options: dict[str, Any] = {
        "seed": seed,
        "effects": own_effects(own),
        "only": tuple(only),
        "replicates": replicates,
        "step": steps.begin,
    }
    if len(groups) == 1 and len(groups[0]) == 1:
        found = discover(groups[0], evidence=evidence, e_value=True, **options)
    else:
        found = discover_catalogue(groups, **options)
    steps.end()
    summary = dict(found.summary) | {"provenance": _provenance(measured, groups, seed, replicates, command)}
    found = replace(found, summary=plain(summary))
    write(found, out)
    return found


class _Steps:
    """Turns "this begins now" into bars that are empty or full."""

    def __init__(self, progress: Progress):
        self._progress = progress
        self._open: str | None = None

    def begin(self, what: str) -> None:
        self.end()
        self._progress(what, 0, 1)
        self._open = what

    def end(self) -> None:
        if self._open is not None:
            self._progress(self._open, 1, 1)
        self._open = None


def write(found: Discovery, out: Path) -> None:
    """Write discovery.json, discovery.nc and report.html, each wholly or not at all."""
    from gaugeblock.reports.discovery import write_discovery

    out.mkdir(parents=True, exist_ok=True)
    write_atomically(out / "discovery.json", json.dumps(found.summary, indent=2, allow_nan=False) + "\n")
    with atomic_path(out / "discovery.nc") as path:
        found.tree.to_netcdf(path, engine="netcdf4")
    write_discovery(found.tree, dict(found.summary), out)


def own_effects(names: Sequence[str]) -> dict[str, LibraryEffect]:
    """Effects that a user keeps in a module of their own.

    Raises
    ------
    InputError
        If a module cannot be imported, or what it holds is no effect.
    """
    found: dict[str, LibraryEffect] = {}
    for name in names:
        loaded = load_object(name, "effect")
        several = loaded.values() if isinstance(loaded, Mapping) else loaded
        for entry in [loaded] if isinstance(loaded, LibraryEffect) else list(several):
            if not isinstance(entry, LibraryEffect):
                raise InputError(f"effect {name!r}: holds a {type(entry).__name__}, not a LibraryEffect")
            found[entry.name] = entry
    return found


def _provenance(
    measured: Measured, groups: Sequence[Sources], seed: int, replicates: int, command: str
) -> dict[str, Any]:
    return {
        "command": command,
        "seed": seed,
        "replicates": replicates,
        "versions": versions(),
        "model": measured.model,
        "simulators": [group.simulator.describe() for group in groups],
        "data": digest([group.counts.tolist() for group in groups]),
    }
