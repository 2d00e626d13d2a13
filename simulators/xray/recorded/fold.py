"""From photon flux to counts per channel through operations on the recorded energies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray.effects.assembly import Bound
from gaugeblock.simulators.xray.gain import Gain, crossed
from gaugeblock.simulators.xray.kept import kept
from gaugeblock.simulators.xray.rate import Folding
from gaugeblock.simulators.xray.recorded.background import Background, counted
from gaugeblock.simulators.xray.recorded.broadening import Broadening
from gaugeblock.simulators.xray.recorded.layout import layout, near, per_second
from gaugeblock.simulators.xray.response import Response, grown
from gaugeblock.simulators.xray.sparse import response_product, sums


def recorded_folding(response: Response, recorded: Sequence[Bound], prior: Prior) -> Folding:
    """Folding with at least one operation.

    Only detector channels from which the operations can bring counts into the band are evaluated. Fixed
    affine operations are worked into a matrix, and cost nothing per spectrum.
    """
    import jax
    import jax.numpy as jnp

    names = prior.names
    if all(isinstance(bound.what, Background) for bound in recorded):
        return _background_folding(response, recorded, names)
    places = layout(response)
    ends = [(float(places.runs.min()), float(places.runs.max()))]
    for bound in reversed(recorded):
        ends.append(bound.what.reach(*ends[-1], bound.ranges(prior)))
    # What one operation brings into the band's last channels has to be there for the next.
    low, high = zip(*ends, strict=True)
    rows = near(places, min(low), max(high))
    if response.shared:
        rows = grown(rows, 0, len(places.order))
    asked = any(not bound.what.affine for bound in recorded)
    columns, live = _columns(response, rows.start, rows.stop, asked)
    reads = tuple(s for bound in recorded for s in bound.sources.values() if isinstance(s, str))
    if len(recorded) == 1 and isinstance(recorded[0].what, Broadening) and recorded[0].free:
        edges, members = places.edges[rows.start : rows.stop + 1], places.members[:, rows].toarray()
        broad, matrix = recorded[0].what.alone(edges, np.asarray(columns)[:-1], members)
        return Folding(
            lambda flux, theta: broad(flux, recorded[0].values(theta, names)),
            live,
            lambda theta: (matrix(recorded[0].values(theta, names)), jnp.zeros(len(members))),
            reads,
        )
    group = _grouped(response, recorded, places, rows, names)

    def transfer(theta: Any) -> tuple[Any, Any]:
        # The compiler would spend minutes on what it can fold of constants this large. What comes out where
        # nothing goes in is added whatever the flux.
        given = jnp.pad(jax.lax.optimization_barrier(columns), ((0, 0), (0, 1)))
        made = jax.vmap(lambda column: group(column, theta), in_axes=1, out_axes=1)(given)
        return made[:, :-1] - made[:, -1:], made[:, -1]

    if not asked:
        if not reads:
            # Compiled as one: operation by operation it would be a hundred compilations.
            matrix, added = jax.jit(transfer)(None)
            return Folding(lambda flux, _: matrix @ flux + added, live)
        return Folding(lambda flux, theta: group(columns @ flux, theta), live, transfer, reads)
    return Folding(lambda flux, theta: group(columns @ flux, theta), live)


def _background_folding(response: Response, recorded: Sequence[Bound], names: Sequence[str]) -> Folding:
    """Background alone moves no counts between channels: they are grouped as ever."""
    transfer, live = response_product(response)
    used = np.asarray(response.grouping.sum(axis=0)).ravel() > 0
    grouped = sums(response.grouping[:, used])
    low, high = response.fine_channels[used].T

    def fold(flux: Any, theta: Any) -> Any:
        added = sum(counted(low, high, **bound.values(theta, names)) for bound in recorded)
        return transfer(flux) + grouped(added)

    return Folding(fold, live)


@kept
def _columns(response: Response, start: int, stop: int, others: bool) -> tuple[Any, NDArray[np.bool_]]:
    """Counts per second for unit photon flux ``(detector channel, bin)``, and which input bins they are of.

    The last row is of all channels but those from `start` to `stop` in order of energy, 0 unless `others` are
    asked for.
    """
    import jax.numpy as jnp

    order = layout(response).order
    dense = per_second(response, order[start:stop])
    rest = np.zeros(len(response.area))
    if others:
        beyond = np.delete(np.arange(response.redistribution.shape[0]), order[start:stop])
        rest = np.asarray(response.redistribution[beyond].sum(axis=0)).ravel() * response.area
    live = response.evaluated(np.asarray(dense.any(axis=0) | (rest > 0)))
    return jnp.asarray(np.concatenate([dense[:, live], rest[None, live]])), live


@kept
def _membership(
    response: Response, start: int, stop: int
) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    """Sums per group of what is in its channels, of those from `start` to `stop`, and in its runs."""
    places = layout(response)
    return sums(places.members[:, start:stop]), sums(places.groups)


def _grouped(
    response: Response, recorded: Sequence[Bound], places: Any, rows: slice, names: Sequence[str]
) -> Callable[[Any, Any], Any]:
    """Pure function ``(counts per second in the channels, then in all others; theta)`` to those per group."""
    import jax.numpy as jnp

    edges = places.edges[rows.start : rows.stop + 1]
    members, groups = _membership(response, rows.start, rows.stop)
    runs = places.runs
    prepared = [bound.what.prepare(edges, response) for bound in recorded]

    def group(counts: Any, theta: Any) -> Any:
        counts, others = counts[:-1], counts[-1]
        gains: list[tuple[Gain, Any]] = []
        for bound, change in zip(recorded, prepared, strict=True):
            values = bound.values(theta, names)
            if isinstance(bound.what, Gain):
                # One after the other they are one gain: counts are interpolated once.
                gains.append((bound.what, values))
                continue
            if gains:
                counts = counts + jnp.diff(crossed(counts, edges, edges, gains))
                gains = []
            counts = change(counts, values, others)
        if not gains:
            return members(counts)
        across = crossed(counts, edges, runs, gains)
        return members(counts) + groups(across[:, 1] - across[:, 0])

    return group
