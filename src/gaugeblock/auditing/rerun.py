"""Rerun: truths and data drawn again from the seed, and some of the draws asked for again.

What `verify` derives from the trials rests on them. Whoever made them up is found out here, as far as the
share that is drawn again goes: truths and data are, all of them; draws are, a block at a time, since an
estimator is asked a block at a time.
"""

from __future__ import annotations

import math
import secrets
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.auditing.estimator_from import as_estimator
from gaugeblock.auditing.identity import identity
from gaugeblock.auditing.phases import ended
from gaugeblock.auditing.provenance import digests
from gaugeblock.auditing.samples import MainTrials, Plan
from gaugeblock.core.errors import InputError
from gaugeblock.core.executors import threads
from gaugeblock.core.progress import Progress
from gaugeblock.core.streams import whole_blocks
from gaugeblock.core.trust import only_named, refuse_trust
from gaugeblock.reports.machine import plain
from gaugeblock.simulators.from_function import as_simulator
from gaugeblock.simulators.protocol import HasLikelihood
from gaugeblock.validate.trials import main_trials

WHERE = "verdict.json: provenance"


@dataclass(frozen=True)
class Rerun:
    """What differs, one line each, and what was drawn again."""

    differences: tuple[str, ...]
    said: str


def chance_to_catch(forged: int, *, trials: int, block: int, replayed: int) -> float:
    """Probability that some of `forged` trials are among `replayed` blocks, wherever they were hidden.

    Whoever forges does best to fill whole blocks, so as to touch the fewest.

    >>> round(chance_to_catch(1, trials=4000, block=200, replayed=2), 12)
    0.1
    >>> chance_to_catch(1000, trials=4000, block=200, replayed=2) > 0.4
    True
    """
    blocks, touched = math.ceil(trials / block), math.ceil(forged / block)
    return 1 - math.comb(blocks - touched, replayed) / math.comb(blocks, replayed)


def rerun(
    tree: xr.DataTree,
    record: Mapping[str, Any],
    share: float,
    *,
    near: float,
    allow_modules: Iterable[str] = (),
    progress: Progress | None = None,
) -> Rerun:
    """Draw the truths and data of the main trials again, and a `share` of the blocks of draws.

    Which blocks, nobody can foresee. Simulator and estimator are made anew from what `record`, an audit's
    provenance, says of them: a stranger runs in its sandbox, and modules load if `allow_modules` has them.
    Numbers may differ by `near`, relative to the largest.

    Raises
    ------
    InputError
        If the share is none, the audit was of draws from disk, or simulator and estimator cannot be made
        again from their names, or fail.
    """
    if not 0 < share <= 1:
        raise InputError(f"--rerun {share:g}: must be above 0 and at most 1, as in --rerun 0.1")
    plan = _plan(record)
    main = main_trials(tree)
    choices = [_choice(record, name) for name in ("simulator", "estimator")]
    with only_named(allow_modules):
        simulator = as_simulator(choices[0])
        estimator = as_estimator(choices[1], simulator, densities=isinstance(simulator, HasLikelihood))
        with ended(estimator), threads(1):
            here = digests(plain({"simulator": identity(simulator), "estimator": identity(estimator)}))
            there = digests({name: record[name] for name in here})
            lines = [
                f"{WHERE}.{name}: has sha256 {there[name]}, what is found by its name has {here[name]}"
                for name in here
                if here[name] != there[name]
            ]
            blocks = list(whole_blocks(main.sizes["trial"], plan.block))
            number = max(1, round(share * len(blocks)))
            chosen = set(secrets.SystemRandom().sample(range(len(blocks)), number))
            lines += _compared(MainTrials(simulator, estimator, plan), main, blocks, chosen, near, progress)
    trials = main.sizes["trial"]
    odds = "; ".join(
        f"{forged:,} in {chance_to_catch(forged, trials=trials, block=plan.block, replayed=number):.0%}"
        for forged in dict.fromkeys(max(1, round(part * trials)) for part in (1 / trials, 0.05, 0.25, 1.0))
    )
    return Rerun(
        tuple(lines),
        f"all truths and data, and the draws of {number} of {len(blocks)} blocks, were drawn again; how "
        f"often that meets forged trials, by their number: {odds}",
    )


def _plan(record: Mapping[str, Any]) -> Plan:
    said = record.get("trials")
    try:
        plan = Plan(**{one.name: int(dict(said or {})[one.name]) for one in fields(Plan)})
    except (KeyError, TypeError, ValueError):
        raise InputError("draws from disk have no seed and no simulator: leave out --rerun") from None
    if plan.block < 1 or plan.draws < 1 or plan.seed < 0:
        raise InputError(f"{WHERE}.trials: {vars(plan)} is no plan of an audit")
    return plan


def _choice(record: Mapping[str, Any], name: str) -> dict[str, Any]:
    """How it was asked for, as a table that says so again."""
    said = record.get(name)
    if not isinstance(said, Mapping) or not isinstance(said.get("name"), str):
        raise InputError(f"{WHERE}.{name} does not say what it is: nothing can be drawn again")
    options = said.get("options") or {}
    if not isinstance(options, Mapping):
        raise InputError(f"{WHERE}.{name}.options is no table")
    refuse_trust(options, f"{WHERE}.{name}.options")
    return {**options, "name": said["name"]}


def _compared(
    again: MainTrials,
    main: xr.Dataset,
    blocks: list[range],
    chosen: set[int],
    near: float,
    progress: Progress | None,
) -> Iterator[str]:
    """One line for each of truths, data and draws that are not what is drawn again."""
    wrong: dict[str, list[int]] = {"theta_true": [], "x": [], "draws": []}
    for place, trials in enumerate(blocks):
        if progress is not None:
            progress("rerun", place, len(blocks))
        # Blocks are made whole, and cut off at the end.
        rows = slice(trials.start, min(trials.stop, main.sizes["trial"]))
        theta, x = again.truth_and_data(trials)
        made = {"theta_true": theta, "x": x}
        if place in chosen:
            made["draws"] = again.drawn(x, trials, again.plan.draws, "draws")[0]
        for name, values in made.items():
            stored = main[name].values[rows] if name in main else np.empty(0)
            wrong[name] += (trials.start + _unlike(stored, values[: rows.stop - rows.start], near)).tolist()
    if progress is not None:
        progress("rerun", len(blocks), len(blocks))
    for name, found in wrong.items():
        if found:
            yield (
                f"trials.nc: {name}: {len(found):,} trial(s), the first of them {found[0]}, are not what seed"
                f"{', simulator and estimator' if name == 'draws' else ' and simulator'} give"
            )


def _unlike(stored: Any, made: Any, near: float) -> Any:
    """Which rows differ by more than `near` times their largest value."""
    there, here = np.asarray(stored, dtype=float), np.asarray(made, dtype=float)
    if there.shape != here.shape:
        return np.arange(len(here))
    there, here = there.reshape(len(there), -1), here.reshape(len(here), -1)
    allowed = near * np.nanmax(np.abs(here), axis=1, initial=0.0, keepdims=True)
    same = (np.abs(there - here) <= allowed) | (there == here) | (np.isnan(there) & np.isnan(here))
    return np.flatnonzero(~same.all(axis=1))
