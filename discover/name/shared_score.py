"""Scores of shared effects, source by source: all that a catalogue's tests need, in a few numbers each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.discovery.fitting import Fit
from gaugeblock.discovery.name.score import projection

SEEN = 1e-9
"""Share of a template's information that rounding may leave where nuisances take all of it."""


@dataclass(frozen=True, eq=False)
class SharedScores:
    """Sufficient statistics of templates and shared nuisances, each source's own parameters projected out.

    Catalogues are sums over sources, so that one set of fits serves any number of resampled catalogues.

    Attributes
    ----------
    score, information, total : ndarray, shape (source, template)
        ``sum d_perp (x / mu - 1)``, ``sum d_perp d / mu``, and ``sum d^2 / mu``, which is the information if
        the source's own parameters were known.
    nuisance_score : ndarray, shape (source, nuisance)
    cross : ndarray, shape (source, template, nuisance)
        Projected products of templates and nuisances.
    nuisance_information : ndarray, shape (source, nuisance, nuisance)
    """

    score: Array
    information: Array
    total: Array
    nuisance_score: Array
    cross: Array
    nuisance_information: Array

    @classmethod
    def of(cls, answer: Mapping[str, Any]) -> SharedScores:
        """From arrays by name, whatever else is among them."""
        return cls(*(answer[field.name] for field in fields(cls)))

    def __len__(self) -> int:
        return len(self.score)

    def select(self, rows: Any) -> SharedScores:
        """Some of the sources, by index (which may repeat) or mask."""
        return SharedScores(*(getattr(self, field.name)[rows] for field in fields(self)))

    def with_nuisances(self, columns: Any) -> SharedScores:
        """Some of the nuisances, by index or mask."""
        return SharedScores(
            self.score,
            self.information,
            self.total,
            self.nuisance_score[:, columns],
            self.cross[..., columns],
            self.nuisance_information[:, columns][..., columns],
        )

    def with_templates(self, columns: Any) -> SharedScores:
        """Some of the templates, by index or mask."""
        return SharedScores(
            self.score[:, columns],
            self.information[:, columns],
            self.total[:, columns],
            self.nuisance_score,
            self.cross[:, columns],
            self.nuisance_information,
        )


def join(parts: Sequence[SharedScores]) -> SharedScores:
    """The sources of several parts, one after the other: of several responses, or of blocks."""
    if not parts:
        raise InputError("discover: a catalogue needs at least one source")
    names = [field.name for field in fields(SharedScores)]
    return SharedScores(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def shared_scores(counts: Any, fit: Fit, values: Array, nuisances: Array | None = None) -> SharedScores:
    """Scores of templates ``(source, template, channel)`` beside shared nuisances of the same shape.

    Neyman's orthogonal scores: errors of the sources' fits matter in second order only. `counts` is
    ``(source, channel)``; templates are changes of the expected counts by unit of amplitude.
    """
    project = projection(fit)
    n, k = values.shape[:2]
    beside = np.zeros((n, 0, values.shape[2])) if nuisances is None else nuisances
    residual = (np.asarray(counts, dtype=float) - fit.expected) / project.root_mean
    whitened = np.concatenate([values, beside], axis=1) / project.root_mean[:, None]
    projected = project(np.concatenate([values, beside], axis=1))
    score = np.einsum("ntc,nc->nt", projected, residual)
    total = np.einsum("ntc,ntc->nt", whitened[:, :k], whitened[:, :k])
    information = np.einsum("ntc,ntc->nt", projected[:, :k], whitened[:, :k])
    # Of a template inside the span of a source's own parameters rounding errors are left: nothing.
    seen = information > SEEN * total
    return SharedScores(
        np.where(seen, score[:, :k], 0.0),
        np.where(seen, information, 0.0),
        total,
        score[:, k:],
        np.where(seen[..., None], np.matmul(projected[:, :k], whitened[:, k:].swapaxes(1, 2)), 0.0),
        np.matmul(projected[:, k:], whitened[:, k:].swapaxes(1, 2)),
    )
