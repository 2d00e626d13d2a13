"""Shared amplitudes fitted together with every source: to the top of the likelihood, by its own curvature."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import norm

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.discovery.blocks import Answer, Each, by_response, here
from gaugeblock.discovery.fitting import Fit
from gaugeblock.discovery.name.shared import Shared, Term, fit_held, share
from gaugeblock.discovery.name.shared_score import SharedScores, join, shared_scores
from gaugeblock.discovery.name.shared_starts import spread_starts
from gaugeblock.discovery.name.stacked import prior_precision, solved, stack
from gaugeblock.discovery.sources import Sources

ITERATIONS = 8
SLACK = 0.05
"""Log likelihood that fits, which end within their tolerance, may lose at a step that is no worse."""

TRIES = 4
"""Places over the prior from which sources are fitted anew when the amplitude has settled."""

CLOSE = 0.05
"""The fit has converged when no amplitude moves by more than this share of its standard error."""

PARABOLAS = 4
"""Of the profile, each through three points of it."""

NEAR = 0.25
"""A parabola whose top is within this share of an error needs no other."""

TRUSTED = 9.0
"""Times as curved as the information says, or as flat: beyond it the profile is rough at an error's scale."""


@dataclass(frozen=True, eq=False)
class SharedAmplitude:
    """A shared amplitude with its errors, and what was fitted beside it.

    Attributes
    ----------
    value, neutral : float
        Absolute amplitude, and where it would do nothing.
    standard_error : float
        From the curvature of the profile likelihood, shared nuisances with their priors fitted beside;
        where it has none that can be trusted, from the information.
    sandwich_error : float
        From the scatter between sources.
    phi : ndarray, shape (term,)
        All shared amplitudes, this one first.
    gain : float
        Log likelihood, with priors, won over the fit with all shared amplitudes at neutral.
    fits : tuple of Fit
        Fits at phi, one a group.
    converged : bool
    at_edge : bool
        Whether the amplitude stopped at the border of its prior.
    """

    value: float
    neutral: float
    standard_error: float
    sandwich_error: float
    phi: Array
    gain: float
    fits: tuple[Fit, ...]
    converged: bool
    at_edge: bool

    @property
    def z(self) -> float:
        """Departure from neutral in standard errors."""
        return (self.value - self.neutral) / self.standard_error

    def interval(self, level: float = 0.9) -> tuple[float, float]:
        """Central interval, by the larger of the two errors."""
        reach = float(norm.ppf(0.5 + level / 2.0)) * max(self.standard_error, self.sandwich_error)
        return self.value - reach, self.value + reach


def profile_shared(
    groups: Sequence[Sources],
    entry: Term,
    nuisances: Sequence[Term] = (),
    *,
    start: ArrayLike | None = None,
    fits: Sequence[Fit] | None = None,
    iterations: int = ITERATIONS,
    each: Each = here,
) -> SharedAmplitude:
    """Fit one shared effect beside shared nuisances: Gauss-Newton on these, every source fitted at each step.

    The sources' own parameters are fitted anew at each value of the shared ones, so that the step is that
    of the profile likelihood, to the order of the templates' change over their finite steps. What that
    leaves, parabolas through the likelihood itself take away.

    Parameters
    ----------
    groups : sequence of Sources
        Blocks of sources of a response.
    entry : Term
        The effect; with a finite sd its prior holds it back too.
    start : array, shape (1 + nuisance,), optional
        Shared amplitudes to start from; without it their neutral values.
    fits : sequence of Fit, optional
        Fits of the groups without any shared effect, to start from.

    Raises
    ------
    InputError
        If the data know nothing of the effect beside its nuisances.

    References
    ----------
    Murphy & van der Vaart (2000), J. Am. Stat. Assoc. 95, 449: the profile likelihood as a likelihood.
    """
    models = by_response(groups, partial(share, terms=(entry, *nuisances)))
    return profile_models(models, groups, start=start, fits=fits, iterations=iterations, each=each)


def profile_models(
    models: Sequence[Shared],
    groups: Sequence[Sources],
    *,
    start: ArrayLike | None = None,
    fits: Sequence[Fit] | None = None,
    iterations: int = ITERATIONS,
    each: Each = here,
) -> SharedAmplitude:
    """`profile_shared` for simulators that have the shared effects already: the first term is the effect."""
    first = models[0]
    phi = first.neutral if start is None else np.array(start, dtype=float)
    # Shared amplitudes at neutral change nothing: fits without them are the fits there.
    bare = list(fits) if fits is not None else refitted(models, groups, first.neutral, each=each)
    found = refitted(models, groups, phi, bare, each=each)
    objective = _objective(found, phi, first)
    converged, shorter, checked = False, 1.0, False
    for number in range(iterations + 1):
        scores = shared_parts(models, groups, found, phi, each=each)
        if not stack(_effect_first(scores), first.sd[1:]).information[0] + first.sd[0] ** -2.0 > 0:
            raise InputError(
                f"discover: the catalogue knows nothing of {first.terms[0].entry.name} beside its nuisances; "
                "give fewer nuisances, or priors for them"
            )
        step, error = newton(scores, first.sd, phi - first.neutral)
        # Near the border a step may leave the prior; the fit then stays there.
        moved = np.clip(phi + shorter * step, *_inside(first))
        converged = bool((np.abs(moved - phi) < CLOSE * error).all())
        if converged and not checked and number < iterations:
            # Peaks of a source may trade places on the way: look from the fit without effect and from afar.
            again = refitted(models, groups, phi, found, bare, tries=TRIES, each=each)
            gained = objective - _objective(again, phi, first)
            checked, found, objective = True, again, objective - gained
            if gained > SLACK:
                continue
        if converged or number == iterations:
            break
        tried = refitted(models, groups, moved, found, each=each)
        reached = _objective(tried, moved, first)
        # Templates are of finite size: past the peak a step may lead back and forth unless it is halved.
        if reached < objective + SLACK:
            phi, found, objective = moved, tried, reached
        else:
            shorter *= 0.5
    beside = stack(_effect_first(scores), first.sd[1:])
    information, share_of_error = float(beside.information[0]) + first.sd[0] ** -2.0, 1.0
    if converged:
        known = _covariance(scores, first.sd)
        error = known[0] / np.sqrt(known[0, 0])
        phi, found, objective, share_of_error = _top(models, groups, phi, found, objective, error, each)
    gain = _objective(bare, first.neutral, first) - objective
    return SharedAmplitude(
        float(phi[0]),
        float(first.neutral[0]),
        float(share_of_error / np.sqrt(information)),
        float(share_of_error * beside.sandwich_error[0] * beside.information[0] / information),
        phi,
        gain,
        tuple(found),
        converged,
        _stopped(float(phi[0]), first),
    )


def _top(
    models: Sequence[Shared],
    groups: Sequence[Sources],
    phi: Array,
    found: list[Fit],
    objective: float,
    error: Array,
    each: Each,
) -> tuple[Array, list[Fit], float, float]:
    """The top of the profile near phi: amplitudes, fits, objective, and by how much to multiply the error.

    `error` ``(term,)`` is one of the effect, the others where it leads them. Templates are differences over
    finite steps, and their score may vanish an error and more off the top.
    """
    first, share_of_error = models[0], 1.0
    for _ in range(PARABOLAS):
        ends = [np.clip(phi + side * error, *_inside(first)) for side in (-1.0, 1.0)]
        left, right = (abs(float(end[0] - phi[0]) / error[0]) for end in ends)
        if min(left, right) < NEAR:  # at the border of the prior
            break
        sides = [refitted(models, groups, end, found, each=each) for end in ends]
        known = [(_objective(fits, end, first), end, fits) for fits, end in zip(sides, ends, strict=True)]
        down, up = ((one[0] - objective) / reach for one, reach in zip(known, (left, right), strict=True))
        curvature = 2.0 * (down + up) / (left + right)
        away = (0.5 * curvature * right - up) / curvature if curvature > 0 else 0.0
        step = float(np.clip(away, -2.0 * left, 2.0 * right))
        moved = np.clip(phi + step * error, *_inside(first))
        tried = refitted(models, groups, moved, found, each=each)
        known += [(_objective(tried, moved, first), moved, tried), (objective, phi, found)]
        objective, phi, found = min(known, key=lambda one: one[0])
        if 1 / TRUSTED < curvature < TRUSTED:
            share_of_error = float(curvature**-0.5)
        if curvature > 0 and abs(step) < NEAR * share_of_error:
            break
    return phi, found, objective, share_of_error


def refitted(
    models: Sequence[Shared],
    groups: Sequence[Sources],
    phi: Array,
    *starts: Sequence[Fit],
    tries: int = 0,
    each: Each = here,
) -> list[Fit]:
    """Fits at phi, from fits nearby, and from `tries` places over the prior; without either from nowhere."""
    begin: Sequence[Array | None] = [None] * len(groups)
    if starts:
        begin = [np.stack([fit.theta for fit in near], axis=1) for near in zip(*starts, strict=True)]
    answers = each(partial(_refit, phi=phi, tries=tries), models, groups, begin)
    return [Fit(**answer) for answer in answers]


def _refit(model: Shared, sources: Sources, begin: Array | None, *, phi: Array, tries: int) -> Answer:
    if tries and begin is not None:
        far = spread_starts(model.held(phi), sources.counts, sources.scale, tries=tries)
        begin = np.concatenate([begin, far], axis=1)
    return vars(fit_held(model, sources, phi, begin))


def shared_parts(
    models: Sequence[Shared],
    groups: Sequence[Sources],
    fits: Sequence[Fit],
    phi: Array,
    *,
    each: Each = here,
) -> SharedScores:
    """Scores of all shared amplitudes around phi, as nuisances of no template."""
    return join([SharedScores.of(one) for one in each(partial(_parts, phi=phi), models, groups, fits)])


def _parts(model: Shared, sources: Sources, fit: Fit, *, phi: Array) -> Answer:
    values = model.templates(fit.theta, phi, sources.scale, sources.redshift)
    return vars(shared_scores(sources.counts, fit, values[:, :0], values))


def newton(scores: SharedScores, sd: Array, away: Array) -> tuple[Array, Array]:
    """Step of the shared amplitudes, and their standard errors, ``(term,)``."""
    covariance = _covariance(scores, sd)
    step = (scores.nuisance_score.sum(axis=0) - away / sd**2) @ covariance
    variance = np.diag(covariance)
    with np.errstate(divide="ignore"):
        return step, np.sqrt(np.where(variance > 0, variance, np.inf))


def _covariance(scores: SharedScores, sd: Array) -> Array:
    """Of the shared amplitudes, ``(term, term)``, with their priors."""
    matrix = scores.nuisance_information.sum(axis=0) + prior_precision(scores, sd)
    return solved(matrix, np.eye(len(sd)))


def _effect_first(scores: SharedScores) -> SharedScores:
    """The first amplitude as a template, the others as nuisances."""
    information = scores.nuisance_information
    return SharedScores(
        scores.nuisance_score[:, :1],
        information[:, 0, :1],
        information[:, 0, :1],
        scores.nuisance_score[:, 1:],
        information[:, :1, 1:],
        information[:, 1:, 1:],
    )


def _inside(model: Shared) -> tuple[Array, Array]:
    """Amplitudes whose templates still have both sides."""
    low, high = model.bounds.T
    edge = np.minimum(np.abs(model.step), 0.1 * (high - low)) * 0.5
    return np.minimum(low + edge, model.neutral), np.maximum(high - edge, model.neutral)


def _stopped(value: float, model: Shared) -> bool:
    """Whether the first amplitude went as far as its prior lets it go; neutral is no end."""
    low, high = (float(end[0]) for end in _inside(model))
    tiny = 1e-9 * (high - low)
    return value != float(model.neutral[0]) and not low + tiny < value < high - tiny


def _objective(fits: Sequence[Fit], phi: Array, model: Shared) -> float:
    """Negative log likelihood with priors."""
    away = (phi - model.neutral) / model.sd
    return float(sum(fit.objective.sum() for fit in fits) + 0.5 * (away**2).sum())
