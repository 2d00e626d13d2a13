"""Trials collected: a simulator draws truths and data, an estimator answers, chunk after chunk on disk.

Every chunk is written under a key made of everything that decides its content, so an interrupted run goes
on where it stopped, to the same bits, and never mixes trials of two configurations.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable
from pathlib import Path

import xarray as xr

from gaugeblock.auditing.identity import identity, versions
from gaugeblock.auditing.phases import DensityTrials, ImportanceDraws, WeighedDraws, end_phase
from gaugeblock.auditing.samples import (
    ImportanceTrials,
    JointTrials,
    MainTrials,
    Plan,
    untrusted,
)
from gaugeblock.auditing.watch import Watch
from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError
from gaugeblock.core.progress import Progress
from gaugeblock.estimators.protocol import Estimator, has_density
from gaugeblock.simulators.protocol import HasLikelihood, Simulator
from gaugeblock.validate.storage import open_groups, read_groups, write_groups
from gaugeblock.validate.trials import trials_tree

Make = Callable[[range], xr.Dataset]
WEIGHING = "importance sampling"


def collect(
    simulator: Simulator,
    estimator: Estimator,
    plan: Plan,
    folder: Path,
    *,
    watch: Watch | None = None,
    progress: Progress | None = None,
) -> xr.DataTree:
    """Trials of an estimator on a simulator, resumed from `folder` where it holds chunks of the same run.

    The result does not depend on where a run was interrupted. It depends on the chunk size only as far as
    the estimator's arithmetic does, and with a `watch` also because it stops at the end of a chunk. An
    estimator that is `untrusted` gives all its draws before anything is said of densities.

    Raises
    ------
    InputError
        If the simulator gives data that are not finite, or the estimator draws of the wrong shape.
    """
    work = folder / fingerprint(simulator, estimator, plan)
    work.mkdir(parents=True, exist_ok=True)
    sampler = MainTrials(simulator, estimator, plan)
    main = _chunks("trials", plan.number, plan.chunk, work, progress, sampler, watch)
    plan = plan.at_most(main.sizes["trial"])
    importance, joint = None, None
    if untrusted(estimator):
        main, importance = _in_phases(simulator, estimator, plan, main, work, progress)
    elif plan.importance_number and _weighable(simulator, estimator):
        weigh = ImportanceTrials(simulator, estimator, plan, main)
        importance = _chunks(WEIGHING, plan.importance_number, _size(plan), work, progress, weigh)
    if plan.joint_number and isinstance(simulator, HasLikelihood):
        size = max(1, plan.chunk * plan.draws // plan.joint_draws)
        evaluate = JointTrials(simulator, estimator, plan, main)
        joint = _chunks("joint likelihood", plan.joint_number, size, work, progress, evaluate)
    return trials_tree(main, importance, joint=joint)


def _in_phases(
    simulator: Simulator,
    estimator: Estimator,
    plan: Plan,
    main: xr.Dataset,
    work: Path,
    progress: Progress | None,
) -> tuple[xr.Dataset, xr.Dataset | None]:
    """The main trials and those for importance weights: the draws that lack, and only then densities."""
    number = plan.importance_number if _weighable(simulator, estimator) else 0
    importance = None
    if number:
        draw = ImportanceDraws(simulator, estimator, plan, main)
        importance = _chunks("importance draws", number, _size(plan), work, progress, draw)
    end_phase(estimator)
    if has_density(estimator):
        ask = DensityTrials(simulator, estimator, plan, main)
        main = _chunks("densities", plan.number, plan.chunk, work, progress, ask)
    if importance is not None:
        weigh = WeighedDraws(simulator, estimator, plan, main, importance)
        importance = _chunks(WEIGHING, number, _size(plan), work, progress, weigh)
    return main, importance


def _size(plan: Plan) -> int:
    """Trials in a chunk of draws for importance weights."""
    return max(1, plan.chunk * plan.draws // plan.importance_draws)


def _weighable(simulator: Simulator, estimator: Estimator) -> bool:
    return isinstance(simulator, HasLikelihood) and has_density(estimator)


def fingerprint(simulator: Simulator, estimator: Estimator, plan: Plan) -> str:
    """Key of everything that decides the bits of a run, as sixteen hexadecimal digits.

    It never comes again for a simulator or an estimator whose state cannot be told from another's: a run of
    such a thing starts afresh, and does not mix the draws of two networks.
    """
    parts = {"simulator": identity(simulator), "estimator": identity(estimator)}
    content = {
        **parts,
        "once": [secrets.token_hex(8) for part in parts.values() if part.get("state_sha256", "") is None],
        "plan": vars(plan),
        "versions": versions(),
    }
    return digest(content)[:16]


def _chunks(
    what: str,
    number: int,
    size: int,
    work: Path,
    progress: Progress | None,
    make: Make,
    watch: Watch | None = None,
) -> xr.Dataset:
    parts: list[Path] = []
    joined = work / f"{what.replace(' ', '-')}.nc"
    for first in range(0, number, size):
        trials = range(first, min(first + size, number))
        if progress is not None:
            progress(what, first, number)
        path = work / f"{what.replace(' ', '-')}-{first:08d}.nc"
        if not _intact(path):
            write_groups({"": make(trials)}, path)
        parts.append(path)
        if watch is not None and watch.see(_chunk(path)) and watch.confirm(_together(parts, joined)):
            break
    if progress is not None:
        progress(what, number, number)
    return _together(parts, joined)


def _together(parts: list[Path], path: Path) -> xr.Dataset:
    """One file out of all chunks: small ones are read back into memory, large ones stay there."""
    whole = write_groups({"": map(_chunk, parts)}, path)
    return open_groups(whole, what="Trials")[""].drop_encoding()


def _chunk(path: Path) -> xr.Dataset:
    return read_groups(path, what="chunk of trials")[""]


def _intact(path: Path) -> bool:
    """Whether the chunk is on disk; a damaged one is not."""
    try:
        _chunk(path)
    except InputError:
        return False
    return True


def discard(folder: Path) -> None:
    """Remove the chunks below `folder` and their seeds, once what they were for is written."""
    for path in sorted([*folder.glob("*/*.nc"), *folder.glob("*.seed")]):
        path.unlink(missing_ok=True)
        if path.parent != folder and not any(path.parent.iterdir()):
            path.parent.rmdir()
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
