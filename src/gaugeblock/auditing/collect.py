"""Trials collected: a simulator draws truths and data, an estimator answers, block after block on disk.

Every block is written whole, under a key made of everything that decides its content, so an interrupted run
goes on where it stopped, to the same bits, and never mixes trials of two configurations.
"""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from gaugeblock.auditing.identity import identity, lasting, versions
from gaugeblock.auditing.phases import DensityTrials, WeighedDraws, end_phase
from gaugeblock.auditing.samples import (
    Blocks,
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
from gaugeblock.core.streams import whole_blocks
from gaugeblock.estimators.protocol import Estimator, has_density
from gaugeblock.simulators.prior import HasPriorDensity
from gaugeblock.simulators.protocol import HasLikelihood, Simulator
from gaugeblock.validate.storage import open_groups, read_groups, write_groups
from gaugeblock.validate.trials import IMPORTANCE, JOINT, group_trials, main_trials, trials_tree

WEIGHING, LIKELIHOOD = "importance sampling", "joint likelihood"


def collect(
    simulator: Simulator,
    estimator: Estimator,
    plan: Plan,
    folder: Path,
    *,
    watch: Watch | None = None,
    progress: Progress | None = None,
    earlier: xr.DataTree | None = None,
) -> xr.DataTree:
    """Trials of an estimator on a simulator, resumed from `folder` where it holds blocks of the same run.

    The result does not depend on where a run was interrupted, and a longer run begins with a shorter
    one's trials, which are taken from `earlier` where these are known; with a `watch` it stops at the end
    of a block. An estimator that is `untrusted` gives all its draws before anything is said of densities.

    Raises
    ------
    InputError
        If the simulator gives data that are not finite, or the estimator draws of the wrong shape.
    """
    work = folder / fingerprint(simulator, estimator, plan)
    work.mkdir(parents=True, exist_ok=True)
    blocks = _OnDisk(work, plan.block, progress)
    for what, trials in _known(earlier, estimator):
        blocks.keep(what, trials)
    main = blocks.joined("trials", plan.number, MainTrials(simulator, estimator, plan), watch=watch)
    plan = plan.at_most(main.sizes["trial"])
    again = (simulator, estimator, plan, blocks.reader("trials"))
    weighed = plan.importance_number if _weighable(simulator, estimator) else 0
    importance, joint = None, None
    if weighed:
        what = "importance draws" if untrusted(estimator) else WEIGHING
        importance = blocks.joined(what, weighed, ImportanceTrials(*again))
    if untrusted(estimator):
        end_phase(estimator)
        if has_density(estimator):
            main = blocks.joined("densities", plan.number, DensityTrials(*again))
        if weighed:
            weigh = WeighedDraws(*again, blocks.reader("importance draws"))
            importance = blocks.joined(WEIGHING, weighed, weigh)
    if plan.joint_number and isinstance(simulator, HasLikelihood):
        joint = blocks.joined(LIKELIHOOD, plan.joint_number, JointTrials(*again))
    return trials_tree(main, importance, joint=joint)


def _known(earlier: xr.DataTree | None, estimator: Estimator) -> Iterator[tuple[str, xr.Dataset]]:
    """Trials of an earlier run, under what they are called here; a stranger's have another seed."""
    if earlier is None or untrusted(estimator):
        return
    groups = {WEIGHING: group_trials(earlier, IMPORTANCE), LIKELIHOOD: group_trials(earlier, JOINT)}
    yield "trials", main_trials(earlier)
    yield from ((what, trials) for what, trials in groups.items() if trials is not None)


def _weighable(simulator: Simulator, estimator: Estimator) -> bool:
    known = isinstance(simulator, HasLikelihood) and isinstance(simulator.prior, HasPriorDensity)
    return known and has_density(estimator)


def fingerprint(simulator: Simulator, estimator: Estimator, plan: Plan) -> str:
    """Key of everything that decides the bits of a run, as sixteen hexadecimal digits.

    It never comes again for a simulator or an estimator whose state cannot be told from another's: a run of
    such a thing starts afresh, and does not mix the draws of two networks.
    """
    parts = {"simulator": identity(simulator), "estimator": identity(estimator)}
    content = {
        **parts,
        "once": [secrets.token_hex(8) for part in parts.values() if not lasting(part)],
        "plan": vars(plan),
        "versions": versions(),
    }
    return digest(content)[:16]


@dataclass(frozen=True)
class _OnDisk:
    """Blocks of `size` trials as files of the folder `work`, each whole."""

    work: Path
    size: int
    progress: Progress | None

    def joined(self, what: str, number: int, make: Blocks, *, watch: Watch | None = None) -> xr.Dataset:
        """The first `number` trials, or fewer where the `watch` has seen enough; damaged blocks anew."""
        stop = number
        for trials in whole_blocks(number, self.size):
            self._say(what, trials.start, number)
            path = self._path(what, trials)
            if not _intact(path):
                write_groups({"": make(trials)}, path)
            if watch is None:
                continue
            stop = min(trials.stop, number)
            if watch.see(self._cut(what, trials, number)) and watch.confirm(self._together(what, stop)):
                break
        self._say(what, number, number)
        return self._together(what, stop)

    def keep(self, what: str, earlier: xr.Dataset) -> None:
        """Write the whole blocks of an earlier run, as if they had been made here; what is cut off is not."""
        for trials in whole_blocks(earlier.sizes["trial"], self.size):
            path = self._path(what, trials)
            if trials.stop <= earlier.sizes["trial"] and not _intact(path):
                block = earlier.isel(trial=slice(trials.start, trials.stop)).drop_encoding()
                write_groups({"": block}, path)

    def reader(self, what: str) -> Blocks:
        """Reads whole blocks back."""
        return lambda trials: _read(self._path(what, trials))

    def _together(self, what: str, number: int) -> xr.Dataset:
        """One file out of all blocks: small ones are read back into memory, large ones stay there."""
        parts = (self._cut(what, trials, number) for trials in whole_blocks(number, self.size))
        whole = write_groups({"": parts}, self._path(what))
        return open_groups(whole, what="Trials", own=True)[""].drop_encoding()

    def _cut(self, what: str, trials: range, number: int) -> xr.Dataset:
        return _read(self._path(what, trials)).isel(trial=slice(number - trials.start))

    def _path(self, what: str, trials: range | None = None) -> Path:
        name = what.replace(" ", "-")
        return self.work / (f"{name}.nc" if trials is None else f"{name}-{trials.start:08d}.nc")

    def _say(self, what: str, done: int, number: int) -> None:
        if self.progress is not None:
            self.progress(what, done, number)


def _read(path: Path) -> xr.Dataset:
    return read_groups(path, what="block of trials", own=True)[""]


def _intact(path: Path) -> bool:
    """Whether the block is on disk; a damaged one is not."""
    try:
        _read(path)
    except InputError:
        return False
    return True


def discard(folder: Path) -> None:
    """Remove the blocks below `folder` and their seeds, once what they were for is written."""
    for path in sorted([*folder.glob("*/*.nc"), *folder.glob("*.seed")]):
        path.unlink(missing_ok=True)
        if path.parent != folder and not any(path.parent.iterdir()):
            path.parent.rmdir()
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
