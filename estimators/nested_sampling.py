"""Nested sampling with UltraNest: posterior draws and evidence from a likelihood alone."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import InputError, require
from gaugeblock.core.streams import Rng
from gaugeblock.core.values import Shown
from gaugeblock.estimators._rows import padded, resample, row_seeds
from gaugeblock.simulators.prior import HasUnitCube, require_prior
from gaugeblock.simulators.protocol import HasLikelihood


class NestedPoints(NamedTuple):
    """Log likelihood of every point ``(point,)``, and of the contour it was drawn above (-inf: the prior)."""

    log_likelihood: NDArray[np.float64]
    birth_log_likelihood: NDArray[np.float64]


def from_dynesty(results: Any) -> NestedPoints:
    """Points of a static or dynamic dynesty run: `sampler.results`.

    Raises
    ------
    InputError
        If it is not a dynesty result, or the run ended without adding its last live points.
    """
    missing = [name for name in ("logl", "samples_id") if not hasattr(results, name)]
    if missing:
        raise InputError(f"from_dynesty: no {', '.join(missing)}; give the results of a dynesty sampler")
    value, strand = np.asarray(results.logl, dtype=float), np.asarray(results.samples_id)
    live, niter = getattr(results, "nlive", None), getattr(results, "niter", None)
    if live is not None and niter is not None and len(value) == niter:
        raise InputError("from_dynesty: the run lacks its last live points; run it with add_live=True")
    bounds = np.asarray(getattr(results, "batch_logl_bounds", [(-np.inf, np.inf)]), dtype=float)
    batch = np.asarray(getattr(results, "samples_batch", np.zeros(len(value), dtype=int)))
    # A strand replaces one live point again and again: each point was drawn above the one before it.
    order = np.lexsort((value, strand))
    birth = np.empty(len(value))
    first = np.concatenate([[True], strand[order][1:] != strand[order][:-1]])
    before = np.concatenate([[-np.inf], value[order][:-1]])
    birth[order] = np.where(first, bounds[batch[order], 0], before)
    return NestedPoints(value, birth)


def from_ultranest(sampler: Any) -> NestedPoints:
    """Points of an UltraNest run, from the `ReactiveNestedSampler` after `run`.

    Its result does not hold the contours of birth; the sampler's tree of points does.

    Raises
    ------
    InputError
        If it is not a sampler that has run.
    """
    value, birth, _ = ultranest_tree(sampler)
    return NestedPoints(value, birth)


def ultranest_tree(
    sampler: Any,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.intp]]:
    """Log likelihood, that of the contour of birth, and row in UltraNest's store of points, ``(point,)``."""
    root = getattr(sampler, "root", None)
    if root is None or not getattr(root, "children", None):
        raise InputError(
            "from_ultranest: give the ReactiveNestedSampler after run(); its result alone does not say on "
            "which contour each point was born"
        )
    level = [(node.value, -np.inf, node.id) for node in root.children]
    found, nodes = list(level), list(root.children)
    while nodes:
        level = [(child.value, node.value, child.id) for node in nodes for child in node.children]
        found += level
        nodes = [child for node in nodes for child in node.children]
    value, birth, row = zip(*found, strict=True)
    return np.array(value, dtype=float), np.array(birth, dtype=float), np.array(row, dtype=np.intp)


LOWEST = -1e100
"""Stands for a log likelihood of -inf, which UltraNest refuses."""


@dataclass(frozen=True, kw_only=True)
class NestedRun:
    """One finished run on one row of data.

    `theta` and `unit_cube` are ``(point, parameter)``; `log_weight` ``(point,)`` holds normalised log
    posterior weights; `log_likelihood` what was evaluated there, and `birth_log_likelihood` the contour that
    the point was drawn above (-inf: the prior), so that `gaugeblock.validate.evidence.thread_bootstrap` and
    `insertion_order_test` take a run as it is; `log_evidence_error` UltraNest's bootstrap error; `calls`
    likelihood evaluations; `insertion_order_converged` its own Mann-Whitney check.
    """

    theta: NDArray[np.float64]
    unit_cube: NDArray[np.float64]
    log_weight: NDArray[np.float64]
    log_likelihood: NDArray[np.float64]
    birth_log_likelihood: NDArray[np.float64]
    log_evidence: float
    log_evidence_error: float
    calls: int
    insertion_order_converged: bool

    def resample(self, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Equal-weight posterior draws ``(n, parameter)``, with replacement."""
        index = resample(self.log_weight[None], rng.random((1, n)))[0]
        return np.asarray(self.theta[index])


class NestedSampling(Shown):
    """UltraNest's reactive nested sampler on the simulator's prior and likelihood, one run a row of data.

    Each run is atomic. UltraNest draws from NumPy's global state; a run seeds that from the row's stream and
    gives the host's state back afterwards. Nothing is printed or written. Not safe to run in two threads of
    one process, for the same reason: use processes.

    Parameters
    ----------
    simulator
        With `log_likelihood`, batched over theta.
    live_points
        Smallest number of live points.
    dlogz
        Target error of the log evidence.
    fraction_remaining
        Stop integrating when this fraction of the evidence is left in the live points.
    min_effective_draws
        Effective sample size the weighted points must reach.
    batch
        Points proposed at a time. Most are turned down before the likelihood sees them; fewer suit a
        likelihood that costs as much per point however many it is called with.

    Raises
    ------
    InputError
        If the simulator has no `log_likelihood`, or it returns NaN or +inf inside the prior.
    MissingExtraError
        If UltraNest is not installed.

    References
    ----------
    Skilling (2004), AIP Conf. Proc. 735, 395; Buchner (2021), JOSS 6(60), 3001.
    """

    def __init__(
        self,
        simulator: Any,
        *,
        live_points: int = 400,
        dlogz: float = 0.5,
        fraction_remaining: float = 0.01,
        min_effective_draws: int = 400,
        batch: int = 1024,
    ):
        require("ultranest", "ultranest")
        if not isinstance(simulator, HasLikelihood):
            raise InputError(f"nested_sampling: {type(simulator).__name__} has no log_likelihood(theta, x)")
        require_prior(simulator.prior, HasUnitCube, "estimator nested_sampling")
        if live_points < 40 or dlogz <= 0 or batch < 1:
            raise InputError(
                "nested_sampling: needs live_points >= 40, dlogz > 0 and batch >= 1, "
                f"got {live_points}, {dlogz} and {batch}"
            )
        self._simulator = simulator
        self._settings = {
            "live_points": int(live_points),
            "dlogz": float(dlogz),
            "fraction_remaining": float(fraction_remaining),
            "min_effective_draws": int(min_effective_draws),
            "batch": int(batch),
        }

    def evaluated_log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """The function UltraNest evaluates: log likelihood ``(n,)`` of theta ``(n, parameter)`` for one x.

        Batches are padded to a power of two with copies of their last row, so that a jitted likelihood is
        compiled for a few shapes only.
        """
        points = np.asarray(theta, dtype=float)
        found = self._simulator.log_likelihood(padded(points), np.asarray(x))
        value = np.asarray(found, dtype=float)[: len(points)]
        bad = np.isnan(value) | np.isposinf(value)
        if bad.any():
            first = int(np.argmax(bad))
            raise InputError(
                f"nested_sampling: log_likelihood is {value[first]} at theta = {points[first].tolist()}; "
                "it must be a finite number, or -inf, everywhere inside the prior"
            )
        return np.asarray(np.maximum(value, LOWEST))

    def run(self, x_row: ArrayLike, rng: np.random.Generator) -> NestedRun:
        """One run on one row of data, shape ``data_shape``."""
        prior, settings = self._simulator.prior, self._settings
        seed = [int(word) for word in rng.integers(0, 2**32, size=8)]
        with silent_ultranest(), global_numpy_seeded(seed):
            import ultranest

            sampler = ultranest.ReactiveNestedSampler(
                list(prior.names),
                lambda theta: self.evaluated_log_likelihood(theta, x_row),
                prior.from_unit_cube,
                vectorized=True,
                ndraw_min=settings["batch"],
            )
            result = sampler.run(
                show_status=False,
                viz_callback=False,
                min_num_live_points=settings["live_points"],
                dlogz=settings["dlogz"],
                frac_remain=settings["fraction_remaining"],
                min_ess=settings["min_effective_draws"],
            )
        points = result["weighted_samples"]
        with np.errstate(divide="ignore"):  # a weight that underflows to zero has log weight -inf
            log_weight = np.log(np.asarray(points["weights"], dtype=float))
        return NestedRun(
            theta=np.asarray(points["points"], dtype=float),
            unit_cube=np.asarray(points["upoints"], dtype=float),
            log_weight=log_weight,
            log_likelihood=np.asarray(points["logl"], dtype=float),
            birth_log_likelihood=_births(sampler, points),
            log_evidence=float(result["logz"]),
            log_evidence_error=float(result["logzerr"]),
            calls=int(result["ncall"]),
            insertion_order_converged=bool(result["insertion_order_MWW_test"]["converged"]),
        )

    def _runs(self, x: ArrayLike, rng: Rng) -> Iterator[tuple[NestedRun, np.random.Generator]]:
        rows = np.asarray(x)
        for row, seed in zip(rows, row_seeds(rng, len(rows)), strict=True):
            generator = np.random.default_rng(int(seed))
            yield self.run(row, generator), generator

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        """Posterior draws ``(batch, n, parameter)``, resampled with replacement from each run's points."""
        return self.sample_and_log_evidence(x, n, rng)[0]

    def sample_and_log_evidence(
        self, x: ArrayLike, n: int, rng: Rng
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """The draws of `sample`, and each run's log evidence with UltraNest's error, ``(batch,)``."""
        draws, pairs = [], []
        for run, generator in self._runs(x, rng):
            draws.append(run.resample(n, generator))
            pairs.append((run.log_evidence, run.log_evidence_error))
        value, error = np.array(pairs, dtype=float).reshape(-1, 2).T
        return np.array(draws).reshape(len(draws), n, self._simulator.prior.size), value, error

    def log_evidence(self, x: ArrayLike, rng: Rng) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Log evidence and its standard error, each ``(batch,)``; the same rng gives the runs of `sample`."""
        return self.sample_and_log_evidence(x, 1, rng)[1:]

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies it."""
        return {"estimator": "nested_sampling", **self._settings}


def _births(sampler: Any, points: Any) -> NDArray[np.float64]:
    """Contour of birth of each weighted sample; the sampler's tree holds the same points in another order."""
    value, birth, row = ultranest_tree(sampler)
    in_tree = np.lexsort((*sampler.pointpile.us[row].T, value))
    in_samples = np.lexsort((*points["upoints"].T, points["logl"]))
    aligned = np.empty(len(birth))
    aligned[in_samples] = birth[in_tree]
    return aligned


@contextmanager
def global_numpy_seeded(seed: list[int]) -> Iterator[None]:
    """Seed NumPy's global state for a library that draws from it; hand the host's state back."""
    before = np.random.get_state(legacy=False)  # noqa: NPY002
    np.random.seed(seed)  # noqa: NPY002
    try:
        yield
    finally:
        np.random.set_state(before)  # noqa: NPY002


@contextmanager
def silent_ultranest() -> Iterator[None]:
    """Keep UltraNest's logger and its advice on efficiency from the host; leave the host's settings alone."""
    logger = logging.getLogger("ultranest")
    handlers, disabled = list(logger.handlers), logger.disabled
    # With a handler in place UltraNest adds none of its own, and leaves the level alone.
    logger.handlers = [logging.NullHandler()]
    logger.disabled = True
    try:
        with warnings.catch_warnings():
            # Whether it advises another sampler depends on the run's luck; what it cost is in `calls`.
            warnings.filterwarnings("ignore", message="Sampling from region seems inefficient")
            yield
    finally:
        logger.handlers, logger.disabled = handlers, disabled
