"""Finished runs of nested samplers as plain arrays: each point's log likelihood and contour of birth.

That is all that the errors of an evidence need: `gaugeblock.validate.evidence.thread_bootstrap` and
`insertion_order_test` take what these return. Neither library is imported; their objects are only read.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.errors import InputError


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
