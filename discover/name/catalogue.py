"""A catalogue searched for an effect that all its sources share: scores, stack and null in one pass."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import partial
from itertools import groupby, islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.discovery.blocks import Answer, Each, by_response, here
from gaugeblock.discovery.derivatives import TINY
from gaugeblock.discovery.fitting import Fit
from gaugeblock.discovery.library import Candidate, Candidates
from gaugeblock.discovery.name.score import allowed, projection
from gaugeblock.discovery.name.shapes import templates
from gaugeblock.discovery.name.shared import Shared, Term, share
from gaugeblock.discovery.name.shared_score import SEEN, SharedScores, join, shared_scores
from gaugeblock.discovery.name.stacked import Stack, projector, stack
from gaugeblock.discovery.sources import Sources


@dataclass(frozen=True, eq=False)
class Members:
    """A block of sources, their fits, and the candidates worked into their simulator."""

    sources: Sources
    fit: Fit
    candidates: Candidates


@dataclass(frozen=True, eq=False)
class SharedSearch:
    """What a catalogue says of every candidate at every scanned value.

    `owner`, `node` and `sign` ``(template,)`` as in `Templates`; `gram` ``(template, template)`` the
    information that templates share, off the sources' own parameters; `null` ``(replicate,)`` the largest
    allowed z of each simulated effect-free catalogue.
    """

    owner: NDArray[np.str_]
    node: NDArray[np.int64]
    sign: NDArray[np.int64]
    scores: SharedScores
    stack: Stack
    gram: Array
    null: Array


def search_shared(
    groups: Sequence[Members],
    terms: Sequence[Term] = (),
    *,
    replicates: int = 999,
    rng: np.random.Generator,
    each: Each = here,
) -> SharedSearch:
    """Search a catalogue for one shared effect, beside the shared nuisances `terms` with their priors.

    An effect is never tested beside a nuisance of its own kind: the slope of the gain beside a free offset,
    the offset beside a free slope. The null is simulated from the fitted models, nuisances drawn from their
    priors; the sources' fits to each replicate are taken to first order. How the sources of a response are
    cut into blocks decides nothing but the order of sums.

    Raises
    ------
    InputError
        If there are no groups, or they do not have the same candidates.
    """
    if not groups or len({tuple(group.candidates.entries) for group in groups}) != 1:
        raise InputError("discover: a catalogue needs sources, and all its responses the same candidates")
    sources = [group.sources for group in groups]
    answers = each(
        partial(_pass, replicates=replicates),
        sources,
        [group.fit for group in groups],
        [list(group.candidates) for group in groups],
        by_response(sources, partial(share, terms=terms)),
        list(_streams(sources, rng)),
    )
    parts: list[SharedScores] = []
    gram: Any = 0.0
    simulated: Any = 0.0
    for answer in answers:
        parts.append(SharedScores.of(answer))
        gram, simulated = gram + answer["gram"], simulated + answer["null"]
        owner, node, sign = answer["owner"], answer["node"], answer["sign"]
    scores = join(parts)
    sd = np.array([term.sd for term in terms], dtype=float)
    drawn = _drawn(simulated, scores, sd, rng.spawn(1)[0])
    z, stacked = np.zeros((replicates, len(owner))), []
    pieces = _pieces(owner, terms)
    for columns, beside in pieces:
        part = scores.with_templates(columns).with_nuisances(beside)
        stacked.append(stack(part, sd[beside]))
        count = scores.score.shape[1]
        z[:, columns] = _simulated_z(
            drawn[:, :count][:, columns], drawn[:, count:][:, beside], part, sd[beside]
        )
    order = np.argsort(np.concatenate([columns for columns, _ in pieces]))
    whole = Stack(*(np.concatenate([getattr(s, f.name) for s in stacked])[order] for f in fields(Stack)))
    null = allowed(z, sign).max(axis=1)
    return SharedSearch(owner, node, sign, scores, whole, np.asarray(gram), null)


def _streams(blocks: Sequence[Sources], rng: Rng) -> Iterator[list[Rng]]:
    """A generator for each source of each block, the same however a response's sources are cut."""
    responses = [list(run) for _, run in groupby(blocks, key=lambda one: id(one.simulator))]
    for generator, run in zip(rng.spawn(len(responses)), responses, strict=True):
        streams = iter(generator.spawn(sum(map(len, run))))
        yield from (list(islice(streams, len(block))) for block in run)


def _pieces(
    owner: NDArray[np.str_], terms: Sequence[Term]
) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Which templates are tested beside which nuisances: an effect never beside itself."""
    beside: dict[tuple[int, ...], list[int]] = {}
    for column, name in enumerate(owner.tolist()):
        others = tuple(k for k, term in enumerate(terms) if term.entry.name != name)
        beside.setdefault(others, []).append(column)
    return [(np.array(columns), np.array(others, dtype=np.int64)) for others, columns in beside.items()]


def _pass(
    sources: Sources,
    fit: Fit,
    candidates: Sequence[Candidate],
    shared: Shared,
    streams: Sequence[Rng],
    *,
    replicates: int,
) -> Answer:
    """A block's scores and part of the gram matrix, and `null`: the sum of its simulated scores, of templates
    and then nuisances, ``(replicate, template + nuisance)``.
    """
    found = templates(candidates, sources, fit)
    beside = shared.templates(fit.theta, shared.neutral, sources.scale, sources.redshift)
    beside = beside.reshape(len(sources), -1, found.values.shape[2])
    project = projection(fit)
    every = project(np.concatenate([found.values, beside], axis=1))
    own = every[:, : found.values.shape[1]]
    return {
        **vars(shared_scores(sources.counts, fit, found.values, beside)),
        "gram": np.einsum("ntc,nuc->tu", own, found.values / project.root_mean[:, None], optimize=True),
        "null": _simulated(every, fit.expected, project.root_mean, replicates, streams),
        "owner": found.owner,
        "node": found.node,
        "sign": found.sign,
    }


def _simulated(every: Array, expected: Array, root: Array, replicates: int, streams: Sequence[Rng]) -> Array:
    """Scores of simulated counts, summed over sources, ``(replicate, template + nuisance)``."""
    total = np.zeros((replicates, every.shape[1]))
    for projected, mean, scale, stream in zip(every, np.maximum(expected, TINY), root, streams, strict=True):
        counts = stream.poisson(np.broadcast_to(mean, (replicates, len(mean))))
        total += ((counts - mean) / scale) @ projected.T
    return total


def _drawn(simulated: Array, scores: SharedScores, sd: Array, rng: Rng) -> Array:
    """Simulated scores with nuisances drawn from their priors; without a prior they leave no trace in z."""
    known = np.isfinite(sd)
    amplitude = rng.standard_normal((len(simulated), len(sd))) * np.where(known, sd, 0.0)
    template = amplitude @ scores.cross.sum(axis=0).T
    nuisance = amplitude @ scores.nuisance_information.sum(axis=0)
    return np.asarray(simulated + np.concatenate([template, nuisance], axis=1))


def _simulated_z(template: Array, nuisance: Array, scores: SharedScores, sd: Array) -> Array:
    """z ``(replicate, template)`` of simulated catalogues from their summed scores."""
    weight = projector(scores, sd)
    own = scores.information.sum(axis=0)
    information = own - (weight * scores.cross.sum(axis=0)).sum(axis=1)
    seen = information > SEEN * own
    score = template - nuisance @ weight.T
    return np.where(seen, score / np.sqrt(np.where(seen, information, 1.0)), 0.0)
