"""`check`: could the simulator have made what was observed?"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.auditing.checked import Check
from gaugeblock.auditing.estimator_from import as_estimator
from gaugeblock.auditing.identity import identity, versions
from gaugeblock.auditing.observation import read_observation
from gaugeblock.auditing.phases import ended
from gaugeblock.auditing.predictive import Answering, Predictive
from gaugeblock.auditing.provenance import digests, named
from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.progress import Progress, shown
from gaugeblock.core.streams import generator
from gaugeblock.estimators.protocol import Estimator
from gaugeblock.reports.machine import plain
from gaugeblock.simulators.data_sets import as_data_sets
from gaugeblock.simulators.from_function import as_simulator
from gaugeblock.simulators.protocol import Extensible, Simulator
from gaugeblock.simulators.segments import Segmented
from gaugeblock.validate.observation import Sets
from gaugeblock.validate.observation.along import Along, along
from gaugeblock.validate.observation.answer import Answer, Moved, View
from gaugeblock.validate.observation.coordinates import Coordinates
from gaugeblock.validate.observation.generic import Tried, compared
from gaugeblock.validate.observation.ladder import Seen, share, smallest_seen
from gaugeblock.validate.observation.planted import Discrepancy, Scale, possible
from gaugeblock.validate.observation.ranking import groups, p_values_against, ranked
from gaugeblock.validate.observation.tables import DATA
from gaugeblock.validate.observation.together import FURTHER, Together
from gaugeblock.validate.observation.views import WAYS, Rows, Views
from gaugeblock.validate.observation.where import Where, located
from gaugeblock.validate.summaries import Function

LEVEL = 0.05
SEES: Mapping[str, float] = {"noise": 1.0, "component": 5.0}
PLANTED, WITH_EFFECT = 200, 120
# Fewer cannot reject at 5% in any view but one.
LEAST = 99
POSTERIOR_DRAWS = 1000


def check(
    simulator: Any,
    x: Any,
    estimator: Any = None,
    *,
    prior: Any = None,
    names: Sequence[str] | None = None,
    trials: int = 999,
    simulations: int = 4000,
    draws: int = 24,
    seed: int = 0,
    level: float = LEVEL,
    sees: Mapping[str, float] | None = None,
    views: Mapping[str, Function] | Sequence[str] | None = None,
    summaries: Function | None = None,
    axes: Sequence[str] = (),
    coordinates: ArrayLike | None = None,
    out: str | os.PathLike[str] | None = None,
    progress: Progress | bool | None = None,
    command: str = "",
) -> Check:
    """Ask whether a simulator, somewhere in its prior, could have made what was observed.

    The observation's rank among fresh simulations that went through everything that it went through: an exact
    p-value, never below ``1 / (trials + 1)``, with the price of looking in many ways paid.

    Parameters
    ----------
    simulator, prior, names
        As in `gaugeblock.audit`: an object, a function beside its prior, a class, a name.
    x : array or path
        One data set ``(*data_shape)``, or several ``(n, *data_shape)``, each with parameters of its own from
        the prior; or a .npy or NetCDF file of it.
    estimator : optional
        As in `gaugeblock.audit`: adds what is left after fitting, and its features where it has ``embed``.
    trials : int
        Fresh simulations that are ranked; of several observations, random groups.
    simulations : int
        Other simulations, which views are learned on.
    draws : int
        Posterior draws of each data set at which data are replicated.
    seed : int
        Of everything random.
    level : float
        FAIL where the p-value is at most this: so often for what the simulator did make.
    sees : mapping of str to float
        What a PASS needs to have seen with 90% power, by kind of discrepancy and size; by default
        ``{"noise": 1.0, "component": 5.0}``, noise as large as the simulations' own spread and, where data
        have an axis, a bump of five spreads; see docs/check.md.
    views : names or mapping of functions, optional
        Names of the views to use instead of all; or functions from data ``(n, *data_shape)`` to ``(n,)``, by
        name, beside them.
    summaries : function, optional
        From data to numbers ``(n, k)``, which are looked at beside the data.
    axes, coordinates
        What the axes of a data set are called, and names or positions along the last one.
    out : path, optional
        Folder for check.json and report.html.
    progress : callable ``(what, done, total)`` or bool, optional
        None: bars in a terminal and in a notebook.

    Raises
    ------
    InputError
        In one line, if anything given cannot be used, or simulator or estimator fail.
    """
    if trials < LEAST or simulations < 2 * LEAST or draws < 4 or not 0 < level < 1:
        raise InputError(
            f"check: needs trials >= {LEAST}, simulations >= {2 * LEAST}, draws >= 4 and a level between 0 "
            f"and 1, got {trials}, {simulations}, {draws} and {level}"
        )
    given = read_observation(x)
    if given is None:
        raise InputError("check: give the observation, x, an array or a file")
    simulated = as_simulator(simulator, prior=prior, names=names)
    estimating = None if estimator is None else as_estimator(estimator, simulated)
    own = dict(views) if isinstance(views, Mapping) else {}
    select = None if views is None or isinstance(views, Mapping) else tuple(views)
    with ended(None if estimating is estimator else estimating), shown(progress) as tell:
        run = _Run(simulated, estimating, given.data, trials, simulations, draws, seed, level, tell)
        answer = run.answer(
            Coordinates.of(run.shape, **_called(simulated, run.shape, axes, coordinates)),
            sees,
            {"summaries": summaries, "own": own, "select": select},
        )
    subjects: dict[str, Any] = {"simulator": {**named(simulator), **identity(simulated)}}
    if estimating is not None:
        subjects["estimator"] = {**named(estimator), **identity(estimating)}
    record = plain(
        {
            "command": command,
            "seed": seed,
            **subjects,
            "observation": given.record,
            "trials": {"trials": trials, "simulations": simulations, "draws": draws},
            "versions": versions(),
        }
    )
    result = Check(answer, {**record, "sha256": digests(record)})
    if out is not None:
        result.save(out)
    return result


@dataclass(frozen=True, eq=False)
class _Looked:
    """Observed and fresh data sets through the same views."""

    views: Views
    rows: Rows
    groups: NDArray[np.intp]
    together: Together
    statistics: Array
    weights: Array


class _Run:
    """One check from simulations to an answer."""

    def __init__(
        self, simulator: Simulator, estimator: Estimator | None, observed: NDArray[Any], trials: int,
        simulations: int, draws: int, seed: int, level: float, tell: Progress,
    ):  # fmt: skip
        self.simulator, self.estimator, self.seed, self.level, self.tell = (
            simulator,
            estimator,
            seed,
            level,
            tell,
        )
        self.trials = trials
        self.answering = Answering(simulator, estimator, draws=draws, seed=seed)
        tell("simulating", 0, simulations)
        self.theta, self.learned = Predictive(simulator, seed, "learned").pairs(simulations)
        self.shape = self.learned.shape[1:]
        self.observed = as_data_sets(observed, self.shape, what="observation")
        # Several observations need others enough to stand in for them.
        self.fresh = Predictive(simulator, seed, "ranked").data(max(trials, 10 * len(self.observed)))
        tell("simulating", simulations, simulations)

    def answer(
        self, coordinates: Coordinates, sees: Mapping[str, float] | None, given: Mapping[str, Any]
    ) -> Answer:
        """Learn, rank, locate, plant, try."""
        ladder = possible(self.shape, ladder=True)
        if sees is None:
            sees = {kind: size for kind, size in SEES.items() if kind in ladder}
        unknown = [kind for kind in sees if kind not in ladder]
        if unknown or not all(size > 0 for size in sees.values()):
            raise InputError(
                f"sees: {', '.join(unknown) or 'sizes must be positive'}; for these data there are "
                f"{', '.join(ladder)}"
            )
        looked = self.look(coordinates, given)
        found = ranked(looked.statistics, looked.weights)
        names = looked.together.names(len(self.observed))
        where = located(looked.views, self.observed, looked.rows, looked.groups)
        scale = Scale.of(self.learned)
        failed = found.p_value <= self.level
        order = np.lexsort((found.single, found.corrected))
        label = coordinates.labels
        return Answer(
            p_value=found.p_value,
            level=self.level,
            sees=dict(sees),
            observations=len(self.observed),
            fresh=len(looked.statistics) - 1,
            learned=len(self.learned),
            shape=self.shape,
            views=tuple(
                View(names[i], _says(names[i]), float(found.single[i]), float(found.corrected[i]))
                for i in order
            ),
            where=where,
            axes=coordinates.axes,
            grid=coordinates.grid,
            positions=tuple(map(float, label)) if label and not isinstance(label[0], str) else (),
            ladder=self.ladder(looked, ladder, scale),
            effects=self.effects(looked, scale) if failed else (),
            moved=self.moved(looked.views, where) if failed else (),
            along=self.along(looked.views, where) if failed else None,
            has_effects=isinstance(self.simulator, Extensible),
            codes={name: one.code for name, one in possible(self.shape, ladder=False).items()},
            not_checked=() if self.estimator is not None else (
                ("after fitting", "there is no estimator to say what is left after fitting"),
            ),
        )  # fmt: skip

    def look(self, coordinates: Coordinates, given: Mapping[str, Any]) -> _Looked:
        """Views learned on simulations of their own; observed and fresh data through all of them at once."""
        self.tell("learning views", 0, 1)
        learning = self.answering.sets(self.learned, "learned")
        views = Views.learned(learning, coordinates, generator(self.seed, "check views"), **given)
        self.tell("learning views", 1, 1)
        both = np.concatenate([self.observed, self.fresh])
        rows = views(self.answering.sets(both, "ranked"))
        made = groups(len(self.observed), len(self.fresh), self.trials, generator(self.seed, "check groups"))
        together = Together.learned(views.names, rows, generator(self.seed, "check together"))
        weights = together.weights(views.weights, len(self.observed))
        return _Looked(views, rows, made, together, together(rows, made), weights)

    def ladder(self, looked: _Looked, kinds: Mapping[str, Discrepancy], scale: Scale) -> tuple[Seen, ...]:
        """The smallest discrepancy of each kind that would have been seen."""
        base = Predictive(self.simulator, self.seed, "planted").data(max(PLANTED, 5 * len(self.observed)))
        rng = generator(self.seed, "check planted groups")
        size = len(self.observed)
        members = np.arange(PLANTED)[:, None] if size == 1 else np.stack(
            [rng.choice(len(base), size, replace=False) for _ in range(PLANTED)]
        )  # fmt: skip
        found = []
        for done, (kind, one) in enumerate(kinds.items()):
            self.tell("planting discrepancies", done, len(kinds))

            def power_at(amplitude: float, kind: str = kind, one: Discrepancy = one) -> float:
                noise = generator(self.seed, f"check planted {kind}", round(1000 * amplitude))
                sets = self.answering.sets(
                    one(base, amplitude, scale, noise), f"planted {kind} {amplitude:g}"
                )
                planted = looked.together(looked.views(sets), members)
                return share(p_values_against(looked.statistics[1:], planted, looked.weights), self.level)

            found.append(smallest_seen(kind, one.says, power_at))
        self.tell("planting discrepancies", len(kinds), len(kinds))
        return tuple(found)

    def effects(self, looked: _Looked, scale: Scale) -> tuple[Tried, ...]:
        """Generic effects put into simulations, which looks at the data alone."""
        kinds = possible(self.shape, ladder=False)
        base = Predictive(self.simulator, self.seed, "effects").data(WITH_EFFECT)
        views = looked.views.of_the_data()
        observed = views(Sets(self.observed))

        def at(name: str, amplitude: float) -> tuple[Array, float]:
            rng = generator(self.seed, f"check effect {name}", round(1000 * (amplitude + 100)))
            rows = views(Sets(kinds[name](base, amplitude, scale, rng)))
            return rows.signed, float(
                np.median(p_values_against(rows.scores, observed.scores, views.weights))
            )

        self.tell("trying effects", 0, 1)
        found = compared(
            [(name, one.signed) for name, one in kinds.items()], at, observed.signed, views(Sets(base)).signed
        )
        self.tell("trying effects", 1, 1)
        return found

    def along(self, views: Views, where: Where) -> Along | None:
        """The part of what disagrees that parameters could absorb; None where it has no place."""
        gone = where.members
        if len(self.observed) > 1 or not gone:
            return None
        family, coordinates = views.families[DATA], views.tables.coordinates
        scores = family.values(coordinates(self.observed))[0]
        filled = family.expectation.filled(scores, gone)
        return along(
            scores - filled,
            filled,
            family.values(coordinates(self.learned)),
            self.theta,
            self.simulator.prior.names,
            family.expectation.leads,
        )

    def moved(self, views: Views, where: Where) -> tuple[Moved, ...]:
        """The posterior with the disagreeing coordinates replaced by what the others lead one to expect."""
        gone = where.members
        if self.estimator is None or len(self.observed) > 1 or not gone:
            return ()
        family, coordinates = views.families[DATA], views.tables.coordinates
        before = coordinates(self.observed)
        scores = family.expectation.filled(family.values(before)[0], gone)
        after = family.values.inverse(scores[None])
        filled = self.observed.astype(float).copy()
        for at in gone:
            part = filled[0][coordinates.members(at)]
            filled[0][coordinates.members(at)] = part + (after[0, at] - before[0, at]) / max(part.size, 1)
        both = np.concatenate([self.observed.astype(float), filled])
        draws = self.answering.posterior(both, POSTERIOR_DRAWS, "moved")
        mean, spread = draws.mean(axis=1), draws.std(axis=1, ddof=1)
        return tuple(
            Moved(name, (float(mean[0, i]), float(spread[0, i])), (float(mean[1, i]), float(spread[1, i])))
            for i, name in enumerate(self.simulator.prior.names)
        )


def _called(
    simulator: Simulator, shape: tuple[int, ...], axes: Sequence[str], labels: ArrayLike | None
) -> dict[str, Any]:
    """What the user calls axes and places; else what the simulator does, where its data are one segment."""
    parts = simulator.segments() if isinstance(simulator, Segmented) else ()
    if axes or labels is not None or len(parts) != 1 or shape != (parts[0].stop,):
        return {"axes": axes, "labels": labels}
    return {"axes": (parts[0].unit,), "labels": parts[0].edges.mean(axis=1)}


def _says(name: str) -> str:
    return WAYS.get(name.rpartition(": ")[2]) or FURTHER.get(name) or "a function of your own"
