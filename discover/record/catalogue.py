"""A catalogue's search as plain data and as arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from gaugeblock.discover.discovery import Discovery
from gaugeblock.discover.locate.frames import Frames, compare_frames
from gaugeblock.discover.locate.stacking import stack_excess, stacking_bins
from gaugeblock.discover.many import CatalogueSearch
from gaugeblock.discover.record.catalogue_summary import catalogue_summary
from gaugeblock.discover.record.catalogue_tree import catalogue_tree
from gaugeblock.simulators.segments import segments


def discovery_of(found: CatalogueSearch, *, rng: np.random.Generator, replicates: int) -> Discovery:
    """Summary and arrays of a catalogue's search."""
    frames = _frames(found, rng, replicates)
    return Discovery(catalogue_summary(found, frames), catalogue_tree(found, frames))


def _frames(found: CatalogueSearch, rng: np.random.Generator, replicates: int) -> Frames | None:
    """Residuals in the detector's and in the sources' frame; None where channels have no energies."""
    parts = [segments(group.simulator, group.counts.shape[1]) for group in found.groups]
    if any(part.unit != "keV" for several in parts for part in several):
        return None
    edges = [np.concatenate([part.edges for part in several]) for several in parts]
    redshift = np.concatenate([group.redshift for group in found.groups])
    bins = stacking_bins(edges[0], redshift)
    stacked: Any = None
    for group, fitted, several, sides in zip(found.groups, found.fits, parts, edges, strict=True):
        kept = np.concatenate([np.full(part.stop - part.start, part.role == "source") for part in several])
        one = stack_excess(
            group.counts,
            fitted.expected,
            fitted.jacobian,
            sides,
            group.redshift,
            bins=bins,
            channels=kept,
            prior_precision=fitted.precision,
        )
        stacked = one if stacked is None else stacked + one
    return compare_frames(stacked, rng=rng, replicates=replicates)
