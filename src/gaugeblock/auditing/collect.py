"""Trials collected: a simulator draws truths and data, an estimator answers, block after block on disk.

Every block is written whole, under a key made of everything that decides its content, so an interrupted run
goes on where it stopped, to the same bits, and never mixes trials of two configurations. Who makes a block,
and when, decides nothing of it: several processes fill blocks side by side.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Generator, Iterator
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from gaugeblock.auditing.filling import Filling
from gaugeblock.auditing.identity import identity, lasting, versions
from gaugeblock.auditing.marks import mark, marked
from gaugeblock.auditing.phases import DensityTrials, WeighedDraws, end_phase
from gaugeblock.auditing.samples import (
    Blocks,
    ImportanceTrials,
    JointTrials,
    MainTrials,
    Plan,
)
from gaugeblock.auditing.watch import Watch
from gaugeblock.auditing.workplace import private_folder
from gaugeblock.core.atomic import write_once
from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError
from gaugeblock.core.executors import each
from gaugeblock.core.progress import Progress
from gaugeblock.core.streams import whole_blocks
from gaugeblock.estimators.protocol import Estimator, devices, has_density, untrusted
from gaugeblock.simulators.prior import HasPriorDensity
from gaugeblock.simulators.protocol import HasLikelihood, Simulator
from gaugeblock.validate.storage import open_groups, read_groups, write_groups
from gaugeblock.validate.summaries import without_summaries
from gaugeblock.validate.trials import IMPORTANCE, JOINT, group_trials, main_trials, trials_tree

MAIN, DRAWN, DENSITIES = "trials", "importance draws", "densities"
WEIGHING, LIKELIHOOD = "importance sampling", "joint likelihood"
PARTS = "parts.json"


def collect(
    simulator: Simulator,
    estimator: Estimator,
    plan: Plan,
    folder: Path,
    *,
    key: str | None = None,
    watch: Watch | None = None,
    progress: Progress | None = None,
    earlier: xr.DataTree | None = None,
    executor: Executor | None = None,
    allow_mixed: bool = False,
) -> xr.DataTree:
    """Trials of an estimator on a simulator, resumed from `folder` where it holds blocks of the same run.

    The result depends neither on where a run was interrupted, nor on which process of an `executor` made
    which block, and when; and a longer run begins with a shorter one's trials, which are taken from
    `earlier` where these are known. With a `watch` it stops at the end of a block. An estimator that is
    `untrusted` gives all its draws before anything is said of densities. `key` is the `fingerprint`, where
    it was made already.

    Raises
    ------
    InputError
        If the simulator gives data that are not finite, or the estimator draws of the wrong shape; if blocks
        were made on other processors, unless `allow_mixed`; or the folder holds parts of another plan.
    """
    key = key or fingerprint(simulator, estimator, plan)
    known = folder / PARTS
    if known.exists():
        _same_plan(known, run_record(simulator, estimator, plan))
    fill = _Fill(simulator, estimator, plan, Filling.begun(folder / key, allow_mixed=allow_mixed))
    blocks = _OnDisk(fill, executor, progress)
    for what, trials in _known(earlier, estimator):
        blocks.keep(what, trials)
    main = blocks.joined(MAIN, plan.number, watch=watch)
    plan = plan.at_most(main.sizes["trial"])
    weighed, likelihoods = _further(simulator, estimator, plan)
    importance, joint = None, None
    if weighed:
        importance = blocks.joined(DRAWN if untrusted(estimator) else WEIGHING, weighed)
    if untrusted(estimator):
        end_phase(estimator)
        if has_density(estimator):
            main = blocks.joined(DENSITIES, plan.number)
        if weighed:
            importance = blocks.joined(WEIGHING, weighed)
    if likelihoods:
        joint = blocks.joined(LIKELIHOOD, likelihoods)
    return trials_tree(main, importance, joint=joint)


def collect_part(
    simulator: Simulator,
    estimator: Estimator,
    plan: Plan,
    folder: Path,
    part: tuple[int, int],
    *,
    progress: Progress | None = None,
    executor: Executor | None = None,
    allow_mixed: bool = False,
) -> int:
    """Every N-th block from the i-th on, of a `part` (i, N), for `collect` to find; how many there are.

    The first part to come writes down whose blocks they are, and parts of anything else are refused.

    Raises
    ------
    InputError
        As `collect`; or if an earlier part is of another plan, or simulator or estimator cannot be known
        again in another process.
    """
    record = run_record(simulator, estimator, plan)
    if not lasting(record):
        raise InputError(
            "the state of simulator or estimator cannot be told from another's, so that parts could not be "
            "put together; give a file, a model folder or an object that can be pickled"
        )
    _same_plan(folder / PARTS, record)
    work = folder / fingerprint(simulator, estimator, plan)
    fill = _Fill(simulator, estimator, plan, Filling.begun(work, allow_mixed=allow_mixed))
    blocks, number = _OnDisk(fill, executor, progress), 0
    weighed, likelihoods = _further(simulator, estimator, plan)
    for what, trials in ((MAIN, plan.number), (WEIGHING, weighed), (LIKELIHOOD, likelihoods)):
        mine = list(whole_blocks(trials, plan.block))[part[0] - 1 :: part[1]]
        number += len(mine)
        for _ in blocks.filled(what, mine, len(mine) * plan.block):
            pass
    return number


def _further(simulator: Simulator, estimator: Estimator, plan: Plan) -> tuple[int, int]:
    """Trials that get importance draws, and trials that get likelihoods."""
    likely = isinstance(simulator, HasLikelihood)
    weighable = likely and isinstance(simulator.prior, HasPriorDensity) and has_density(estimator)
    return plan.importance_number if weighable else 0, plan.joint_number if likely else 0


def _known(earlier: xr.DataTree | None, estimator: Estimator) -> Iterator[tuple[str, xr.Dataset]]:
    """Trials of an earlier run, under what they are called here; a stranger's have another seed."""
    if earlier is None or untrusted(estimator):
        return
    groups = {WEIGHING: group_trials(earlier, IMPORTANCE), LIKELIHOOD: group_trials(earlier, JOINT)}
    yield MAIN, without_summaries(main_trials(earlier))
    yield from ((what, trials) for what, trials in groups.items() if trials is not None)


def run_record(simulator: Simulator, estimator: Estimator, plan: Plan) -> dict[str, Any]:
    """Everything that decides the bits of a run, but for the processor that makes them."""
    return {
        "simulator": identity(simulator),
        "estimator": identity(estimator),
        "plan": vars(plan),
        "versions": versions(),
    }


def fingerprint(simulator: Simulator, estimator: Estimator, plan: Plan) -> str:
    """Key of everything that decides the bits of a run, as sixteen hexadecimal digits.

    It never comes again for a simulator or an estimator whose state cannot be told from another's: a run of
    such a thing starts afresh, and does not mix the draws of two networks. The processor is not in it: who
    makes the first block enters it beside the blocks, and no other kind adds to them unasked (`one_kind`).
    """
    record = run_record(simulator, estimator, plan)
    once = [secrets.token_hex(8) for name in ("simulator", "estimator") if not lasting(record[name])]
    return digest({**record, "once": once})[:16]


def _same_plan(path: Path, record: dict[str, Any]) -> None:
    """Enter whose parts these are, where nobody has, and refuse those of anything else."""
    private_folder(path.parent)
    mine = json.loads(json.dumps(record, default=str))
    content = json.dumps({name: mine[name] for name in ("plan", "versions")} | {"digest": digest(mine)})
    try:
        kept = json.loads(write_once(path, content.encode()))
        if kept["digest"] == digest(mine):
            return
        other = [
            f"{key} {kept[name].get(key)} there, {mine[name].get(key)} here"
            for name in ("plan", "versions")
            for key in {**kept[name], **mine[name]}
            if kept[name].get(key) != mine[name].get(key)
        ]
    except (ValueError, KeyError, TypeError, AttributeError):
        other = ["its record is damaged"]
    said = "; ".join(other) or "another simulator or estimator"
    raise InputError(
        f"{path.parent} holds parts of another plan ({said}): give the same options, or another --out"
    )


@dataclass(frozen=True)
class _Fill:
    """Fills any block of a run: all that a process needs for it."""

    simulator: Simulator
    estimator: Estimator
    plan: Plan
    filling: Filling

    def __call__(self, block: tuple[str, range]) -> None:
        """Write a block where there is none; one that is made twice has the same bits twice."""
        path = self.path(*block)
        if is_intact(path):
            return
        what, trials = block
        self.filling.fill(
            path,
            lambda: self._maker(what)(trials),
            lambda made: write_groups({"": made}, path),
            *devices(self.estimator),
        )

    def path(self, what: str, trials: range | None = None) -> Path:
        """File of a block, or of all together."""
        name = what.replace(" ", "-")
        return self.filling.work / (f"{name}.nc" if trials is None else f"{name}-{trials.start:08d}.nc")

    def _maker(self, what: str) -> Blocks:
        again = (self.simulator, self.estimator, self.plan, self._reader(MAIN))
        if what == MAIN:
            return MainTrials(*again[:3])
        if what == DENSITIES:
            return DensityTrials(*again)
        if what == LIKELIHOOD:
            return JointTrials(*again)
        if what == WEIGHING and untrusted(self.estimator):
            return WeighedDraws(*again, self._reader(DRAWN))
        return ImportanceTrials(*again)

    def _reader(self, what: str) -> Blocks:
        return lambda trials: read_block(self.path(what, trials))


@dataclass(frozen=True)
class _OnDisk:
    """Blocks of trials as files, filled by an executor's processes, or here."""

    fill: _Fill
    executor: Executor | None
    progress: Progress | None

    def joined(self, what: str, number: int, *, watch: Watch | None = None) -> xr.Dataset:
        """The first `number` trials, or fewer where the `watch` has seen enough; damaged blocks anew."""
        stop = number
        blocks = list(whole_blocks(number, self.fill.plan.block))
        with closing(self.filled(what, blocks, number)) as filled:
            for trials in filled:
                if watch is None:
                    continue
                stop = min(trials.stop, number)
                if watch.see(self._cut(what, trials, number)) and watch.confirm(self._together(what, stop)):
                    break
        return self._together(what, stop)

    def filled(self, what: str, blocks: list[range], number: int) -> Generator[range]:
        """Each block in its order, once it is on disk."""
        missing = [trials for trials in blocks if not is_intact(self.fill.path(what, trials))]
        done = set(blocks) - set(missing)
        tasks = ((what, trials) for trials in missing)
        with closing(each(self.fill, tasks, folder=self.fill.filling.work, executor=self.executor)) as making:
            self._say(what, len(done), number)
            for trials in blocks:
                while trials not in done:
                    done.add(next(making)[1])
                    self._say(what, len(done), number)
                yield trials

    def keep(self, what: str, earlier: xr.Dataset) -> None:
        """Write the whole blocks of an earlier run, as if they had been made here; what is cut off is not."""
        self.fill.filling.enter_processor(*devices(self.fill.estimator))
        for trials in whole_blocks(earlier.sizes["trial"], self.fill.plan.block):
            path = self.fill.path(what, trials)
            if trials.stop <= earlier.sizes["trial"] and not is_intact(path):
                block = earlier.isel(trial=slice(trials.start, trials.stop)).drop_encoding()
                write_groups({"": block}, path)
                mark(path)

    def _together(self, what: str, number: int) -> xr.Dataset:
        """One file out of all blocks: small ones are read back into memory, large ones stay there."""
        parts = (self._cut(what, trials, number) for trials in whole_blocks(number, self.fill.plan.block))
        whole = write_groups({"": parts}, self.fill.path(what))
        return open_groups(whole, what="Trials", own=True)[""].drop_encoding()

    def _cut(self, what: str, trials: range, number: int) -> xr.Dataset:
        return read_block(self.fill.path(what, trials)).isel(trial=slice(number - trials.start))

    def _say(self, what: str, done: int, number: int) -> None:
        if self.progress is not None:
            self.progress(what, min(done * self.fill.plan.block, number), number)


def read_block(path: Path) -> xr.Dataset:
    """A block that is ours.

    Raises
    ------
    InputError
        If it cannot be read, or somebody else put it there.
    """
    if not marked(path):
        raise InputError(f"{path}: is not the block that was written; run the same command again")
    return read_groups(path, what="block of trials", own=True)[""]


def is_intact(path: Path) -> bool:
    """Whether the block is on disk; a damaged one is not, nor one that somebody else put there."""
    try:
        read_block(path)
    except InputError:
        return False
    return True
