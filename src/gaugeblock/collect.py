"""Trials collected: a simulator draws truths and data, an estimator answers, chunk after chunk on disk.

Every chunk is written under a key made of everything that decides its content, so an interrupted run goes
on where it stopped, to the same bits, and never mixes trials of two configurations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.digest import digest
from gaugeblock.errors import GaugeblockError, InputError
from gaugeblock.estimators.protocol import Estimator, sample_and_log_prob
from gaugeblock.identity import identity, versions
from gaugeblock.simulators.protocol import Simulator, can
from gaugeblock.streams import TrialStreams
from gaugeblock.validate.storage import read_groups, write_groups
from gaugeblock.validate.trials import make_trials, trials_tree

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, kw_only=True)
class Plan:
    """How many trials and draws, in what chunks, from which seed.

    `number` trials of `draws` draws; the first `importance_number` of them get `importance_draws` further
    draws with densities, where estimator and simulator have them.
    """

    number: int
    draws: int
    chunk: int
    importance_number: int
    importance_draws: int
    seed: int


def collect(
    simulator: Simulator,
    estimator: Estimator,
    plan: Plan,
    folder: Path,
    *,
    progress: Progress | None = None,
) -> xr.DataTree:
    """Trials of an estimator on a simulator, resumed from `folder` where it holds chunks of the same run.

    The result does not depend on where a run was interrupted. It depends on the chunk size only as far as
    the estimator's arithmetic does.

    Raises
    ------
    InputError
        If the simulator gives data that are not finite, or the estimator draws of the wrong shape.
    """
    work = folder / fingerprint(simulator, estimator, plan)
    work.mkdir(parents=True, exist_ok=True)
    main = _chunks("trials", plan.number, plan.chunk, work, progress, _Main(simulator, estimator, plan))
    importance = None
    if plan.importance_number and _weighable(simulator, estimator):
        size = max(1, plan.chunk * plan.draws // plan.importance_draws)
        sampler = _Importance(simulator, estimator, plan, main)
        importance = _chunks("importance sampling", plan.importance_number, size, work, progress, sampler)
    return trials_tree(main, importance)


def _weighable(simulator: Simulator, estimator: Estimator) -> bool:
    return can(simulator, "log_likelihood") and (
        can(estimator, "log_prob") or can(estimator, "sample_and_log_prob")
    )


def fingerprint(simulator: Simulator, estimator: Estimator, plan: Plan) -> str:
    """Key of everything that decides the bits of a run, as sixteen hexadecimal digits."""
    content = {
        "simulator": identity(simulator),
        "estimator": identity(estimator),
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
    make: Callable[[range], xr.Dataset],
) -> xr.Dataset:
    parts = []
    for first in range(0, number, size):
        trials = range(first, min(first + size, number))
        if progress is not None:
            progress(what, first, number)
        parts.append(_stored(work / f"{what.replace(' ', '-')}-{first:08d}.nc", partial(make, trials)))
    if progress is not None:
        progress(what, number, number)
    whole = xr.concat(
        parts, dim="trial", data_vars="minimal", coords="minimal", compat="override", join="override"
    )
    return whole.assign_coords(trial=np.arange(number))


def _stored(path: Path, make: Callable[[], xr.Dataset]) -> xr.Dataset:
    """The chunk from disk, or made now and kept; a damaged file is made anew."""
    try:
        return read_groups(path, what="chunk of trials")[""]
    except InputError:
        dataset = make()
        write_groups({"": dataset}, path)
        return dataset


def discard(folder: Path) -> None:
    """Remove the chunks below `folder`, once what they were for is written."""
    for path in sorted(folder.glob("*/*.nc")):
        path.unlink(missing_ok=True)
        if not any(path.parent.iterdir()):
            path.parent.rmdir()
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


@contextmanager
def _blamed(who: str, trials: range) -> Iterator[None]:
    """Say whose code failed, and on which trials; what gaugeblock itself says passes unchanged."""
    try:
        yield
    except GaugeblockError:
        raise
    except Exception as error:
        raise InputError(
            f"the {who} failed on trials {trials[0]} to {trials[-1]}: {type(error).__name__}: {error}"
        ) from error


class _Main:
    """Truth, data and draws of a range of trials."""

    def __init__(self, simulator: Simulator, estimator: Estimator, plan: Plan):
        self.simulator, self.estimator, self.plan = simulator, estimator, plan

    def streams(self, purpose: str, trials: range) -> TrialStreams:
        return TrialStreams.spawn(self.plan.seed, f"audit {purpose}", trials)

    def truth_and_data(self, trials: range) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
        theta = self.simulator.prior.sample(len(trials), self.streams("truth", trials))
        with _blamed("simulator", trials):
            x = np.asarray(self.simulator.simulate(theta, self.streams("data", trials)))
        if x.shape[:1] != (len(trials),):
            raise InputError(
                f"the simulator gave data of shape {x.shape} for {len(trials)} trials; "
                "its first axis must be the trial"
            )
        wrong = ~np.isfinite(x.reshape(len(x), -1)).all(axis=1)
        if wrong.any():
            trial = trials[int(np.argmax(wrong))]
            raise InputError(
                f"the simulator gave NaN or infinite data for trial {trial} (theta = "
                f"{np.array2string(theta[trial - trials[0]], precision=4)}); mend it, or narrow its prior"
            )
        return theta, x

    def checked(self, draws: object, trials: range, n: int, what: str = "draws") -> np.ndarray[Any, Any]:
        array = np.asarray(draws, dtype=float)
        shape = (len(trials), n) + ((self.simulator.prior.size,) if what == "draws" else ())
        if array.shape != shape:
            raise InputError(
                f"the estimator gave {what} of shape {array.shape} for {len(trials)} trials; expected {shape}"
            )
        return array

    def __call__(self, trials: range) -> xr.Dataset:
        theta, x = self.truth_and_data(trials)
        n = self.plan.draws
        with _blamed("estimator", trials):
            sampled = self.estimator.sample(x, n, self.streams("draws", trials))
        draws = self.checked(sampled, trials, n)
        return make_trials(
            theta,
            draws,
            self.simulator.prior.names,
            x=x,
            circular=tuple(getattr(self.simulator, "circular", ())),
            autocorrelated=bool(getattr(self.estimator, "autocorrelated", False)),
        ).assign_coords(trial=np.asarray(trials))


class _Importance(_Main):
    """Draws with their log densities, for importance weights, on the truths and data of the main trials."""

    def __init__(self, simulator: Simulator, estimator: Estimator, plan: Plan, main: xr.Dataset):
        super().__init__(simulator, estimator, plan)
        self.main = main

    def __call__(self, trials: range) -> xr.Dataset:
        rows = slice(trials.start, trials.stop)
        theta, x = self.main["theta_true"].values[rows], self.main["x"].values[rows]
        n = self.plan.importance_draws
        stream = self.streams("importance draws", trials)
        with _blamed("estimator", trials):
            sampled, density = sample_and_log_prob(self.estimator, x, n, stream)
        draws = self.checked(sampled, trials, n)
        log_q = self.checked(density, trials, n, what="log_q")
        # A draw that is not finite has no likelihood; it is counted, never replaced.
        finite = np.isfinite(draws).all(axis=-1)
        known = np.where(finite[..., None], draws, self.simulator.prior.center)
        log_prior = np.where(finite, self.simulator.prior.log_prob(known), np.nan)
        inside = np.isfinite(log_prior)
        known = np.where(inside[..., None], known, self.simulator.prior.center)
        data = x[:, None]
        likelihood = np.asarray(self.simulator.log_likelihood(known, data))  # type: ignore[attr-defined]
        log_likelihood = np.where(inside, likelihood, np.where(finite, -np.inf, np.nan))
        return make_trials(
            theta,
            draws,
            self.simulator.prior.names,
            log_q=log_q,
            log_likelihood=log_likelihood,
            log_prior=log_prior,
            autocorrelated=bool(getattr(self.estimator, "autocorrelated", False)),
        ).assign_coords(trial=np.asarray(trials))
