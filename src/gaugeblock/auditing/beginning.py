"""An audit about to begin: who is audited on what, with which seed, entered in its ledger."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from gaugeblock.auditing.collect import fingerprint
from gaugeblock.auditing.commitment import committed, content_of
from gaugeblock.auditing.commitment import opened as commitment_opened
from gaugeblock.auditing.config import TrialsTable
from gaugeblock.auditing.estimator_from import as_estimator
from gaugeblock.auditing.identity import identity
from gaugeblock.auditing.kept_seed import kept_seed
from gaugeblock.auditing.ledger import Entry, check_ledger, entered
from gaugeblock.auditing.phases import ended
from gaugeblock.auditing.provenance import named
from gaugeblock.auditing.samples import Plan
from gaugeblock.auditing.workplace import CHUNKS, workplace
from gaugeblock.core.errors import InputError
from gaugeblock.core.progress import Progress, shown
from gaugeblock.estimators.protocol import Estimator, check_fresh, untrusted
from gaugeblock.simulators.from_function import as_simulator
from gaugeblock.simulators.protocol import HasLikelihood, Simulator
from gaugeblock.validate import Policy


@dataclass(frozen=True, kw_only=True)
class Run:
    """An audit before its first trial: who is audited on what, the plan with its seed, and where."""

    simulator: Simulator
    estimator: Estimator
    plan: Plan
    subjects: Mapping[str, Any]
    drawn: bool
    entry: Entry | None
    commitment: Mapping[str, Any] | None
    folder: Path
    tell: Progress


@contextmanager
def begun(
    estimator: Any,
    simulator: Any,
    table: TrialsTable,
    rules: Policy,
    *,
    out: str | os.PathLike[str] | None,
    side_by_side: bool,
    alone: bool,
    prior: Any = None,
    names: Sequence[str] | None = None,
    densities: bool | None = None,
    ledger: str | os.PathLike[str] | None = None,
    release: bool = False,
    progress: Progress | bool | None = None,
    commitment: tuple[Path, Path | None] | None = None,
    summarised: Mapping[str, Any] = MappingProxyType({}),
) -> Iterator[Run]:
    """An audit about to begin, entered in its ledger; what it holds open ends with the block."""
    if hasattr(estimator, "simulate") and not hasattr(estimator, "sample"):
        raise InputError(
            f"the estimator is a {type(estimator).__name__}, which simulates; "
            "the order is (estimator, simulator)"
        )
    if release and ledger is None:
        raise InputError(
            "a release audit draws a seed that its ledger has not seen: give one with --ledger FILE"
        )
    if release and "seed" in table.model_fields_set:
        raise InputError("a release audit draws its own seed: leave out --seed, and seed of [trials]")
    if commitment is not None and (release or "seed" in table.model_fields_set):
        raise InputError("a commitment makes its own seed: leave out --seed, seed of [trials], and --release")
    if ledger is not None:
        check_ledger(Path(ledger))
    simulated = as_simulator(simulator, prior=prior, names=names)
    dense = isinstance(simulated, HasLikelihood) if densities is None else densities
    estimating = as_estimator(estimator, simulated, densities=dense)
    if side_by_side and untrusted(estimating):
        raise InputError(
            "an estimator that nobody vouches for answers one process alone, which sees to it that all draws "
            "come before any density: leave out workers, scheduler, part and executor"
        )
    plan = table.plan()
    # What the caller made is the caller's to end.
    with (
        ended(None if estimating is estimator else estimating),
        shown(progress) as tell,
        workplace(out, alone=alone) as folder,
    ):
        subjects = {
            "simulator": {**named(simulator), **identity(simulated)},
            "estimator": {**named(estimator), **identity(estimating)},
        }
        drawn, kept_commitment = False, None
        if commitment is not None:
            content = content_of(subjects, rules, plan)
            if commitment[1] is None:
                committed(commitment[0], content)
            else:
                kept_commitment = commitment_opened(commitment[0], commitment[1], content)
                plan = replace(plan, seed=kept_commitment["seed"])
        elif untrusted(estimating) and "seed" not in table.model_fields_set and not release:
            # A stranger that can foresee the seed could draw the truths again.
            kept = fingerprint(simulated, estimating, replace(plan, seed=0))
            plan, drawn = replace(plan, seed=kept_seed(folder / CHUNKS, kept)), True
        check_fresh(estimating, plan.seed)
        entry = None
        if ledger is not None:
            about = {**subjects, "trials": trials_record(plan, table, summarised)}
            entry = entered(Path(ledger), about, rules, release=release)
            plan = replace(plan, seed=entry.seed)
        yield Run(
            simulator=simulated,
            estimator=estimating,
            plan=plan,
            subjects=subjects,
            drawn=drawn,
            entry=entry,
            commitment=kept_commitment,
            folder=folder,
            tell=tell,
        )


def trials_record(plan: Plan, table: TrialsTable, summarised: Mapping[str, Any]) -> dict[str, Any]:
    """How trials are made, for provenance, and for the records of looks."""
    return {**vars(plan), **({"anytime": True} if table.anytime else {}), **summarised}
