"""MCMC and nested samplers: a run for each simulated data set, of emcee, dynesty, nautilus or UltraNest."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from gaugeblock.auditing.trials_from.arrays import data_of, stacked
from gaugeblock.core.arrays import Array, plain
from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import read_text
from gaugeblock.core.streams import Rng, generator
from gaugeblock.validate import make_trials

SOURCE = "trials_from_samplers"
# Where UltraNest, and BXA with it, leaves draws of equal weight in the folder of a run.
EQUAL = Path("chains", "equal_weighted_post.txt")
KNOWN = (
    "an emcee EnsembleSampler, dynesty's results, a nautilus Sampler, UltraNest's result or the folder of an "
    "UltraNest or BXA run, (points, log_weights), or an array (draw, parameter) or (step, walker, parameter)"
)


def trials_from_samplers(
    runs: Sequence[Any],
    truths: ArrayLike,
    *,
    draws: int = 250,
    names: Sequence[str] | None = None,
    x: ArrayLike | None = None,
    discard: int = 0,
    seed: int = 0,
) -> xr.Dataset:
    """Trials from one run a simulated data set; `truths` ``(trial, parameter)``, columns as in the runs.

    A run is an emcee ``EnsembleSampler``, dynesty's ``results``, a nautilus ``Sampler``, UltraNest's result
    or the folder of an UltraNest or BXA run; or (points, log weights), or an array: equal weights ``(draw,
    parameter)``, or a chain ``(step, walker, parameter)`` as emcee's ``get_chain`` gives it. Of weighted
    points `draws` are drawn by their weights; of a chain all steps are taken after `discard`, walker after
    walker, and the audit thins them as far as they depend on their order.

    Raises
    ------
    InputError
        If a run is nothing of these, or runs and truths do not fit together; the line names the trial.

    >>> import numpy as np
    >>> runs = [(np.random.default_rng(k).random((900, 2)), np.zeros(900)) for k in range(4)]
    >>> dict(trials_from_samplers(runs, np.full((4, 2), 0.5), draws=50).sizes)
    {'trial': 4, 'parameter': 2, 'draw': 50}
    """
    if not len(runs):
        raise InputError(f"{SOURCE}: no runs; give one per simulated data set")
    made = [
        _drawn(run, draws, discard, generator(seed, SOURCE, trial), f"{SOURCE}: run {trial}")
        for trial, run in enumerate(runs)
    ]
    chains = {chain for _, chain in made}
    if len(chains) > 1:
        raise InputError(f"{SOURCE}: some runs are Markov chains and some are not; give runs of one kind")
    theta = plain(truths, what=f"{SOURCE}: truths")
    return make_trials(
        theta[:, None] if theta.ndim == 1 else theta,
        stacked([points for points, _ in made], what=f"{SOURCE}: runs"),
        names,
        x=data_of(x, None, source=SOURCE),
        autocorrelated=chains == {True},
    )


def _drawn(run: Any, draws: int, discard: int, rng: Rng, source: str) -> tuple[Array, bool]:
    """Draws ``(draw, parameter)`` of one run, and whether they are a Markov chain's."""
    if isinstance(run, str | os.PathLike):
        return _chosen(_table(Path(run) / EQUAL), draws, rng, source), False
    if hasattr(run, "get_chain"):
        run = run.get_chain()
    weighted = _weighted(run)
    if weighted is not None:
        points, log_weight = (plain(part, what=source) for part in weighted)
        if points.ndim != 2 or log_weight.shape != points.shape[:1]:
            raise InputError(
                f"{source}: points of shape {points.shape} with log weights of shape {log_weight.shape}; "
                "expected (point, parameter) and (point,)"
            )
        if not np.isfinite(log_weight).any() or not (log_weight < np.inf).all():
            raise InputError(f"{source}: log weights must be finite or -inf, and some of them finite")
        weight = np.exp(log_weight - log_weight.max())
        return points[rng.choice(len(points), draws, p=weight / weight.sum())], False
    if isinstance(run, Mapping) and "samples" in run:  # UltraNest's own draws of equal weight
        run = run["samples"]
    try:
        points = plain(run, what=source)
    except InputError:
        raise InputError(f"{source} is a {type(run).__name__}; expected {KNOWN}") from None
    if points.ndim == 3:
        kept = points[discard:].swapaxes(0, 1)
        return kept.reshape(-1, points.shape[-1]), True
    if points.ndim != 2:
        raise InputError(f"{source} has the shape {points.shape}; expected {KNOWN}")
    return _chosen(points, draws, rng, source), False


def _weighted(run: Any) -> tuple[Any, Any] | None:
    """Points and log weights of a nested sampler's run; None of anything else."""
    if isinstance(run, tuple) and len(run) == 2:
        return run
    if hasattr(run, "posterior"):  # nautilus: points, log weights, log likelihoods
        return tuple(run.posterior()[:2])
    if hasattr(run, "logwt") and hasattr(run, "samples"):  # dynesty
        return run.samples, run.logwt
    return None


def _chosen(points: Array, draws: int, rng: Rng, source: str) -> Array:
    """So many of the points, none twice: their order may be that of the run."""
    if len(points) < draws:
        raise InputError(f"{source} has {len(points)} draws; {draws} are asked for: give draws={len(points)}")
    return points[rng.permutation(len(points))[:draws]]


def _table(path: Path) -> Array:
    """Columns of numbers below a line of names."""
    if not path.is_file():
        raise InputError(f"{SOURCE}: {path}: no such file; give the folder of an UltraNest or BXA run")
    lines = read_text(path).splitlines()[1:]
    try:
        return np.array([[float(value) for value in line.split()] for line in lines if line.strip()])
    except ValueError as error:
        raise InputError(f"{SOURCE}: {path}: is no table of numbers ({error})") from None
