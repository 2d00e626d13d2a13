"""A catalogue's search as plain data and as arrays."""

from __future__ import annotations

from typing import Any

import numpy as np

from gaugeblock.discovery.discovery import Discovery
from gaugeblock.discovery.locate.frames import Frames, compare_frames
from gaugeblock.discovery.locate.quantiles import cumulative_counts
from gaugeblock.discovery.locate.stacking import stack_excess, stacking_bins
from gaugeblock.discovery.locate.windows import scan_windows
from gaugeblock.discovery.many import CatalogueSearch
from gaugeblock.discovery.record.catalogue_summary import catalogue_summary
from gaugeblock.discovery.record.catalogue_tree import Located, catalogue_tree
from gaugeblock.discovery.search import source_segments
from gaugeblock.simulators.segments import segments


def discovery_of(found: CatalogueSearch, *, rng: np.random.Generator, replicates: int) -> Discovery:
    """Summary and arrays of a catalogue's search."""
    frames = _frames(found, rng, replicates)
    located = locate(found, rng=rng.spawn(1)[0], replicates=replicates)
    return Discovery(catalogue_summary(found, frames, located), catalogue_tree(found, frames, located))


def locate(found: CatalogueSearch, *, rng: np.random.Generator, replicates: int) -> Located:
    """Windows and cumulative counts of the first response's sources, added up channel by channel."""
    sources, fitted = found.groups[0], found.fits[0]
    parts = segments(sources.simulator, sources.counts.shape[1])
    streams = rng.spawn(2)
    told: dict[str, Any] = {
        "segments": source_segments(sources),
        "replicates": replicates,
        "prior_precision": fitted.precision,
    }
    measured = (sources.counts, fitted.expected, fitted.jacobian)
    edges = np.concatenate([part.edges for part in parts])
    return Located(
        scan_windows(*measured, edges, rng=streams[0], **told),
        cumulative_counts(*measured, rng=streams[1], **told),
    )


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
