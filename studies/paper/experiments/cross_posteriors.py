"""Posteriors of spectra with a free gain: by importance weights, nested sampling, NUTS, and by flows."""

from __future__ import annotations

import time
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from scipy import stats

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.extend.adaptive import Mixture, effective_draws
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name.drawn_posterior import POOR, posterior_draws
from gaugeblock.discovery.name.peak_search import systematic
from gaugeblock.discovery.starts import likeliest_draws
from studies.paper.experiments.arithmetic import GAIN_PRIOR_SD
from studies.paper.experiments.cross_spectra import folded, simulators, weighted_sd, wide
from studies.paper.experiments.information import LEVELS
from studies.paper.experiments.setup import GAIN_PRIOR
from studies.paper.interpolated import GAIN, Interpolated

BATCH = 1024
"""Points that UltraNest proposes at a time: posteriors of bright spectra fill little of its ellipsoids."""

BATCHES = 20
"""Stretches of a chain whose scatter is its error."""

ACCEPTED = 0.95
"""Acceptance probability that steps of a chain are adapted to."""

GAINS = 21
"""Gains at which the likelihood is maximised over everything else."""

RESAMPLED = 200
"""Bootstrap samples of a run's threads."""

ROUNDS, ENOUGH = 6, 0.15
"""A proposal learns so often at most, and as long as fewer draws than this share are effective."""

KEPT = 4000
"""Equal-weight draws that are kept of a spectrum."""

SETS = 16
"""The study quotes a mean over so many sets of a flow's draws."""

FOLDED = 400
"""Draws that are weighted again by folding."""


def exact(
    flow: Any, counts: Array, level: str, prior: str, draws: int, rng: np.random.Generator
) -> Mapping[str, Any]:
    """Posterior of every spectrum: equal-weight draws, mean and sd, shrink of the gain with its error.

    By importance weights of a flow's draws: exact where they leave enough effective draws, whatever the flow
    is like; where they leave few, the proposal learns from them. Draws around fits leave too few of bright
    spectra. `folded` is the shrink by the study's own rule of integration: the same draws with other weights.
    """
    target = simulators()[prior].exposed(LEVELS[level])
    # One spectrum after another: expected counts of all draws of all spectra would not fit into memory.
    rows = [weighted_draws(flow, target, row, draws, rng) for row in counts]
    found = {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    few = found["draws"][:, :FOLDED]
    rough = folded(prior)
    first, second = (
        _log_likelihood(simulator, few, counts, LEVELS[level]) for simulator in (rough, simulators()[prior])
    )
    weight = np.exp(first - second - (first - second).max(axis=1, keepdims=True))
    weight /= weight.sum(axis=1, keepdims=True)
    even = np.full_like(weight, 1.0 / weight.shape[1])
    gain = few[..., GAIN]
    found["folded"] = found["shrink"] * weighted_sd(gain, weight) / weighted_sd(gain, even)
    found["folded_effective"] = 1.0 / (weight**2).sum(axis=1) / weight.shape[1]
    return found


def _log_likelihood(simulator: Any, theta: Array, counts: Array, scale: float) -> Array:
    mean = np.asarray(simulator.expected(theta.reshape(-1, theta.shape[-1]))) * scale
    mean = mean.reshape(*theta.shape[:2], -1)
    return np.asarray(np.matmul(np.log(mean), counts[..., None])[..., 0] - mean.sum(axis=-1))


def weighted_draws(
    flow: Any, target: Interpolated, counts: Array, draws: int, rng: np.random.Generator
) -> dict[str, Array]:
    """Summaries of one spectrum ``(channel,)`` from weighted draws of a flow."""

    def drawn(proposal: Mixture, number: int) -> tuple[Array, Array]:
        theta, log_q = proposal.sample_and_log_prob(counts[None], number, rng)
        log_target = _log_likelihood(target, theta, counts[None], 1.0) + target.prior.log_prob(theta)
        return theta, log_target - log_q

    proposal = Mixture(flow, target.prior)
    for _ in range(ROUNDS):
        theta, log_weight = drawn(proposal, draws // ROUNDS)
        if effective_draws(log_weight)[0] > ENOUGH * log_weight.shape[1]:
            break
        proposal = proposal.learn(theta, log_weight)
    theta, log_weight = drawn(proposal, draws)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    # In random order: systematic picks come in that of the proposals.
    kept = rng.permuted(systematic(weight, min(draws, KEPT), rng), axis=1)
    shrink, error = shrink_of(theta[..., GAIN], weight)
    return {
        "draws": theta[0, kept[0]],
        "mean": (weight[0, :, None] * theta[0]).sum(axis=0),
        "sd": weighted_sd(theta[0].T, weight),
        "shrink": shrink[0],
        "shrink_error": error[0],
        "effective": 1.0 / (weight**2).sum(),
    }


def _around_fit(
    simulator: Interpolated, counts: Array, scale: float, draws: int, rng: np.random.Generator
) -> dict[str, Any]:
    scales = np.full(len(counts), scale)
    fitted = fit(simulator, counts, scale=scales, seed=int(rng.integers(2**31)))
    found = posterior_draws(simulator, counts, fitted, scale=scales, draws=draws, rng=rng)
    shrink, error = shrink_of(found.theta[..., GAIN], found.weight)
    # Where weights were poor, draws are resampled and look independent: they are worth this many at least.
    effective = np.where(found.effective > 0.999 * draws, POOR * draws, found.effective)
    error = error * np.sqrt(found.effective / effective)
    return {"shrink": shrink, "shrink_error": error, "effective": effective}


def shrink_of(gain: Array, weight: Array) -> tuple[Array, Array]:
    """Posterior sd of the gain over its prior's, and the error by the effective number of draws."""
    sd = weighted_sd(gain, weight)
    mean = (weight * gain).sum(axis=-1, keepdims=True)
    kurtosis = (weight * (gain - mean) ** 4).sum(axis=-1) / sd**4
    effective = 1.0 / (weight**2).sum(axis=-1)
    shrink = sd / GAIN_PRIOR_SD
    return shrink, np.asarray(shrink * np.sqrt((kurtosis - 1.0) / (4.0 * effective)))


def nested(counts: Array, live: int, rng: np.random.Generator) -> Mapping[str, Any]:
    """One run of UltraNest on one bright spectrum under the study's prior."""
    from gaugeblock.estimators.nested_sampling import NestedSampling

    sampler = NestedSampling(
        simulators()["published_linear_norm"],
        live_points=live,
        dlogz=float(0.5 * np.sqrt(400 / live)),
        min_effective_draws=live,
        batch=BATCH,
    )
    start = time.process_time()
    found = sampler.run(counts, rng)
    seconds = time.process_time() - start
    shrink, _ = shrink_of(found.theta[:, GAIN], np.exp(found.log_weight))
    error = thread_scatter(found, found.theta[:, GAIN], rng) / GAIN_PRIOR_SD
    return {"shrink": shrink, "shrink_error": error, "calls": found.calls, "seconds": seconds}


def thread_scatter(found: Any, values: Array, rng: np.random.Generator) -> float:
    """Error of the posterior sd of one value a point: its scatter when whole threads are resampled.

    Draws of a run share the threads that found their part of the posterior, so that their effective number
    understates it (Higson et al. 2018).
    """
    from gaugeblock.validate.evidence import threads_of

    threads = threads_of(found)
    ordered = values[np.argsort(found.log_likelihood, kind="stable")]
    counts = np.zeros((RESAMPLED, len(threads.start)), dtype=np.int64)
    from_prior = np.isneginf(threads.start)
    for group in (np.flatnonzero(from_prior), np.flatnonzero(~from_prior)):
        if len(group):
            even = np.full(len(group), 1.0 / len(group))
            counts[:, group] = rng.multinomial(len(group), even, size=RESAMPLED)
    number = counts[:, threads.thread].astype(float)
    live = threads.live_points(number)
    step = number / np.where(number > 0, live, 1.0)
    with np.errstate(divide="ignore"):  # a point that counts nothing has no shell
        log_weight = threads.log_likelihood - np.cumsum(step, axis=1) + np.log(np.expm1(step))
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    weight /= weight.sum(axis=1, keepdims=True)
    return float(weighted_sd(ordered, weight).std(ddof=1))


@cache
def _sampler(warmup: int) -> Any:
    """NUTS without thinning, compiled once whatever is thinned."""
    from gaugeblock.estimators.nuts import Nuts

    simulator = simulators()["published_linear_norm"]
    # The gain runs into both ends of its prior: with shorter steps fewer trajectories diverge there.
    return Nuts(simulator, warmup=warmup, thinning=1, target_acceptance=ACCEPTED)


def chain(counts: Array, thinning: int, sizes: Mapping[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """NUTS on bright spectra side by side: shrink by the chain, with its error by stretches of it; draws."""
    found = _sampler(sizes["warmup"]).run(counts, thinning * sizes["chain"], rng)
    draws = found.draws[:, thinning - 1 :: thinning]
    gain = draws[..., GAIN]
    away = (gain - gain.mean(axis=1, keepdims=True)) ** 2
    parts = away.reshape(len(gain), BATCHES, -1).mean(axis=2)
    shrink = np.sqrt(away.mean(axis=1)) / GAIN_PRIOR_SD
    error = shrink * parts.std(axis=1, ddof=1) / np.sqrt(BATCHES) / (2.0 * parts.mean(axis=1))
    kept = draws[:, :: max(1, draws.shape[1] // KEPT)]
    return {"shrink": shrink, "shrink_error": error, "divergences": found.divergences, "draws": kept}


def boundary(counts: Array, sizes: Mapping[str, Any], rng: np.random.Generator) -> Mapping[str, Any]:
    """One medium spectrum: its likelihood along the gain in both boxes, its shrink in the wider one."""
    scale = LEVELS["medium"]
    wider = wide()
    found = _around_fit(wider, counts[None], scale, sizes["draws"], rng)
    ranges = {
        name: np.ptp(profile(simulator, counts, scale))
        for name, simulator in (("box", simulators()["published_linear_norm"]), ("wider", wider))
    }
    return {
        **{name: values[0] for name, values in found.items()},
        "range": ranges["box"],
        "range_wider": ranges["wider"],
    }


def profile(simulator: Interpolated, counts: Array, scale: float) -> Array:
    """Largest log likelihood at gains across their prior, ``(gain,)``."""
    rows, scales = np.tile(counts, (GAINS, 1)).astype(float), np.full(GAINS, scale)
    starts = likeliest_draws(simulator, rows, scales, tries=16)
    starts[..., GAIN] = np.linspace(*GAIN_PRIOR.support, GAINS)[:, None]
    fitted = fit(simulator, rows, scale=scales, start=starts, fixed=(simulator.prior.names[GAIN],))
    return np.asarray(fitted.log_likelihood)


def refined(flow: Any, counts: Array, level: str, draws: int, rng: np.random.Generator) -> Mapping[str, Any]:
    """Shrink of the gain by draws of a flow with importance weights."""
    target = simulators()["reference"].exposed(LEVELS[level])
    rows = [weighted_draws(flow, target, row, draws, rng) for row in counts]
    found = {name: np.array([row[name] for row in rows]) for name in ("shrink", "shrink_error", "effective")}
    return found | {"effective": found["effective"] / draws}


def by_flow(flow: Any, counts: Array, draws: int, rng: np.random.Generator) -> Mapping[str, Any]:
    """Draws of a flow, and the shrink of the gain by them: by all, and by sets of them."""
    theta = flow.sample(counts, draws, rng)
    raw = shrink_of(theta[..., GAIN], np.full(theta.shape[:2], 1.0 / draws))
    sets = theta[:, : draws // SETS * SETS, GAIN].reshape(len(theta), SETS, -1)
    return {
        "draws": theta[:, :KEPT],
        "mean": theta.mean(axis=1),
        "sd": theta.std(axis=1),
        "shrink": raw[0],
        "shrink_error": raw[1],
        "by_set": sets.std(axis=2) / GAIN_PRIOR_SD,
    }


def told_apart(
    first: Array, second: Array, rng: np.random.Generator, number: int
) -> tuple[float, float, float, float]:
    """Accuracy of a classifier on two sets of draws ``(draw, parameter)`` and its error; for the gain too."""
    from gaugeblock.validate.learned import classifier_two_sample

    spread = first.std(axis=0)
    pair = [
        (rows[rng.permutation(len(rows))[:number]] - first.mean(axis=0)) / spread for rows in (first, second)
    ]
    every = classifier_two_sample(*pair, rng=rng, permutations=99)
    gain = classifier_two_sample(*(rows[:, [GAIN]] for rows in pair), rng=rng, permutations=99)
    return every.accuracy, every.standard_error, gain.accuracy, gain.standard_error


def overlap(first: Array, second: Array) -> float:
    """Mean over parameters of intersection over union of both 68 per cent intervals.

    >>> same = np.random.default_rng(0).normal(size=(1000, 2))
    >>> overlap(same, same), round(overlap(same, same + 1.0), 1)
    (1.0, 0.3)
    """
    levels = stats.norm.cdf([-1.0, 1.0])
    low, high = (np.stack([np.quantile(rows, q, axis=0) for rows in (first, second)]) for q in levels)
    shared = np.maximum(high.min(axis=0) - low.max(axis=0), 0.0)
    return float(np.mean(shared / (high.max(axis=0) - low.min(axis=0))))


def effective_dimension(draws: Array) -> float:
    """Participation ratio of the correlations of draws ``(draw, parameter)``: 1 for one direction.

    >>> line = np.random.default_rng(0).normal(size=(1000, 1)) * np.ones(3)
    >>> round(effective_dimension(line), 6)
    1.0
    """
    values = np.linalg.eigvalsh(np.corrcoef(draws.T))
    return float(values.sum() ** 2 / (values**2).sum())
