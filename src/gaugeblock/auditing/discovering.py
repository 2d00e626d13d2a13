"""`discover`: one way in to discovery, for measured spectra and for a simulator with data in hand."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.auditing.answers import Answers, fingerprint
from gaugeblock.auditing.identity import versions
from gaugeblock.auditing.workplace import CHUNKS, discard, workplace
from gaugeblock.core.arrays import Array, numbers
from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError, blamed
from gaugeblock.core.progress import Progress, shown
from gaugeblock.discovery import (
    Discovery,
    Sources,
    discover_catalogue,
    discover_simulated,
    discover_source,
)
from gaugeblock.reports.discovery import MODELS, write_discovery
from gaugeblock.reports.machine import plain
from gaugeblock.simulators.effects import Effect, labelled
from gaugeblock.simulators.from_function import as_simulator
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.protocol import (
    Extensible,
    HasExpected,
    HasLikelihood,
    HasNotes,
    HasXcm,
    description,
    poisson_log_likelihood,
)
from gaugeblock.simulators.registry import load_object

Kind = Literal["counts", "catalogue", "simulations"]
Files = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]


def discover(
    what: Any,
    x: ArrayLike | None = None,
    *,
    model: str = "tbabs*powerlaw",
    priors: str | os.PathLike[str] | None = None,
    band: tuple[float, float] | Sequence[tuple[float, float]] | None = None,
    rmf: Files = (),
    arf: Files = (),
    background: Sequence[str] = (),
    redshift: float = 0.0,
    regroup: str = "ungrouped",
    sys_err: bool = False,
    prior: Any = None,
    engine: Kind | None = None,
    effects: Mapping[str, LibraryEffect] | Sequence[LibraryEffect | str] = (),
    only: Sequence[str] = (),
    energy: float | None = None,
    most: int = 1,
    simulations: int = 10_000,
    summaries: Callable[[Any], Any] | None = None,
    evidence: bool = False,
    replicates: int = 999,
    seed: int = 0,
    out: str | os.PathLike[str] | None = None,
    progress: Progress | bool | None = None,
    executor: Executor | None = None,
    command: str = "",
) -> Discovery:
    """Find where simulation and data disagree, name the missing effect, add it, test the name.

    Parameters
    ----------
    what
        Measured spectra: a PHA file, several of one source, or a folder that holds a catalogue. Or, with `x`,
        the simulator that should explain it: an object, a name, or a function ``(theta, rng)`` beside its
        `prior`. Or `Sources`, one group or several.
    x : array, optional
        ``(n, ...)`` independent data sets that share the effect, or a single one, ``(...)``.
    model, priors, band, rmf, arf, background, redshift, regroup
        Of measured spectra: the model as in XSPEC, a TOML file of priors, energies ``(low, high)`` in keV for
        all spectra or for one each, responses and backgrounds in place of the headers', channels to be
        grouped; see docs/xray.md.
    sys_err
        Whether SYS_ERR of measured spectra of one source is used, as scatter beyond Poisson's.
    prior
        Of a simulator that has none, or in place of its own: whatever `as_prior` takes.
    engine : "counts", "catalogue" or "simulations", optional
        Without it: for a simulator whose likelihood is the Poisson one of its ``expected(theta)`` and data
        that are counts, "counts" for one data set and "catalogue" for several; else "simulations", which
        uses ``simulate`` alone.
    effects : mapping or sequence of LibraryEffect, or ``module:object`` of such
        Beside the simulator's own library. Of a simulator without ``with_effect``, an effect's `kind` is a
        function ``(simulate, theta, values, rng)`` that gives its data: `simulate(theta, rng)` is the
        simulator without it, `values` its parameters by name, ``(n,)`` each.
    only : sequence of str
        Effects to which the search is restricted.
    energy : float, optional
        Of one source, in keV at rest, stated before the scan: one trial is paid for it.
    most : int
        Most effects that are added by "simulations", where a second explains much that is none.
    simulations, summaries
        Of "simulations": how many at each state, and from data ``(n, ...)`` to numbers ``(n, k)``.
    evidence : bool
        Whether to run nested sampling for the evidence of the named effect of "counts": it may take as long
        as everything else, or much longer.
    replicates : int
        Simulated data sets behind every global p, which is never below 1 / (replicates + 1): at least 399, of
        a catalogue 99, so that every look at the data can reach 0.01.
    seed : int
        Of everything random.
    out : path, optional
        Folder for discovery.json, discovery.nc and report.html; without it no file is written.
    progress : callable ``(what, done, total)`` or bool, optional
        None: bars in a terminal and in a notebook.
    executor : concurrent.futures.Executor, optional
        Whose processes share a catalogue's sources; they see `out`. The bits are those of one process.

    Raises
    ------
    InputError
        In one line: for files that cannot be read, or what makes no sense together.
    """
    if engine is not None and engine not in get_args(Kind):
        raise InputError(f"discover: engine must be one of {', '.join(get_args(Kind))}, got {engine!r}")
    own = own_effects(effects)
    with ExitStack() as stack:
        show = stack.enter_context(shown(progress))
        steps = _Steps(show)
        common: dict[str, Any] = {
            "seed": seed, "effects": own, "only": tuple(only), "replicates": replicates, "step": steps.begin,
        }  # fmt: skip
        groups: Sequence[Sources] = ()
        simulator: Any = None
        if isinstance(what, Sources):
            groups = [what]
        elif x is not None:
            simulator = _simulator(what, prior)
            counts = numbers(x, what="discover: x")
            engine = engine or _engine(simulator, counts)
            if engine != "simulations":
                groups = [Sources.of(simulator, counts)]
        elif isinstance(what, str | os.PathLike) or _all(what, str | os.PathLike):
            groups = read_measured(
                what, rmf=rmf, arf=arf, background=tuple(background), redshift=redshift, seed=seed,
                progress=show, model=model, priors=priors, band=band, regroup=regroup, sys_err=sys_err,
            )  # fmt: skip
        elif _all(what, Sources):
            groups = list(what)
        else:
            raise InputError(
                f"discover: a {type(what).__name__} without data; give discover(simulator, x), PHA files, "
                "or a folder of them"
            )
        one = len(groups) > 0 and engine != "catalogue" and sum(map(len, groups)) == 1
        if executor is not None and (one or not groups):
            raise InputError(
                "discover: workers share the sources of a catalogue, and this is none: leave out --workers, "
                "--scheduler or executor"
            )
        if energy is not None and not one:
            raise InputError("discover: an energy can be stated of counts of one source")
        if not groups:
            found = discover_simulated(
                simulator, counts, most=most, simulations=simulations, summaries=summaries, **common
            )
        elif engine == "simulations":
            raise InputError("discover: engine 'simulations' takes a simulator and x")
        elif one:
            found = discover_source(groups[0], energy=energy, evidence=evidence, e_value=True, **common)
        elif engine == "counts":
            raise InputError(f"discover: engine 'counts' takes one source, got {sum(map(len, groups))}")
        else:
            found = _catalogue(groups, out, executor, common)
        steps.end()
    data = [group.counts.tolist() for group in groups] if groups else counts.tolist()
    searched = [group.simulator for group in groups] if groups else [simulator]
    notes = dict.fromkeys(note for one in searched if isinstance(one, HasNotes) for note in one.notes)
    models, unsaid = _saved(searched[0], found) if one and out is not None else ({}, ())
    notes |= dict.fromkeys(unsaid)
    found = replace(found, remarks=(*found.remarks, *notes)).with_provenance(
        plain(
            {
                "command": command,
                "seed": seed,
                "replicates": replicates,
                "versions": versions(),
                "model": found.model_before,
                "simulators": [description(one) for one in searched],
                "data": digest(data),
                "notes": list(notes),
            }
        )
    )
    if out is not None:
        write_discovery(found, Path(out), models)
        if found.catalogue is not None:
            discard(Path(out) / CHUNKS)
    return found


def _saved(simulator: Any, found: Discovery) -> tuple[dict[str, str], tuple[str, ...]]:
    """The texts of `MODELS` that there are, and why one is not."""
    if not isinstance(simulator, HasXcm):
        return {}, ()
    made: dict[str, str] = {}
    sides = (found.fit.before, ()), (found.fit.after, found.named_all)
    for name, (fit, effects) in zip(MODELS, sides, strict=True):
        if fit is None:
            continue
        values = {key: one.value for key, one in fit.parameters.items()}
        added = [
            Effect(
                effect.name,
                {key[len(label) + 1 :]: values[key] for key in values if key.startswith(f"{label}.")},
            )
            for label, effect in labelled([Effect(key) for key in effects])
        ]
        try:
            made[name] = simulator.xcm(values, tuple(added))
        except InputError as error:
            return made, (f"{name} was not written: {error}",)
    return made, ()


def _catalogue(
    groups: Sequence[Sources],
    out: str | os.PathLike[str] | None,
    executor: Executor | None,
    common: Mapping[str, Any],
) -> Discovery:
    """A catalogue's answers go to files where there is a folder, or where other processes make them."""
    if out is None and executor is None:
        return discover_catalogue(groups, **common)
    said = {name: common[name] for name in ("seed", "only", "replicates")}
    with workplace(out) as folder:
        key = fingerprint(groups, bool(common["effects"]), **said)
        return discover_catalogue(groups, each=Answers(folder / CHUNKS / key, executor), **common)


def _all(what: Any, kind: Any) -> bool:
    return isinstance(what, Sequence) and bool(what) and all(isinstance(one, kind) for one in what)


def _simulator(what: Any, prior: Any) -> Any:
    """A simulator that takes effects, from an object, a name, or a function with its prior."""
    made = as_simulator(what, prior=prior)
    return made if isinstance(made, Extensible) else WithFunctions(made.simulate, made.prior)


def _engine(simulator: Any, x: NDArray[Any]) -> Kind:
    """Counts and their mean say most; everything else is simulated."""
    rows = np.atleast_2d(x)
    counts = rows.ndim == 2 and np.issubdtype(rows.dtype, np.number) and bool(np.all(rows >= 0))
    if not isinstance(simulator, HasExpected) or not counts or not np.array_equal(rows, np.round(rows)):
        return "simulations"
    if isinstance(simulator, HasLikelihood):
        theta = np.atleast_2d(simulator.prior.center)
        poisson = poisson_log_likelihood(simulator.expected(theta), rows[:1])
        if not np.allclose(simulator.log_likelihood(theta, rows[:1]), poisson, rtol=1e-6, atol=1e-6):
            return "simulations"
    return "counts" if len(rows) == 1 else "catalogue"


class WithFunctions:
    """A simulator that takes functions as effects.

    An effect's `kind` is a function ``(simulate, theta, values, rng)`` whose data ``(n, ...)`` are those of
    `simulate(theta, rng)`, what was there before, with the effect; at its neutral value the same data.

    Parameters
    ----------
    simulate : callable
        ``(theta, rng)`` to data ``(n, ...)``.
    prior : Prior
        Of its parameters.
    """

    def __init__(
        self, simulate: Callable[..., Any], prior: Prior, effects: tuple[tuple[Effect, str], ...] = ()
    ):
        self._simulate, self._plain, self._effects = simulate, prior, effects
        self.prior = prior
        for effect, label in effects:
            free = effect.prior(label)
            self.prior = self.prior if free is None else self.prior * free

    def simulate(self, theta: ArrayLike, rng: np.random.Generator) -> NDArray[Any]:
        """Data ``(n, ...)`` for each row of theta, the effects' parameters behind the simulator's."""
        rows = np.asarray(theta, dtype=float)
        at, call = self._plain.size, self._simulate
        for effect, _ in self._effects:
            values = {name: np.full(len(rows), value) for name, value in effect.fixed.items()}
            for name in effect.free:
                values[name], at = rows[:, at], at + 1
            call = _changed(effect, call, values)
        return np.asarray(call(rows[:, : self._plain.size], rng))

    def with_effect(self, effect: Effect) -> WithFunctions:
        """The same with an effect worked in.

        Raises
        ------
        InputError
            If the effect's kind is no function.
        """
        if not callable(effect.kind):
            raise InputError(
                f"effect {effect.name}: a simulator without with_effect takes a function (simulate, theta, "
                "values, rng) as the effect's kind"
            )
        number = 1 + sum(one.name == effect.name for one, _ in self._effects)
        more = (*self._effects, (effect, f"{effect.name}_{number}"))
        return WithFunctions(self._simulate, self._plain, more)


def _changed(effect: Effect, call: Callable[..., Any], values: Mapping[str, Any]) -> Callable[..., Any]:
    def changed(theta: Array, rng: np.random.Generator) -> Any:
        with blamed(f"the effect {effect.name}", f"{len(theta)} parameter vectors"):
            return effect.kind(call, theta, values, rng)

    return changed


def read_measured(
    files: Files,
    *,
    rmf: Files,
    arf: Files,
    background: tuple[str, ...],
    redshift: float,
    seed: int,
    progress: Progress,
    sys_err: bool = False,
    **further: Any,
) -> list[Sources]:
    """The sources that PHA files, or a folder with a catalogue, hold: one group a response.

    `further` is what both readers take: model, priors, band, regroup.

    Raises
    ------
    InputError
        If there are none, or a file cannot be read.
    """
    from gaugeblock.simulators.xray.catalog import read_catalog
    from gaugeblock.simulators.xray.observation import read_observation

    pha, rmfs, arfs = (_paths(given) for given in (files, rmf, arf))
    if not pha:
        raise InputError("discover: name PHA files of one source, or a folder with a catalogue of many")
    if any(path.is_dir() for path in pha):
        if len(pha) > 1:
            raise InputError("discover: name either PHA files of one source, or one folder with many")
        if len(rmfs) > 1 or len(arfs) > 1:
            raise InputError("discover: a catalogue takes one --rmf and one --arf at most")
        if np.ndim(further.get("band", 0.0)) == 2:
            raise InputError("discover: a catalogue takes one band for all of its spectra")
        if sys_err:
            raise InputError("discover: SYS_ERR is used of one source; weights of many would differ")
        found = read_catalog(
            pha[0],
            rmf=next(iter(rmfs), None),
            arf=next(iter(arfs), None),
            background=background != ("none",),
            seed=seed,
            progress=lambda done, total: progress("reading spectra", done, total),
            **further,
        )
    else:
        found = (
            read_observation(
                pha,
                rmf=rmfs or None,
                arf=arfs or None,
                background=background or None,
                redshift=redshift,
                sys_err=sys_err,
                **further,
            ),
        )
    return [Sources(o.simulator, o.counts, o.scale, o.redshift, o.names) for o in found]


def _paths(given: Files) -> tuple[Path, ...]:
    return (Path(given),) if isinstance(given, str | os.PathLike) else tuple(map(Path, given))


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


def own_effects(
    given: Mapping[str, LibraryEffect] | Sequence[LibraryEffect | str] | LibraryEffect,
) -> dict[str, LibraryEffect]:
    """Effects of one's own by name, those given as ``module:object`` loaded.

    Raises
    ------
    InputError
        If a module cannot be imported, or something is no effect.
    """
    if isinstance(given, Mapping):
        return {str(name): entry for name, one in given.items() for entry in _effects(one, f"{name}")}
    every = [given] if isinstance(given, LibraryEffect | str) else given
    return {entry.name: entry for one in every for entry in _effects(one, f"{one!r}")}


def _effects(given: Any, called: str) -> list[LibraryEffect]:
    """One effect, or those that an object of a module holds."""
    loaded = load_object(given, "effect") if isinstance(given, str) else given
    several = loaded.values() if isinstance(loaded, Mapping) else loaded
    found = list(several) if isinstance(several, Iterable) else [several]
    for entry in found:
        if not isinstance(entry, LibraryEffect):
            raise InputError(f"effect {called}: holds a {type(entry).__name__}, not a LibraryEffect")
    return found
