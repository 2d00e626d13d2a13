"""Models that all sources of a catalogue share, judged on sources that did not train them.

Named effects, a smooth correction of the channels, random shapes: what they share is learned from some
sources and held while others are fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.fitting import Fit, fit, select
from gaugeblock.discovery.held_out import BEFORE, RANDOM, UNNAMED, HeldOut, deviance
from gaugeblock.discovery.name.score import projection
from gaugeblock.discovery.name.shared import Shared, Term, fit_held, share
from gaugeblock.discovery.name.shared_profile import newton, shared_parts
from gaugeblock.discovery.name.shared_score import join
from gaugeblock.discovery.name.unnamed import curves
from gaugeblock.discovery.reshaped import Adapted
from gaugeblock.discovery.sources import Sources

SIZE = 0.1
"""Prior standard deviation of the log of a shared smooth correction, at each of its curves."""


Rows = Sequence[NDArray[np.bool_]]
"""Which sources of every group."""

Judge = Callable[[Rows], Sequence[Fit]]
"""Fits of held-out sources, one a group, under a model whose shared part is known already."""


@dataclass(frozen=True, eq=False)
class SharedModel:
    """A model of a catalogue: `train` learns what is shared from some sources and returns a fitter."""

    train: Callable[[Rows], Judge]
    kind: str


def source_scores(
    models: Mapping[str, SharedModel],
    groups: Sequence[Sources],
    fits: Sequence[Fit],
    *,
    rng: np.random.Generator,
    folds: int,
) -> HeldOut:
    """Train models on all folds but one and score them on that one; every source is held out once.

    A source's own parameters are fitted to the source itself under every model alike: what differs is only
    what the other sources taught. The log score is the log likelihood of a source, its own parameters fitted,
    over the model before; errors are by the sources' scatter.
    """
    sizes = [len(group) for group in groups]
    fold = rng.permutation(np.arange(sum(sizes)) % folds)
    parts = np.split(fold, np.cumsum(sizes)[:-1])
    counts = len(models)
    gains = [np.zeros((counts, size)) for size in sizes]
    gaps = [
        np.repeat(deviance(group.counts, before.expected)[None], counts, axis=0)
        for group, before in zip(groups, fits, strict=True)
    ]
    for number in range(folds):
        held = [part == number for part in parts]
        for m, model in enumerate(models.values()):
            if model.kind == BEFORE:
                continue
            found = model.train([~rows for rows in held])(held)
            for i, (rows, judged) in enumerate(zip(held, found, strict=True)):
                gains[i][m, rows] = fits[i].objective[rows] - judged.objective
                gaps[i][m, rows] = deviance(groups[i].counts[rows], judged.expected)
    gain = np.concatenate(gains, axis=1)
    apart = gain[:, None] - gain[None]
    error = apart.std(axis=2, ddof=1) * np.sqrt(gain.shape[1])
    kinds = tuple(model.kind for model in models.values())
    return HeldOut(tuple(models), kinds, gain, error, np.concatenate(gaps, axis=1))


def before_model(fits: Sequence[Fit]) -> SharedModel:
    """The model as it was given."""
    return SharedModel(lambda _: lambda held: [select(f, r) for f, r in zip(fits, held, strict=True)], BEFORE)


def effect_model(
    groups: Sequence[Sources],
    before: Sequence[Fit],
    terms: Sequence[Term],
    phi: Array,
    kind: str,
    *,
    known: tuple[Sequence[Shared], Sequence[Fit]] | None = None,
) -> SharedModel:
    """Effects with shared amplitudes, learned by one Newton step from the whole catalogue's phi.

    The step uses the training sources alone; where it starts has no say in where it ends, but for the third
    order of its length. `known` holds the simulators with these terms and the fits at phi, where there are
    any.
    """
    models, fits = known or _at(groups, before, terms, phi)
    parts = [
        shared_parts([model], [group], [found], phi)
        for model, group, found in zip(models, groups, fits, strict=True)
    ]
    first = models[0]

    def train(kept: Rows) -> Judge:
        scores = join([part.select(rows) for part, rows in zip(parts, kept, strict=True)])
        step, _ = newton(scores, first.sd, phi - first.neutral)
        low, high = first.bounds.T
        trained = np.clip(phi + step, low + 1e-3 * (high - low), high - 1e-3 * (high - low))

        def judge(held: Rows) -> list[Fit]:
            return [
                fit_held(model, group.select(rows), trained, found.theta[rows])
                for model, group, found, rows in zip(models, groups, fits, held, strict=True)
            ]

        return judge

    return SharedModel(train, kind)


def _at(
    groups: Sequence[Sources], before: Sequence[Fit], terms: Sequence[Term], phi: Array
) -> tuple[Sequence[Shared], Sequence[Fit]]:
    models = [share(group.simulator, terms) for group in groups]
    return models, [
        fit_held(model, group, phi, old.theta)
        for model, group, old in zip(models, groups, before, strict=True)
    ]


def curve_model(
    groups: Sequence[Sources], fits: Sequence[Fit], shapes: Array, size: float, kind: str
) -> SharedModel:
    """``exp(shapes @ b)`` on every source, b from one Gauss-Newton step over all training sources.

    `shapes` is ``(channel, curve)``; b has a Gaussian prior of standard deviation `size`.
    """
    statistics = [shared_statistics(group, found, shapes) for group, found in zip(groups, fits, strict=True)]

    def train(kept: Rows) -> Judge:
        score = sum(one.score[rows].sum(axis=0) for one, rows in zip(statistics, kept, strict=True))
        known = sum(one.information[rows].sum(axis=0) for one, rows in zip(statistics, kept, strict=True))
        factor = np.exp(shapes @ np.linalg.solve(known + np.eye(shapes.shape[1]) / size**2, score))

        def judge(held: Rows) -> list[Fit]:
            return [
                fit(
                    Adapted(group.simulator, factor=factor),
                    group.counts[rows],
                    scale=group.scale[rows],
                    start=found.theta[rows],
                )
                for group, found, rows in zip(groups, fits, held, strict=True)
            ]

        return judge

    return SharedModel(train, kind)


@dataclass(frozen=True, eq=False)
class CurveStatistics:
    """Scores ``(source, curve)`` and information ``(source, curve, curve)`` of shared log factors at 0."""

    score: Array
    information: Array


def shared_statistics(group: Sources, found: Fit, shapes: Array) -> CurveStatistics:
    """Each source's part, its own parameters projected out."""
    values = found.expected[:, None] * shapes.T
    project = projection(found)
    projected = project(values)
    residual = (group.counts - found.expected) / project.root_mean
    whitened = values / project.root_mean[:, None]
    return CurveStatistics(
        np.einsum("ntc,nc->nt", projected, residual), np.matmul(projected, whitened.swapaxes(1, 2))
    )


def smooth_model(groups: Sequence[Sources], fits: Sequence[Fit]) -> SharedModel | None:
    """`unnamed`: a smooth correction in channel space; None where responses differ."""
    if len(groups) != 1:
        return None
    shapes = curves(groups[0].simulator, groups[0].counts.shape[1])
    return curve_model(groups, fits, shapes, SIZE, UNNAMED) if shapes.shape[1] else None


def random_models(
    groups: Sequence[Sources], fits: Sequence[Fit], *, number: int, rng: np.random.Generator
) -> dict[str, SharedModel]:
    """Random smooth shapes in channel space, each with one free amplitude."""
    if len(groups) != 1:
        return {}
    basis = curves(groups[0].simulator, groups[0].counts.shape[1])
    if not basis.shape[1]:
        return {}
    return {
        f"random {i + 1}": curve_model(
            groups, fits, basis @ rng.normal(size=(basis.shape[1], 1)), 1.0, RANDOM
        )
        for i in range(number)
    }
