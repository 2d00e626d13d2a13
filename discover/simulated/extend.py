"""Fit the model with an effect, and compare fitted models with each other by learned log ratios."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.engine import Extension, Look
from gaugeblock.discovery.library import Candidate
from gaugeblock.discovery.simulated.learning import Base, learn, simulate_base
from gaugeblock.discovery.simulated.moment_fit import DISTINCT, SimulatedFit, fit_simulated, misfit
from gaugeblock.discovery.simulated.observed import Observed
from gaugeblock.discovery.simulated.score_tests import LearnedTests

SHARE = 0.04
"""Steps of scanned parameters, as a share of their prior's width."""


UNLIKE = 0.5
"""Correlation below which two scores of an effect are two peaks ..."""

NEARLY = 0.8
"""... and share of the larger one from which on the smaller one counts."""


@dataclass(frozen=True, eq=False)
class LogRatio:
    """Log ratio of two models' densities of a data set, learned: ``weights . (features - middle)``.

    Exact to second order in the difference of the two; its sign tells them apart however large that is.
    Sought in the span of the learned scores of all effects and of the population.
    """

    weights: Array
    middle: Array

    @classmethod
    def learned(cls, scores: Array, numerator: Base, denominator: Base) -> LogRatio:
        """From simulations of both models with the same random numbers; `scores` ``(score, feature)``."""
        covariance = 0.5 * (numerator.covariance(scores) + denominator.covariance(scores))
        scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        inverse = np.linalg.pinv(covariance / np.outer(scale, scale), rcond=DISTINCT, hermitian=True)
        span = scores / scale[:, None]
        weights = span.T @ (inverse @ (span @ (numerator.mean - denominator.mean)))
        return cls(weights, 0.5 * (numerator.mean + denominator.mean))

    def __call__(self, rows: Array) -> Array:
        """Log ratio of each data set, features ``(n, feature)``."""
        return np.asarray((rows - self.middle) @ self.weights)


@dataclass(frozen=True, eq=False)
class Extended(Extension):
    """A candidate fitted with everything else; its gain is half of what the misfit of the scores fell by."""

    candidate: Candidate
    fit: SimulatedFit

    @property
    def values(self) -> dict[str, float]:
        """The effect's fitted parameters."""
        return self.candidate.values(self.fit.state)

    @property
    def significance(self) -> float:
        """Standard errors of the amplitude from neutral."""
        at, entry = self.candidate.amplitude_index, self.candidate.entry
        return float(abs(self.fit.state[at] - entry.neutral) / max(self.fit.error[at], 1e-300))


def extended_by(
    candidate: Candidate,
    path: tuple[str, ...],
    seen: Look,
    before: SimulatedFit,
    observed: Observed,
) -> Extended:
    """Fit one candidate, starting where its score peaks and with the amplitude that one step promises.

    From a second peak too, where that is nearly as high: of two local fits the data choose.
    """
    found: LearnedTests = seen.state
    starts = _peaks(found, seen.best(candidate.key), before)
    fits = [_fitted_from(candidate, found, start, before, observed) for start in starts]
    fitted = min(fits, key=lambda one: misfit(one, observed, found.span))
    return _compared(candidate, path, fitted, before, found, observed)


def _fitted_from(
    candidate: Candidate, found: LearnedTests, start: int, before: SimulatedFit, observed: Observed
) -> SimulatedFit:
    entry = candidate.entry
    low, high = entry.support
    departure = found.amplitude[start]
    # No farther than a third of the prior, and never neutral: there the other parameters mean nothing.
    departure = np.sign(departure or entry.step) * np.clip(
        abs(departure), 0.1 * abs(entry.step), (high - low) / 3.0
    )
    steps = np.array([SHARE * np.ptp(marginal.support) for marginal in entry.parameters.values()])
    steps[candidate.amplitude_index] = found.scores.step[start]
    values = _between(candidate, found, start)
    values[candidate.amplitude_index] = np.clip(entry.neutral + departure, low, high)
    model = before.model.extended(candidate.simulator, steps)
    state = np.concatenate([before.state, values])
    state[: model.hyper] = model.population.widened(state[: model.hyper])
    lesson = learn(model, observed, simulate_base(model, observed, state), state)
    return fit_simulated(model, observed, start=state, lesson=lesson, span=found.span)


def _peaks(found: LearnedTests, best: int, before: SimulatedFit) -> list[int]:
    """The best score of an effect, and the best of those unlike it if that is nearly as large."""
    mine = np.flatnonzero(found.scores.owner == found.scores.owner[best])
    weights = before.lesson.orthogonal(found.scores.learned[mine].mean(axis=1))
    covariance = before.base.covariance(weights)
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    place = int(np.flatnonzero(mine == best)[0])
    unlike = mine[np.abs(covariance[place] / (size * size[place])) < UNLIKE]
    z = np.abs(found.z)
    if not len(unlike):
        return [best]
    second = int(unlike[np.argmax(z[unlike])])
    return [best, second] if z[second] > NEARLY * z[best] else [best]


def _between(candidate: Candidate, found: LearnedTests, best: int) -> Array:
    """Values ``(k,)`` where an effect's z peaks: by a parabola through scanned values and their neighbours.

    A fit that begins at a scanned value may find nothing on either side: halfway between two weeks an effect
    is shared by both, and at one of them its answer to the week is as large one way as the other.
    """
    mine = np.flatnonzero(found.scores.owner == found.scores.owner[best])
    nodes, z = np.array([found.scores.node[i] for i in mine]), found.z[mine] * np.sign(found.z[best])
    at = int(np.flatnonzero(mine == best)[0])
    values: Array = nodes[at].copy()
    for column, name in enumerate(candidate.entry.parameters):
        if name not in candidate.entry.scanned:
            continue
        others = np.delete(nodes, column, axis=1)
        line = np.flatnonzero((others == others[at]).all(axis=1))
        line = line[np.argsort(nodes[line, column])]
        place = int(np.flatnonzero(line == at)[0])
        if 0 < place < len(line) - 1:
            below, here, above = z[line[place - 1 : place + 2]]
            bend = max(2.0 * here - below - above, 1e-9)
            shift = np.clip(0.5 * (above - below) / bend, -0.5, 0.5)
            beside = line[place + (1 if shift > 0 else -1)]
            values[column] += abs(shift) * (nodes[beside, column] - values[column])
    return values


def _compared(
    candidate: Candidate,
    path: tuple[str, ...],
    fitted: SimulatedFit,
    before: SimulatedFit,
    found: LearnedTests,
    observed: Observed,
) -> Extended:
    gain = 0.5 * (misfit(before, observed, found.span) - misfit(fitted, observed, found.span))
    return Extended(path, gain, len(candidate.entry.parameters), candidate, fitted)


def refine(one: Extended, found: LearnedTests, before: SimulatedFit, observed: Observed) -> Extended:
    """Learn all scores anew where the fit ended, and fit again: for amplitude and interval."""
    fitted = fit_simulated(one.fit.model, observed, start=one.fit.state, span=found.span)
    return _compared(one.candidate, one.path, fitted, before, found, observed)


def departure_from(rival: Extended, best: Extended, span: Array, observed: Observed) -> float:
    """z of the data's departure from a fitted rival towards the best, were the rival true.

    The log ratio of both, orthogonal to all that the rival has free: Cox's test with simulated moments.

    References
    ----------
    Cox (1961), Proc. 4th Berkeley Symp. 1, 105.
    """
    base = rival.fit.base
    weights = rival.fit.lesson.orthogonal(LogRatio.learned(span, best.fit.base, base).weights)
    variance = float(base.variance(weights)) * observed.inflation / len(observed)
    return float(weights @ (observed.mean - base.mean) / np.sqrt(max(variance, 1e-300)))


def refit(like: SimulatedFit, observed: Observed, *, span: Array | None = None) -> SimulatedFit:
    """Fit other data of the same kind with the scores that were learned before."""
    return fit_simulated(like.model, observed, start=like.state, lesson=like.lesson, span=span)
