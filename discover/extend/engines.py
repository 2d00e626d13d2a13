"""Estimators as a re-fit uses them: draws, evidence and what each says of itself, or a plain refusal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.discovery.extend.adaptive import Mixture
from gaugeblock.discovery.extend.widened import Widened
from gaugeblock.estimators.importance_refined import ImportanceRefined, WeightedDraws
from gaugeblock.estimators.protocol import HasDensity
from gaugeblock.simulators.protocol import HasLikelihood
from gaugeblock.validate.evidence import thread_bootstrap
from gaugeblock.validate.joint.importance import KHAT_LIMIT
from gaugeblock.validate.joint.psis import pareto_khat

CHAINS = 4
RHAT_LIMIT = 1.1
"""Chains that disagree by more than this are not draws from one posterior (Gelman & Rubin 1992)."""


class EngineDraws(NamedTuple):
    """The fields of a `Refit` that an estimator fills."""

    draws: Array
    log_evidence: Array | None
    log_evidence_error: Array | None
    diagnostics: Mapping[str, NDArray[Any]]


def by_nested_sampling(
    simulator: Any, x: NDArray[Any], draws: int, rng: np.random.Generator, **options: Any
) -> EngineDraws:
    """UltraNest, one run a row; the error of the evidence by bootstrap over its threads."""
    from gaugeblock.estimators.nested_sampling import NestedSampling

    sampler = NestedSampling(simulator, **options)
    runs = [sampler.run(row, rng) for row in x]
    evidence = [thread_bootstrap(run, rng=rng) for run in runs]
    return EngineDraws(
        np.stack([run.resample(draws, rng) for run in runs]),
        np.array([found.value for found in evidence]),
        np.array([found.error for found in evidence]),
        {
            "calls": np.array([run.calls for run in runs]),
            "insertion_order_converged": np.array([run.insertion_order_converged for run in runs]),
        },
    )


def by_chains(
    simulator: Any, x: NDArray[Any], draws: int, rng: np.random.Generator, **options: Any
) -> EngineDraws:
    """Four NUTS chains a row, refused where they disagree."""
    from gaugeblock.estimators.nuts import Nuts

    each = -(-draws // CHAINS)
    run = Nuts(simulator, **options).run(np.repeat(x, CHAINS, axis=0), each, rng)
    chains = run.draws.reshape(len(x), CHAINS, each, -1)
    rhat = split_rhat(chains)
    worst = np.unravel_index(int(np.argmax(rhat)), rhat.shape)
    if not rhat[worst] <= RHAT_LIMIT:
        raise InputError(
            f"refit by nuts: chains of source {worst[0]} disagree on {simulator.prior.names[worst[1]]} "
            f"(R-hat {rhat[worst]:.2f} > {RHAT_LIMIT}): more warmup or thinning, or by='nested_sampling', "
            "which crosses between modes"
        )
    return EngineDraws(
        chains.swapaxes(1, 2).reshape(len(x), each * CHAINS, -1)[:, :draws],
        None,
        None,
        {"rhat": rhat, "divergences": run.divergences.reshape(len(x), CHAINS).sum(axis=1)},
    )


def split_rhat(chains: Array) -> Array:
    """R-hat of halved chains ``(source, chain, draw, parameter)``, ``(source, parameter)``; 1 where they mix.

    Gelman et al. (2013), Bayesian Data Analysis, section 11.4.

    >>> bool(np.all(split_rhat(np.random.default_rng(0).normal(size=(1, 4, 500, 2))) < 1.01))
    True
    """
    half = chains.shape[2] // 2
    parts = np.concatenate([chains[:, :, :half], chains[:, :, half : 2 * half]], axis=1)
    within = parts.var(axis=2, ddof=1).mean(axis=1)
    between = parts.mean(axis=2).var(axis=1, ddof=1)
    return np.asarray(np.sqrt((half - 1) / half + between / within))


def by_importance(
    simulator: Any,
    x: NDArray[Any],
    draws: int,
    rng: np.random.Generator,
    *,
    estimator: Any,
    proposals: int = 20_000,
    rounds: int = 6,
) -> EngineDraws:
    """Draws of an estimator of the plain simulator, widened, adapted in some rounds, weighted, resampled."""
    if rounds < 0 or proposals < 100:
        raise InputError(
            f"refit by importance: needs rounds >= 0, proposals >= 100, got {rounds} and {proposals}"
        )
    mixture = Mixture(Widened(estimator, simulator), simulator.prior)
    for _ in range(rounds):
        weigh = ImportanceRefined(mixture, simulator)
        trial, log_q = mixture.sample_and_log_prob(x, proposals, rng)
        mixture = mixture.learn(trial, weigh.log_target(trial, x) - log_q)
    weighted = ImportanceRefined(mixture, simulator).weights(x, proposals, rng)
    khat = pareto_khat(weighted.log_weight)
    worst = int(np.argmax(np.where(np.isnan(khat), np.inf, khat)))
    if not khat[worst] <= KHAT_LIMIT:
        raise InputError(
            f"refit by importance: k-hat of source {worst} is {khat[worst]:.2f} > {KHAT_LIMIT}, its weights "
            f"({weighted.effective_draws[worst]:.0f} effective draws of {proposals}) are not to be relied "
            "on: more proposals or rounds, or by='nested_sampling'"
        )
    return _weighed(weighted, weighted.resample(draws, rng), khat)


def by_flow(
    simulator: Any, x: NDArray[Any], draws: int, rng: np.random.Generator, *, estimator: Any
) -> EngineDraws:
    """Draws of an estimator of the extended simulator, as they are; k-hat says how good they are.

    Without a likelihood, or a density of the estimator, nothing can be said of them here: audit it.
    """
    names, own = simulator.prior.names, getattr(getattr(estimator, "prior", None), "names", None)
    if own is not None and tuple(own) != names:
        raise InputError(
            f"refit by flow: the estimator draws {', '.join(own)}; the extended simulator has "
            f"{', '.join(names)}: train one for it, with the effects as nuisance"
        )
    if not isinstance(simulator, HasLikelihood) or not isinstance(estimator, HasDensity):
        return EngineDraws(np.asarray(estimator.sample(x, draws, rng)), None, None, {})
    weighted = ImportanceRefined(estimator, simulator).weights(x, draws, rng)
    khat = pareto_khat(weighted.log_weight)
    # Where the weights are not to be relied on the draws may still do, but there is no evidence.
    evidence = np.where(khat <= KHAT_LIMIT, weighted.log_evidence, np.nan)
    return _weighed(weighted, weighted.draws, khat)._replace(log_evidence=evidence)


def _weighed(weighted: WeightedDraws, draws: Array, khat: Array) -> EngineDraws:
    return EngineDraws(
        draws,
        weighted.log_evidence,
        weighted.log_evidence_error,
        {"khat": khat, "effective_draws": weighted.effective_draws},
    )
