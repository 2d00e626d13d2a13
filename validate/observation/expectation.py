"""What the rest of a data set leads one to expect of each of its coordinates, learned on simulations.

The linear part is the precision matrix. On what it leaves, a regression on random smooth functions of the
leading components, taken without the coordinate in question, learns the rest of the mean and how far a
coordinate usually strays: a fault stands out in its own coordinate however wide the prior is, however the
noise varies, and does not set its own standard.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.observation.scores import NormalScores, squares

COMPONENTS = 6
FUNCTIONS = 60
RIDGES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
PENALTIES = (3.0, 30.0, 300.0, 3e6)
# From so many coordinates on, a data set may have a noise level of its own; it has one where that of half its
# coordinates goes with that of the other half at least so much.
LEVEL_FROM, TOGETHER = 20, 0.3
# Components farther out than simulations go are taken there.
FARTHEST = 3.5
# Stretches are tried around so many of the farthest coordinates, of these widths along every axis. What
# a coordinate that is left out has to explain (a stretch counts as one more than it has), and what a stretch
# of several has to beyond that. Residuals below the last are no longer odd.
CANDIDATES, WIDTHS, PRICE, SEVERAL, USUAL = 6, (1, 2, 3, 4, 6, 9), 2.0, 13.0, 3.0
# Mean of log |e| of a standard normal e, and the least |e| that is told from 0.
LOG_ABSOLUTE, LEAST = -0.6351814227307392, 1e-3


@dataclass(frozen=True, eq=False)
class Residuals:
    """Of data sets, all standard normal in simulations, or nearly so.

    `left` ``(n, coordinate)``: what is left of each coordinate given all others. `white` ``(n, coordinate)``:
    the same decorrelated, each still at its place. `whole` ``(n, coordinate)``: the scores themselves,
    decorrelated; `leading` ``(n, k)`` their largest components, `standing` ``(n, k)`` the same, each times
    the share of its variance that stands above the usual component's. `level` ``(n,)``: log of how large what
    is left is on the whole, against what the components lead one to expect.
    """

    left: Array
    white: Array
    whole: Array
    leading: Array
    standing: Array
    level: Array


@dataclass(frozen=True, eq=False)
class Regression:
    """Weights of a constant, the components and smooth functions of them, one column for each target."""

    projections: Array
    phases: Array

    def functions(self, leading: Array, level: Array | None) -> Array:
        """At components ``(n, k)`` and noise levels ``(n,)``: ``(n, function)``."""
        parts = [np.ones((len(leading), 1))]
        if leading.shape[1]:
            near = np.clip(leading, -FARTHEST, FARTHEST)
            parts += [near, np.tanh(near @ self.projections + self.phases)]
        if level is not None:
            parts += [level[:, None], level[:, None] ** 2]
        return np.concatenate(parts, axis=1)


def regressed(first: Array, targets: Array, second: Array, held: Array) -> Array:
    """Ridge regression of targets ``(n, k)`` on the first half, as stiff as predicts the held ones best."""
    gram, moment = first.T @ first, first.T @ targets
    found: Array = np.zeros((first.shape[1], targets.shape[1]))
    least = np.inf
    for penalty in PENALTIES:
        stiff = np.full(first.shape[1], penalty)
        stiff[0] = 1e-6  # the constant is free
        made = np.linalg.solve(gram + np.diag(stiff), moment)
        loss = float(((held - second @ made) ** 2).mean())
        if loss < least:
            found, least = np.asarray(made), loss
    return np.asarray(found)


@dataclass(frozen=True, eq=False)
class Expectation:
    """Learned on scores ``(n, coordinate)``; see `residuals`."""

    centre: Array
    precision: Array
    root: Array
    leads: Array
    share: Array
    regression: Regression
    means: Array
    scales: Array
    usual: Array
    levelled: bool
    level: Array
    left: NormalScores
    whitening: Array

    @classmethod
    def learned(cls, z: Array, rng: np.random.Generator) -> Expectation:
        """One half of the simulated scores fits, the other half chooses how stiffly and sets the scale."""
        half, size = len(z) // 2, z.shape[1]
        centre = z[:half].mean(axis=0)
        variances, basis = np.linalg.eigh(np.atleast_2d(np.cov((z[:half] - centre).T)))
        strength = (((z[half:] - centre) @ basis) ** 2).mean(axis=0)
        values = _stiffened(np.maximum(variances, 0.0), strength)
        number = min(COMPONENTS, size - 1)
        leads = (basis / np.sqrt(values))[:, ::-1][:, :number]
        # Components that vary no more than most others are noise, in which distances drown.
        share = np.clip(1 - np.median(values) / values[::-1][:number], 0.0, 1.0)
        regression = Regression(
            0.7 * rng.standard_normal((number, FUNCTIONS)) / max(number, 1) ** 0.5,
            rng.standard_normal(FUNCTIONS),
        )
        precision = (basis / values) @ basis.T
        linear = (z - centre) @ precision / np.diag(precision)
        usual = np.maximum(linear[:half].std(axis=0), 1e-12)
        made = cls(
            centre, precision, (basis / np.sqrt(values)) @ basis.T, leads, share, regression,
            np.zeros((0, size)),
            np.zeros((0, size)), usual, _own_level(linear[:half] / usual), np.zeros(0),
            NormalScores((), (), np.zeros((0, 2))), np.eye(size),
        )  # fmt: skip
        leading, level = (z - centre) @ leads, made._level(linear)
        means, scales = [], []
        left = np.empty(z.shape)
        for i in range(size):
            functions = made._functions(leading, linear, level, i)
            own = linear[:, i : i + 1] / usual[i]
            mean = regressed(functions[:half], own[:half], functions[half:], own[half:])
            log = np.log(np.abs(own - functions @ mean) + LEAST) - LOG_ABSOLUTE
            scale = regressed(functions[:half], log[:half], functions[half:], log[half:])
            left[:, i] = ((own - functions @ mean) * np.exp(-functions @ scale))[:, 0]
            means.append(mean[:, 0])
            scales.append(scale[:, 0])
        scored = NormalScores.learned(left[half:])
        normal = scored(left)
        values, basis = np.linalg.eigh(np.atleast_2d(np.cov(normal[half:].T)) + 1e-3 * np.eye(size))
        return cls(
            centre, precision, made.root, leads, share, regression, np.stack(means, axis=1),
            np.stack(scales, axis=1), usual, made.levelled, made._learned_level(leading, level, half), scored,
            (basis / np.sqrt(values)) @ basis.T,
        )  # fmt: skip

    def residuals(self, z: Array) -> Residuals:
        """Of scores ``(n, coordinate)``."""
        departure, scale, leading, level = self._departures(z)
        left = self.left(departure / scale)
        functions = self.regression.functions(leading, None)
        return Residuals(
            left=left,
            white=np.asarray(left @ self.whitening),
            whole=np.asarray((z - self.centre) @ self.root),
            leading=leading,
            standing=leading * self.share,
            level=np.asarray(level - functions @ self.level),
        )

    def expected(self, z: Array, departures: float) -> tuple[Array, Array, Array]:
        """Scores of one data set ``(coordinate,)`` that the others lead one to expect, and a range.

        The range reaches to residuals of minus and plus `departures`.
        """
        departure, scale, _, _ = self._departures(z[None])
        ends = self.left.inverse(np.repeat([[0.0], [-departures], [departures]], len(z), axis=1))
        middle, low, high = z + (ends * scale - departure) * self.usual
        return middle, low, high

    def set_apart(self, z: Array, grid: tuple[int, ...], most: int) -> list[tuple[tuple[int, ...], float]]:
        """Stretches of one data set ``(coordinate,)``, the oddest first, with the largest residual in each.

        The oddest is the one without which least is left of the others, every coordinate left out at its
        price: what stands beside an outlier may depart as far, and of a bump the edges depart most. Every
        next one is judged with those before it as expected; once nothing odd is left, those follow that would
        have explained most in place of the first. `grid` is how the coordinates lie.
        """
        found: list[tuple[tuple[int, ...], float]] = []
        instead: list[tuple[int, ...]] = []
        mended, open_ = z.copy(), np.ones(len(z), dtype=bool)
        while open_.any() and len(found) < most:
            residual = np.where(open_, self.residuals(mended[None]).left[0], 0.0)
            instead = [one for one in instead if open_[list(one)].all()]
            if instead and np.abs(residual).max() < USUAL:
                chosen = instead[0]
            else:
                tried, cost, without = self._left_out(mended, residual, grid, open_)
                order = np.argsort(cost)
                chosen, mended = tried[order[0]], without[order[0]]
                instead = instead if found else [tried[i] for i in order[1:]]
            members = list(chosen)
            found.append((chosen, float(residual[members][np.argmax(np.abs(residual[members]))])))
            open_[members] = False
        return found

    def _left_out(
        self, z: Array, residual: Array, grid: tuple[int, ...], open_: NDArray[np.bool_]
    ) -> tuple[list[tuple[int, ...]], Array, Array]:
        """Stretches, what is left of the others without each with its price, and the scores without it."""
        tried = _stretches(residual, grid, open_)
        without = np.stack([self._without(z, np.array(one)) for one in tried])
        kept = np.repeat(open_[None], len(tried), axis=0)
        for row, one in zip(kept, tried, strict=True):
            row[list(one)] = False
        remaining = squares(np.where(kept, self.residuals(without).left, 0.0))
        price = [PRICE * (1 + len(one)) + SEVERAL * (len(one) > 1) for one in tried]
        return tried, remaining + np.array(price), without

    def _without(self, z: Array, gone: NDArray[np.intp]) -> Array:
        """Scores ``(coordinate,)`` with some of them where a linear prediction from the others puts them."""
        made = z.copy()
        block = self.precision[np.ix_(gone, gone)]
        made[gone] -= np.linalg.solve(block, ((z - self.centre) @ self.precision)[gone])
        return made

    def filled(self, z: Array, coordinates: list[int]) -> Array:
        """Scores of one data set with these coordinates replaced by what the others lead one to expect."""
        gone = np.array(coordinates, dtype=int)
        made = self._without(z, gone)
        for at in gone:
            departure = self._departures(made[None])[0]
            made[at] -= departure[0, at] * self.usual[at]
        return made

    def _departures(self, z: Array) -> tuple[Array, Array, Array, Array]:
        """From what is expected and its usual size, ``(n, coordinate)``; the components and noise levels."""
        linear = (z - self.centre) @ self.precision / np.diag(self.precision)
        leading, level = (z - self.centre) @ self.leads, self._level(linear)
        departure, scale = np.empty(z.shape), np.empty(z.shape)
        for i in range(z.shape[1]):
            functions = self._functions(leading, linear, level, i)
            departure[:, i] = linear[:, i] / self.usual[i] - functions @ self.means[:, i]
            scale[:, i] = np.exp(functions @ self.scales[:, i])
        return departure, scale, leading, level

    def _functions(self, leading: Array, linear: Array, level: Array, coordinate: int) -> Array:
        """Of the components as they would be with the coordinate where the others expect it."""
        without = leading - linear[:, coordinate : coordinate + 1] * self.leads[coordinate]
        return self.regression.functions(without, level if self.levelled else None)

    def _level(self, linear: Array) -> Array:
        """Log of the median size of what is left: a few outliers do not move it."""
        return np.asarray(np.log(np.median(np.abs(linear / self.usual), axis=1) + LEAST))

    def _learned_level(self, leading: Array, level: Array, half: int) -> Array:
        functions = self.regression.functions(leading, None)
        made = regressed(functions[:half], level[:half, None], functions[half:], level[half:, None])
        return np.asarray(made[:, 0])


def _stiffened(values: Array, strength: Array) -> Array:
    """Variances with so much added to each as makes the half likeliest that did not set them."""
    top = max(float(values.max()), 1e-12)
    costs = [float(np.sum(np.log(values + r * top) + strength / (values + r * top))) for r in RIDGES]
    return np.asarray(values + RIDGES[int(np.argmin(costs))] * top)


def _stretches(residual: Array, grid: tuple[int, ...], open_: NDArray[np.bool_]) -> list[tuple[int, ...]]:
    """Boxes that begin, end or have their middle at one of the farthest coordinates, at most half of all."""
    found: dict[tuple[int, ...], None] = {}
    for at in np.argsort(-np.abs(residual))[:CANDIDATES]:
        place = np.unravel_index(at, grid)
        for width in WIDTHS if open_[at] else ():
            for back in {0, (width - 1) // 2, width - 1}:
                sides = [
                    np.arange(max(0, p - back), min(n, p - back + width))
                    for p, n in zip(place, grid, strict=True)
                ]
                box = np.ravel_multi_index(np.meshgrid(*sides, indexing="ij"), grid).ravel()
                members = tuple(int(i) for i in box if open_[i])
                if len(members) <= max(1, len(residual) // 2):
                    found[members] = None
    return list(found)


def _own_level(standard: Array) -> bool:
    """Whether data sets differ in how noisy they are on the whole."""
    if standard.shape[1] < LEVEL_FROM:
        return False
    halves = [np.log(np.median(np.abs(standard[:, start::2]), axis=1) + LEAST) for start in (0, 1)]
    return bool(np.corrcoef(halves[0], halves[1])[0, 1] > TOGETHER)
