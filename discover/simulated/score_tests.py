"""Score tests of every effect at every scanned value, from learned scores, with a null that is simulated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.discovery.engine import Look, beyond, together
from gaugeblock.discovery.library import Candidate, Candidates
from gaugeblock.discovery.name.score import allowed
from gaugeblock.discovery.simulated.learning import Base, derivative
from gaugeblock.discovery.simulated.moment_fit import SimulatedFit
from gaugeblock.discovery.simulated.observed import Observed
from gaugeblock.simulators.library import LibraryEffect

SIGMA = 5.0
"""The smallest detectable amplitude is one that stands out by this many standard errors."""

SCAN_SEED = 1000
"""Seeds of the scan's simulations begin so far behind the fit's."""

MOVES = 0.5
WIDER = 3.0
"""Times the library's own step that an amplitude is moved by at most."""

FARTHEST, CLOSE = 10.0, 2.0
"""A trial changes a step by no more than the first; less than the second is as good as no change."""

TRIALS = 3

CELLS = 2_000_000
"""Numbers gathered at once when the null is drawn."""


@dataclass(frozen=True, eq=False)
class LearnedScores:
    """Scores of every effect at every scanned value, before anything that was fitted is projected out.

    `owner` ``(score,)`` names the effect, `node` ``(score,)`` its parameters' values; `learned` and `halves`
    ``(score, 2, feature)`` are weights and the derivatives they were made from, as in `Lesson`; `sign` is 0
    where the amplitude may go both ways, else the way it may go; `step` ``(score,)`` what the amplitude was
    moved by.
    """

    owner: NDArray[np.str_]
    node: tuple[Array, ...]
    learned: Array
    halves: Array
    step: Array
    sign: NDArray[np.int64]

    def correlation(self, fitted: SimulatedFit, chosen: ArrayLike) -> Array:
        """Of some of the scores with each other ``(chosen, chosen)``, orthogonal to all that was fitted."""
        weights = fitted.lesson.orthogonal(self.learned[np.asarray(chosen)].mean(axis=1))
        covariance = fitted.base.covariance(weights)
        size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
        return np.asarray(covariance / np.outer(size, size))


def learn_effects(candidates: Candidates, fitted: SimulatedFit, observed: Observed) -> LearnedScores:
    """Learn the score of every effect at the fitted state; all effects see the same random numbers."""
    owner, node, learned, halves, step, sign = [], [], [], [], [], []
    for candidate in candidates:
        entry = candidate.entry
        for values in entry.nodes:
            neutral = values.copy()
            neutral[candidate.amplitude_index] = entry.neutral
            size, pair, weights = _well_stepped(candidate, neutral, fitted, observed)
            owner.append(candidate.key)
            node.append(values)
            halves.append(pair)
            learned.append(weights)
            step.append(size)
            sign.append(0 if entry.two_sided else int(np.sign(entry.step)))
    return LearnedScores(
        np.array(owner), tuple(node), np.array(learned), np.array(halves), np.array(step), np.array(sign)
    )


def _well_stepped(
    candidate: Candidate, neutral: Array, fitted: SimulatedFit, observed: Observed
) -> tuple[float, Array, Array]:
    """Step of the amplitude, derivatives over it and weights of the score, at values ``(k,)`` of no effect.

    A step should move the score of a single data set by about `MOVES` of its standard deviation: over a much
    larger one the answer is not a line, over a smaller one it is noise.
    """
    entry, index = candidate.entry, len(fitted.state) + len(neutral) + candidate.amplitude_index
    state, size = np.concatenate([fitted.state, neutral]), abs(entry.step)
    seed, base = observed.budget.seed + SCAN_SEED, fitted.base

    def over(step: float, simulations: int) -> tuple[Array, Array]:
        model = fitted.model.extended(candidate.simulator, np.full(len(neutral), step))
        pair = derivative(model, observed, state, index, seed, simulations=simulations)
        return pair, base.learn(pair)

    for _ in range(TRIALS):
        pair, weights = over(size, observed.budget.simulations // 4)
        response = 0.5 * float((weights * pair[::-1]).sum())
        sd = np.sqrt(max(float(base.variance(weights.mean(axis=0))), 1e-300))
        before = size
        size *= np.clip(MOVES * sd / max(size * response, 1e-9 * sd), 1.0 / FARTHEST, FARTHEST)
        size = min(size, WIDER * abs(entry.step))
        if 1.0 / CLOSE < size / before < CLOSE:
            break
    return size, *over(size, observed.budget.simulations)


@dataclass(frozen=True, eq=False)
class LearnedTests:
    """What learned scores find in the data, orthogonal to everything that was fitted.

    `z`, `amplitude` (departure from neutral, one step), `error`, `information` (of a data set) and `kept`
    (its share after projection) are ``(score,)``. `moment_z` ``(2 coordinate,)`` says how far each
    coordinate is off in the mean, and the square along each principal axis. The nulls ``(replicate,)`` hold
    of each simulated catalogue the largest allowed z, the largest moment and the mean square of all moments.
    """

    scores: LearnedScores
    z: Array
    amplitude: Array
    error: Array
    information: Array
    kept: Array
    moment_z: Array
    null_largest: Array
    null_moment: Array
    null_square: Array
    span: Array
    """Weights ``(score, feature)`` of all scores that were learned, the fitted state's among them."""

    @property
    def p_moments(self) -> float:
        """Global p over the moments: the largest one, and all together (Bonferroni)."""
        largest = beyond(self.null_moment, float(np.abs(self.moment_z).max()))
        return together(largest, beyond(self.null_square, float((self.moment_z**2).mean())))

    def look(self, entries: Mapping[str, LibraryEffect], data_sets: int) -> Look:
        """Score tests of the effects on so many data sets."""
        information = self.information * data_sets
        nodes = [np.arange(np.count_nonzero(self.scores.owner == key)) for key in entries]
        with np.errstate(divide="ignore"):
            smallest = SIGMA / np.sqrt(information)
        return Look(
            entries=entries,
            owner=self.scores.owner,
            node=np.concatenate(nodes),
            z=allowed(self.z, self.scores.sign),
            amplitude=self.amplitude,
            kept=self.kept,
            smallest_detectable=smallest,
            null=self.null_largest,
            p_rest=self.p_moments,
            state=self,
        )


def find(
    scores: LearnedScores,
    fitted: SimulatedFit,
    observed: Observed,
    *,
    replicates: int,
    rng: np.random.Generator,
) -> LearnedTests:
    """Test learned scores on the data, beside catalogues of as many data sets simulated from the fit.

    A simulated catalogue is drawn from the fit's simulations; that its population would be fitted anew is
    taken into account to first order, by the projection. Scores learned at another state keep their size;
    only their power suffers.
    """
    base, lesson, n = fitted.base, fitted.lesson, len(observed)
    first, second = (lesson.orthogonal(scores.learned[:, k]) for k in (0, 1))
    weights = np.concatenate([0.5 * (first + second), lesson.orthogonal(observed.features.moments())])
    sd = np.sqrt(np.maximum(base.variance(weights), 1e-300))
    error = sd * np.sqrt(observed.inflation / n)
    difference = weights @ (observed.mean - base.mean)
    z = difference / error
    drawn = resampled((base.rows - base.mean) @ (weights / sd[:, None]).T, n, replicates, rng) * np.sqrt(n)
    j = len(scores.learned)
    response = 0.5 * ((first * scores.halves[:, 1]).sum(axis=1) + (second * scores.halves[:, 0]).sum(axis=1))
    answer = np.where(response > 0, response, np.inf)
    information = response**2 / sd[:j] ** 2
    return LearnedTests(
        scores,
        z[:j],
        difference[:j] / answer,
        error[:j] / answer,
        information,
        np.clip(information / np.maximum(_unprojected(scores, base), 1e-300), 0.0, 1.0),
        z[j:],
        allowed(drawn[:, :j], scores.sign).max(axis=1),
        np.abs(drawn[:, j:]).max(axis=1),
        (drawn[:, j:] ** 2).mean(axis=1),
        np.concatenate([lesson.weights, scores.learned.mean(axis=1)]),
    )


def _unprojected(scores: LearnedScores, base: Base) -> Array:
    """Information ``(score,)`` of a data set were nothing else free."""
    response = 0.5 * (scores.learned * scores.halves[:, ::-1]).sum(axis=(1, 2))
    return np.asarray(response**2 / np.maximum(base.variance(scores.learned.mean(axis=1)), 1e-300))


def resampled(rows: Array, n: int, replicates: int, rng: np.random.Generator) -> Array:
    """Means over n rows drawn at random, ``(replicate, column)``, rows drawn a replicate at a time."""
    chunk = max(1, CELLS // (n * rows.shape[1]))
    found = []
    for start in range(0, replicates, chunk):
        index = rng.integers(0, len(rows), size=(min(chunk, replicates - start), n))
        found.append(rows[index].mean(axis=1))
    return np.concatenate(found)
