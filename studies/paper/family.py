"""Claims that depend on a trained flow, judged together: how many should be missed, and how many are.

A tolerance has an error rate of its own: a faithful replication, with another flow and other spectra, misses
it now and then. Over hundreds of claims some misses are owed; more than owed is a finding.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from gaugeblock.core.arrays import Array
from studies.paper.claim import Claim, Kind
from studies.paper.judge import Agreement, Judgement

REPLICATIONS = 20_000
"""Replications that a claim's error rate is computed from."""

SHARED = 1.0 / 3.0
"""Correlation of two AUCs that share 200 clean spectra and have 100 suspicious ones each, at the null."""


@dataclass(frozen=True, kw_only=True)
class Family:
    """Misses among claims, and what their tolerances' own error rates predict.

    `p_value` is the probability of so many or more for faithful replications that are independent,
    `p_shared` the same where AUCs on the same clean spectra move together; `most` of 95 in 100 such families
    miss no more.
    """

    claims: int
    misses: int
    expected: float
    p_value: float
    p_shared: float
    most: int


def miss_probability(claim: Claim) -> float:
    """Probability that a faithful replication misses the claim's tolerance; NaN where no error is known.

    A part whose true value is known varies around it, any other around the published value with the errors
    of both measurements. Rules about parts that were not published are left out.
    """
    rules = [rule for rule in claim.rules if set(rule.of) <= set(claim.parts)]
    if not rules or not set().union(*(rule.of for rule in rules)) <= set(claim.error):
        return float("nan")
    # Of the claim's own, so that its rate does not depend on which others there are.
    rng = np.random.default_rng(zlib.crc32(claim.id.encode()))
    drawn = {}
    for part, error in claim.error.items():
        spread = error if part in claim.known else np.sqrt(2.0) * error
        drawn[part] = rng.normal(claim.known.get(part, claim.parts[part]), spread, REPLICATIONS)
    kept = np.logical_and.reduce([rule.satisfied(claim.parts, drawn) for rule in rules])
    return float(1.0 - kept.mean())


def number_law(probability: Sequence[float] | Array) -> Array:
    """Law of the number of misses: of a sum of independent events, ``(events + 1,)``.

    >>> number_law([0.5, 0.5]).tolist()
    [0.25, 0.5, 0.25]
    """
    law = np.ones(1)
    for p in probability:
        law = np.convolve(law, [1.0 - p, p])
    return law


def shared_numbers(probability: Array, group: Sequence[str], *, families: int = 4000, seed: int = 0) -> Array:
    """Numbers of misses ``(family,)`` of events that are correlated within their groups."""
    from scipy import special

    rng = np.random.default_rng(seed)
    _, place = np.unique(np.asarray(group), return_inverse=True)
    common = rng.standard_normal((families, place.max() + 1))[:, place]
    own = rng.standard_normal((families, len(place)))
    size = np.abs(np.sqrt(SHARED) * common + np.sqrt(1.0 - SHARED) * own)
    return np.asarray((size > -special.ndtri(probability / 2.0)).sum(axis=1))


def family(judgements: Iterable[Judgement]) -> Family | None:
    """The measured claims among these that depend on a flow and have a known error rate, if any."""
    chosen = [
        (item, miss_probability(item.claim))
        for item in judgements
        if item.claim.kind is Kind.FLOW and item.verdict in (Agreement.AGREES, Agreement.DIFFERS)
    ]
    chosen = [(item, p) for item, p in chosen if np.isfinite(p)]
    if not chosen:
        return None
    probability = np.clip([p for _, p in chosen], 1e-9, 1.0 - 1e-9)
    misses = sum(item.verdict is Agreement.DIFFERS for item, _ in chosen)
    law = number_law(probability)
    shared = shared_numbers(probability, [_group(item.claim) for item, _ in chosen])
    return Family(
        claims=len(chosen),
        misses=misses,
        expected=float(probability.sum()),
        p_value=float(law[misses:].sum()),
        p_shared=float((1 + np.count_nonzero(shared >= misses)) / (1 + len(shared))),
        most=int(np.quantile(shared, 0.95)),
    )


def _group(claim: Claim) -> str:
    """Cells that share their clean spectra: one response, level and detector."""
    parts = claim.id.split(".")
    return ".".join((*parts[1:3], parts[-1])) if parts[0] == "grid" else claim.id
