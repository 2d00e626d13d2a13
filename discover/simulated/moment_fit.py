"""Fit population and effects to the data's mean features: simulated moments, weighed by learned scores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.simulated.learning import Base, Lesson, learn, simulate_base
from gaugeblock.discovery.simulated.model import Model
from gaugeblock.discovery.simulated.observed import Observed

ROUNDS = 5
"""Times that the scores are learned anew where the last fit ended."""

STEPS = 4
CLOSE = 0.1
"""Standard errors of a step that are as good as none."""

NEAR = 3.0
"""Standard errors from where scores were learned within which they hold."""

DISTINCT = 1e-3
"""Combinations of scores that vary less than this, in units of the most varied one, are left out."""

WEAK = 2.0
"""Prior standard deviation of the hyper-parameters; at 30 data sets it weighs next to nothing."""


@dataclass(frozen=True, eq=False)
class SimulatedFit:
    """A model fitted to data: its state with covariance, simulations there, and the scores learned there.

    `converged` where the last steps were small beside the errors.
    """

    model: Model
    state: Array
    covariance: Array
    base: Base
    lesson: Lesson
    converged: bool

    @property
    def error(self) -> Array:
        """Standard error of everything in the state."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def settled(self) -> bool:
        """Whether it ended near where its scores were learned."""
        return self.converged and bool(np.all(np.abs(self.state - self.lesson.state) < NEAR * self.error))


def fit_simulated(
    model: Model,
    observed: Observed,
    *,
    start: Array,
    lesson: Lesson | None = None,
    span: Array | None = None,
) -> SimulatedFit:
    """Find the state at which the means of learned scores are nearest to those of the data.

    Consistent whatever was learned: a poor score costs precision, not truth. All simulations come from one
    seed, so that the mean is a steady function of the state.

    Parameters
    ----------
    start : array, shape (state,)
    lesson : Lesson, optional
        Learned before, at a state near by; without it scores are learned anew up to `ROUNDS` times.
    span : array, shape (score, feature), optional
        Weights of further scores whose means must agree: they keep a fit from where its own agree by chance.

    References
    ----------
    McFadden (1989), Econometrica 57, 995; Wood (2010), Nature 466, 1102.
    """
    state, found, close = np.clip(start, *model.bounds.T), lesson, False
    if lesson is None:
        state[: model.hyper] = model.population.widened(state[: model.hyper])
    base = simulate_base(model, observed, state)
    for _ in range(ROUNDS if lesson is None else 1):
        if lesson is None:
            found = learn(model, observed, base, state)
        assert found is not None
        begin = state
        state, base, last = _solve(model, observed, found, state, base, span)
        noise = state_covariance(found, base, observed, span)
        error = np.sqrt(np.maximum(np.diag(noise), 1e-300))
        close = bool(np.all(np.abs(last) < 3.0 * CLOSE * error))
        if close and np.all(np.abs(state - begin) < NEAR * error):
            break
    assert found is not None
    return SimulatedFit(model, state, state_covariance(found, base, observed, span), base, found, close)


def _solve(
    model: Model, observed: Observed, lesson: Lesson, state: Array, base: Base, span: Array | None
) -> tuple[Array, Base, Array]:
    """Gauss-Newton steps with the scores held; each is shortened until it brings the means closer.

    Where none does, what data may follow in jumps stays as it is, and the rest is tried without it.
    """
    hyper, mean, n = model.hyper, observed.mean, len(observed)
    weights, slope, metric = _system(lesson, base, span)
    weak = np.zeros(len(state))
    weak[:hyper] = 1.0 / (n * WEAK**2)
    curvature = slope.T @ metric @ slope + np.diag(weak)
    limit = np.where(np.arange(len(state)) < hyper, 1.0, np.ptp(model.bounds, axis=1) / 3.0)

    def distance(at: Base, where: Array) -> float:
        left = weights @ (mean - at.mean)
        return float(left @ metric @ left + (weak * where**2).sum())

    error = np.sqrt(np.maximum(np.diag(state_covariance(lesson, base, observed, span)), 1e-300))
    last: Array = np.zeros(len(state))
    frees = [np.full(len(state), True), *([~model.scanned] if model.scanned.any() else [])]
    for _ in range(STEPS):
        left = slope.T @ metric @ (weights @ (mean - base.mean)) - weak * state
        before, moved = distance(base, state), False
        for free in frees:
            step = np.zeros(len(state))
            step[free] = np.linalg.lstsq(curvature[np.ix_(free, free)], left[free], rcond=1e-8)[0]
            step *= min(1.0, float((limit / np.maximum(np.abs(step), 1e-300)).min()))
            for _ in range(3):
                target = np.clip(state + step, *model.bounds.T)
                there = simulate_base(model, observed, target)
                moved = distance(there, target) < before
                if moved:
                    break
                step = step / 3.0
            if moved:
                break
        if not moved:
            last = np.where(np.any(np.abs(step) > CLOSE * error), step, 0.0)
            break
        last, state, base = target - state, target, there
        if np.all(np.abs(last) < CLOSE * error):
            break
    return state, base, last


def _system(lesson: Lesson, base: Base, span: Array | None) -> tuple[Array, Array, Array]:
    """Weights ``(score, feature)``, their means' derivatives ``(score, state)``, inverse covariance."""
    weights: Array = lesson.weights
    slope: Array = lesson.response
    if span is not None:
        weights = np.concatenate([weights, span])
        slope = np.concatenate([slope, span @ lesson.slope.T])
    return weights, slope, inverse_covariance(base.covariance(weights))


def inverse_covariance(covariance: Array) -> Array:
    """Of scores ``(score, score)``; combinations that hardly vary are left out."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    inverse = np.linalg.pinv(covariance / np.outer(scale, scale), rcond=DISTINCT, hermitian=True)
    return np.asarray(inverse / np.outer(scale, scale))


def misfit(fitted: SimulatedFit, observed: Observed, span: Array) -> float:
    """How far the data are from a fitted model in its scores and those of a span ``(score, feature)``."""
    return apart(fitted.base, np.concatenate([fitted.lesson.weights, span]), observed)


def apart(base: Base, weights: Array, observed: Observed) -> float:
    """How far the data are from simulations in scores of given weights ``(score, feature)``: a chi square.

    With the simulations' own covariance: that of another model is no measure where an effect is large.

    References
    ----------
    Hansen (1982), Econometrica 50, 1029; Andrews (1999), Econometrica 67, 543.
    """
    left = weights @ (observed.mean - base.mean)
    squared = left @ inverse_covariance(base.covariance(weights)) @ left
    return float(squared) * len(observed) / observed.inflation


def state_covariance(lesson: Lesson, base: Base, observed: Observed, span: Array | None) -> Array:
    """Covariance of the fitted state, with the noise of the simulated means and of what was learned.

    The answers of the scores are known with an error, which would pass for information; two halves of the
    simulations do not share it.
    """
    _, slope, metric = _system(lesson, base, span)
    first, second = (_answers(lesson, k, span) for k in (0, 1))
    across = first.T @ metric @ second
    inverse = np.linalg.pinv(0.5 * (across + across.T), rcond=1e-8, hermitian=True)
    scatter = inverse @ (slope.T @ metric @ slope) @ inverse
    return np.asarray(scatter * observed.inflation / len(observed))


def _answers(lesson: Lesson, half: int, span: Array | None) -> Array:
    """How scores ``(score, state)`` answer, by derivatives from one half and weights from the other."""
    slope = lesson.halves[:, half].T
    own = lesson.learned[:, 1 - half] @ slope
    return own if span is None else np.concatenate([own, span @ slope])
