"""Models that all sources of a catalogue share, judged on sources that did not train them.

Named effects, a smooth correction of the channels, random shapes: what they share is learned from some
sources and held while others are fitted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.blocks import Answer, Each, by_response, here
from gaugeblock.discovery.fitting import Fit, fit, select
from gaugeblock.discovery.held_out import BEFORE, RANDOM, UNNAMED, HeldOut, deviance
from gaugeblock.discovery.name.score import projection
from gaugeblock.discovery.name.shared import Shared, Term, share
from gaugeblock.discovery.name.shared_profile import newton, refitted, shared_parts
from gaugeblock.discovery.name.unnamed import curves
from gaugeblock.discovery.reshaped import Adapted
from gaugeblock.discovery.sources import Sources

SIZE = 0.1
"""Prior standard deviation of the log of a shared smooth correction, at each of its curves."""


Rows = Sequence[NDArray[np.bool_]]
"""Which sources of every block."""

Judge = Callable[[Rows], Sequence[Fit]]
"""Fits of held-out sources, one a block, under a model whose shared part is known already."""


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
    each: Each = here,
) -> SharedModel:
    """Effects with shared amplitudes, learned by one Newton step from the whole catalogue's phi.

    The step uses the training sources alone; where it starts has no say in where it ends, but for the third
    order of its length. `known` holds the simulators with these terms and the fits at phi, where there are
    any.
    """
    if known is None:
        models: Sequence[Shared] = by_response(groups, partial(share, terms=terms))
        fits: Sequence[Fit] = refitted(models, groups, phi, before, each=each)
    else:
        models, fits = known
    parts = shared_parts(models, groups, fits, phi, each=each)
    first = models[0]

    def train(kept: Rows) -> Judge:
        step, _ = newton(parts.select(np.concatenate(kept)), first.sd, phi - first.neutral)
        low, high = first.bounds.T
        trained = np.clip(phi + step, low + 1e-3 * (high - low), high - 1e-3 * (high - low))

        def judge(held: Rows) -> list[Fit]:
            near = [select(found, rows) for found, rows in zip(fits, held, strict=True)]
            return refitted(models, _chosen(groups, held), trained, near, each=each)

        return judge

    return SharedModel(train, kind)


def _chosen(groups: Sequence[Sources], rows: Rows) -> list[Sources]:
    return [group.select(mine) for group, mine in zip(groups, rows, strict=True)]


def curve_model(
    groups: Sequence[Sources],
    fits: Sequence[Fit],
    shapes: Array,
    size: float,
    kind: str,
    *,
    each: Each = here,
) -> SharedModel:
    """``exp(shapes @ b)`` on every source, b from one Gauss-Newton step over all training sources.

    `shapes` is ``(channel, curve)``; b has a Gaussian prior of standard deviation `size`.
    """
    answers = each(partial(_statistics, shapes=shapes), groups, fits)
    statistics = [CurveStatistics(**answer) for answer in answers]

    def train(kept: Rows) -> Judge:
        score = sum(one.score[rows].sum(axis=0) for one, rows in zip(statistics, kept, strict=True))
        known = sum(one.information[rows].sum(axis=0) for one, rows in zip(statistics, kept, strict=True))
        factor = np.exp(shapes @ np.linalg.solve(known + np.eye(shapes.shape[1]) / size**2, score))

        def judge(held: Rows) -> list[Fit]:
            starts = [found.theta[rows] for found, rows in zip(fits, held, strict=True)]
            answers = each(partial(_fit_times, factor=factor), _chosen(groups, held), starts)
            return [Fit(**answer) for answer in answers]

        return judge

    return SharedModel(train, kind)


def _fit_times(sources: Sources, start: Array, *, factor: Array) -> Answer:
    model = Adapted(sources.simulator, factor=factor)
    return vars(fit(model, sources.counts, scale=sources.scale, start=start))


@dataclass(frozen=True, eq=False)
class CurveStatistics:
    """Scores ``(source, curve)`` and information ``(source, curve, curve)`` of shared log factors at 0."""

    score: Array
    information: Array


def _statistics(group: Sources, found: Fit, *, shapes: Array) -> Answer:
    """Each source's part, its own parameters projected out."""
    values = found.expected[:, None] * shapes.T
    project = projection(found)
    projected = project(values)
    residual = (group.counts - found.expected) / project.root_mean
    whitened = values / project.root_mean[:, None]
    return {
        "score": np.einsum("ntc,nc->nt", projected, residual),
        "information": np.matmul(projected, whitened.swapaxes(1, 2)),
    }


def smooth_model(groups: Sequence[Sources], fits: Sequence[Fit], *, each: Each = here) -> SharedModel | None:
    """`unnamed`: a smooth correction in channel space; None where responses differ."""
    shapes = _curves(groups)
    return None if shapes is None else curve_model(groups, fits, shapes, SIZE, UNNAMED, each=each)


def random_models(
    groups: Sequence[Sources],
    fits: Sequence[Fit],
    *,
    number: int,
    rng: np.random.Generator,
    each: Each = here,
) -> dict[str, SharedModel]:
    """Random smooth shapes in channel space, each with one free amplitude."""
    basis = _curves(groups)
    if basis is None:
        return {}
    shapes = [basis @ rng.normal(size=(basis.shape[1], 1)) for _ in range(number)]
    return {
        f"random {i + 1}": curve_model(groups, fits, shape, 1.0, RANDOM, each=each)
        for i, shape in enumerate(shapes)
    }


def _curves(groups: Sequence[Sources]) -> Array | None:
    """Smooth curves of the channels; None where there are none, or responses differ."""
    if len({id(group.simulator) for group in groups}) != 1:
        return None
    found = curves(groups[0].simulator, groups[0].counts.shape[1])
    return found if found.shape[1] else None
