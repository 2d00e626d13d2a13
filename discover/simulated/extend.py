"""Fit the model with an effect, and compare fitted models with each other by learned log ratios."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.engine import Extension, Look
from gaugeblock.discovery.library import Candidate
from gaugeblock.discovery.simulated.closing_in import close_in
from gaugeblock.discovery.simulated.learning import Base, learn, simulate_base
from gaugeblock.discovery.simulated.model import Model
from gaugeblock.discovery.simulated.moment_fit import (
    SimulatedFit,
    apart,
    fit_simulated,
    inverse_covariance,
    misfit,
)
from gaugeblock.discovery.simulated.observed import Observed
from gaugeblock.discovery.simulated.score_tests import LearnedTests
from gaugeblock.simulators.library import LibraryEffect

SHARE = 0.04
"""Step of a parameter that is scanned at one value only, as a share of its prior's width."""

UNLIKE = 0.5
"""Correlation below which two scores of an effect are two peaks ..."""

NEARLY = 0.5
"""... and share of the larger gain from which on the smaller one counts."""


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
        weights = scores.T @ (inverse_covariance(covariance) @ (scores @ (numerator.mean - denominator.mean)))
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
    """Fit one candidate from the scanned values whose simulations come nearest to the data.

    The amplitude is what one step of their score promises. The scores themselves do not say where to begin:
    the population has taken some of an effect that is not known yet, and they do not see that part. From a
    second place too, where another is nearly as near: of two local fits the data choose.
    """
    found: LearnedTests = seen.state
    fits = []
    for model, state in starting_points(candidate, found, before, observed):
        lesson = learn(model, observed, simulate_base(model, observed, state), state)
        fits.append(fit_simulated(model, observed, start=state, lesson=lesson, span=found.span))
    fitted = min(fits, key=lambda one: misfit(one, observed, found.span))
    return _compared(candidate, path, fitted, before, found, observed)


def starting_points(
    candidate: Candidate, found: LearnedTests, before: SimulatedFit, observed: Observed
) -> list[tuple[Model, Array]]:
    """Models with the effect and states to begin from: the nearest, and the nearest of those unlike it."""
    mine = np.flatnonzero(found.scores.owner == candidate.key)
    begun = [_begun(candidate, found, int(score), found.scores.node[score], before) for score in mine]
    if len(mine) == 1:
        return begun
    if len(observed) == 1:
        # What is measured once is no mean, and a distance from it says little; nor is there a population.
        gain = found.z[mine] ** 2
    else:
        left = [apart(simulate_base(model, observed, state), found.span, observed) for model, state in begun]
        gain = apart(before.base, found.span, observed) - np.array(left)
    best = int(np.argmax(gain))
    starts = [best]
    unlike = np.flatnonzero(np.abs(found.scores.correlation(before, mine)[best]) < UNLIKE)
    if len(unlike):
        second = int(unlike[np.argmax(gain[unlike])])
        starts += [second] if gain[second] > NEARLY * gain[best] else []
    return [
        _begun(candidate, found, int(mine[start]), peak_between(candidate, found, gain, start), before)
        for start in starts
    ]


def _begun(
    candidate: Candidate, found: LearnedTests, score: int, values: Array, before: SimulatedFit
) -> tuple[Model, Array]:
    """The model with the effect, and a state with these values ``(k,)``, the amplitude by one step."""
    entry = candidate.entry
    low, high = entry.support
    departure = found.amplitude[score]
    # No farther than a third of the prior, and never neutral: there the other parameters mean nothing.
    departure = np.sign(departure or entry.step) * np.clip(
        abs(departure), 0.1 * abs(entry.step), (high - low) / 3.0
    )
    steps = np.array([scan_step(entry, name) for name in entry.parameters])
    steps[candidate.amplitude_index] = found.scores.step[score]
    chosen = values.copy()
    chosen[candidate.amplitude_index] = np.clip(entry.neutral + departure, low, high)
    scanned = [name in entry.scanned for name in entry.parameters]
    model = before.model.extended(candidate.simulator, steps, scanned)
    state = np.concatenate([before.state, chosen])
    state[: model.hyper] = model.population.widened(state[: model.hyper])
    return model, state


def scan_step(entry: LibraryEffect, name: str) -> float:
    """Step of a scanned parameter: half the way from one value to the next, over no jump."""
    ways = np.diff(np.unique(np.asarray(entry.scanned.get(name, ()), dtype=float)))
    if not len(ways):
        return SHARE * float(np.ptp(entry.parameters[name].support))
    return float(0.5 * np.median(ways))


def peak_between(candidate: Candidate, found: LearnedTests, gain: Array, at: int) -> Array:
    """Values ``(k,)`` where the gain ``(node,)`` peaks: by a parabola through a node and its neighbours.

    A fit that begins at a scanned value may find nothing on either side: halfway between two weeks an effect
    is shared by both, and at one of them its answer to the week is as large one way as the other.
    """
    mine = np.flatnonzero(found.scores.owner == candidate.key)
    nodes = np.array([found.scores.node[score] for score in mine])
    values: Array = nodes[at].copy()
    for column, name in enumerate(candidate.entry.parameters):
        if name not in candidate.entry.scanned:
            continue
        others = np.delete(nodes, column, axis=1)
        line = np.flatnonzero((others == others[at]).all(axis=1))
        line = line[np.argsort(nodes[line, column])]
        place = int(np.flatnonzero(line == at)[0])
        if 0 < place < len(line) - 1:
            below, here, above = gain[line[place - 1 : place + 2]]
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
    """Learn all scores anew where the fit ended, and fit again: for amplitude and interval.

    From there, and from a population that is closed in on with the effect in place: the one that was fitted
    before the effect may have taken some of it, and a fit that begins there stays there.
    """
    model, starts = one.fit.model, [one.fit.state]
    if len(observed) > 1:
        own, effects = model.population, one.fit.state[model.hyper :]
        anew = close_in(
            model.simulator, observed.data, simulations=observed.budget.simulations,
            seed=observed.budget.seed, summaries=observed.features.summaries, prior=own.prior,
            effects=effects,
        )  # fmt: skip
        starts.append(np.concatenate([own.hyper_of(anew), effects]))
    fits = [fit_simulated(model, observed, start=start, span=found.span) for start in starts]
    fitted = min(fits, key=lambda one: misfit(one, observed, found.span))
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
