"""Templates: how the expected counts change under each effect, at a finite amplitude."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.fitting import Fit
from gaugeblock.discovery.library import Candidate
from gaugeblock.discovery.sources import Sources


@dataclass(frozen=True, eq=False)
class Templates:
    """Change of the expected counts per unit of amplitude, of every effect at every scanned value.

    `values` is ``(source, template, channel)``; `owner` names each template's effect; `node`
    ``(template,)`` counts within an effect; `sign` is +1 or -1 where only that side of neutral is allowed,
    0 where both are.
    """

    values: Array
    owner: NDArray[np.str_]
    node: NDArray[np.int64]
    sign: NDArray[np.int64]


def templates(candidates: Iterable[Candidate], sources: Sources, fit: Fit) -> Templates:
    """Finite templates of all candidates at the fitted theta of every source.

    A derivative would do for faint effects only: gains move edges and lines across channels, so the shape is
    taken at a typical amplitude.
    """
    values, owner, node, sign = [], [], [], []
    for candidate in candidates:
        block = effect_templates(candidate, sources, fit)
        values.append(block)
        owner += [candidate.key] * block.shape[1]
        node += list(range(block.shape[1]))
        one_sided = 0 if candidate.entry.two_sided else int(np.sign(candidate.entry.step))
        sign += [one_sided] * block.shape[1]
    return Templates(np.concatenate(values, axis=1), np.array(owner), np.array(node), np.array(sign))


def effect_templates(candidate: Candidate, sources: Sources, fit: Fit) -> Array:
    """Templates ``(source, node, channel)`` of one effect, per unit of its amplitude."""
    n, nodes = len(sources), observed_nodes(candidate, sources)
    base = fit.theta[:, : fit.theta.shape[1]]
    theta = np.concatenate(
        [np.broadcast_to(base[:, None], (n, nodes.shape[1], base.shape[1])), nodes], axis=-1
    )
    mean = np.asarray(candidate.simulator.expected(theta.reshape(n * nodes.shape[1], -1)))
    mean = mean.reshape(n, nodes.shape[1], -1) * sources.scale[:, None, None]
    return np.asarray((mean - fit.expected[:, None]) / candidate.entry.step)


def observed_nodes(candidate: Candidate, sources: Sources) -> Array:
    """Scanned values ``(source, node, parameter)`` as each source shows them.

    Of one source they are those of its band, whatever its redshift; of many their energies are at rest, and
    each source shows them redshifted.
    """
    nodes = np.repeat(candidate.entry.nodes[None], len(sources), axis=0)
    if len(sources) == 1:
        return nodes
    for i, name in enumerate(candidate.entry.parameters):
        if name in candidate.entry.energies:
            nodes[:, :, i] /= 1.0 + sources.redshift[:, None]
    return nodes
