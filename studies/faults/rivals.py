"""What else would explain a case: how far its truths lie from every other symptom's best repair, in sigma.

A symptom is a family of laws that the broken law is taken for: moved back, stretched back, reweighted. Of
each family the member is sought that is nearest to the exact posterior, by the mean log ratio of the two
densities on simulations of its own. A case's ``n`` trials tell the family from the truth by ``sqrt(2 n KL)``
standard deviations. All is computed from the laws; no draw of a case is looked at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import combinations
from typing import Any

import numpy as np
from scipy import optimize, special

from studies.faults.catalogue import EVERY, Estimator
from studies.faults.laws import Array, Law, Rng, place

SIMULATIONS, DRAWS = 2000, 100
FAR = 99.0
"""What no number of trials tells more of."""

LEAST = -30.0
"""Log densities below this are taken for it: a truth that a law cannot have is enough to tell it."""

FAIR = 5.0
"""Standard deviations from the nearest rival from which on a name is asked for."""

NOTHING = "nothing"


class _Case:
    """Simulations of a problem, the broken law for their data, and its places."""

    def __init__(self, broken: Estimator, rng: Rng):
        self.broken, self.problem = broken, broken.problem
        self.theta = self.problem.theta(SIMULATIONS, rng)
        self.x = self.problem.simulate(self.theta, rng)
        self.exact = self.problem.posterior(self.x).log_density(self.theta)
        self.law = broken.law(self.x)
        self.middle, self.width = place(self.law)
        self.rng, self.p = rng, self.theta.shape[1]

    def log(self, theta: Array, law: Law | None = None) -> Array:
        """Log density of the broken law at other points, not below `LEAST` or what the truth has."""
        found = (self.law if law is None else law).log_density(theta)
        return np.maximum(found, np.minimum(LEAST, self.exact - 1))

    def nats(self, log: Array) -> float:
        """Mean log ratio of the posterior to a law with these log densities."""
        return float(np.mean(self.exact - log))

    def draws(self) -> Array:
        """Draws of the broken law ``(trial, draw, parameter)``."""
        return self.law.of_scores(self.scores())

    def scores(self) -> Array:
        """Standard normal numbers ``(trial, draw, parameter)``."""
        return self.rng.standard_normal((SIMULATIONS, DRAWS, self.p))

    # What each family makes of the law: log densities ``(trial,)`` by the family's numbers.

    def moved(self, by: Array, *, width: Array | None = None) -> Array:
        return self.log(self.theta + by * (self.width if width is None else width))

    def stretched(self, log: Array) -> Array:
        return self.log(self.middle + (self.theta - self.middle) * np.exp(log)) + np.sum(log)

    def bent(self, by: Array) -> Array:
        away = self.theta - self.middle
        turn = by * np.sign(away)
        return self.log(self.middle + away * np.exp(turn)) + turn.sum(axis=1)

    def mapped(self, column: int, change: Callable[[Array], Array], slope: Callable[[Array], Array]) -> Array:
        at = np.array(self.theta)
        with np.errstate(all="ignore"):
            at[:, column] = change(self.theta[:, column])
            log = slope(self.theta[:, column])
        good = np.isfinite(at[:, column]) & np.isfinite(log)
        return np.where(
            good, self.log(np.where(good[:, None], at, self.theta)) + np.where(good, log, 0), LEAST
        )


def _best(case: _Case, family: Callable[[Array], Array], guess: Array, reach: float) -> float:
    """The least mean log ratio in a smooth family, begun at what is guessed from where truths lie."""

    def loss(numbers: Array) -> float:
        return case.nats(family(np.clip(numbers, -reach, reach)))

    size = len(guess)
    starts = [np.zeros(size), np.clip(guess, -reach, reach)]
    starts += [way * step * np.ones(size) for way in (-1, 1) for step in (0.15, 0.6)]
    begun = min(starts, key=loss)
    found = optimize.minimize(
        loss, begun, method="L-BFGS-B", bounds=[(-reach, reach)] * size, options={"maxiter": 12, "eps": 1e-4}
    )
    return min(float(found.fun), loss(begun), loss(np.zeros(size)))


def _shift(case: _Case) -> float:
    typical = np.broadcast_to(np.median(case.width, axis=0), case.width.shape)
    families = (
        (case.moved, case.width),
        (lambda by: case.moved(by, width=typical), typical),
    )
    return min(
        _best(case, family, np.median((case.middle - case.theta) / width, axis=0), 60.0)
        for family, width in families
    )


def _scale(case: _Case) -> float:
    far = np.quantile(np.abs(case.theta - case.middle) / case.width, 0.6827, axis=0)
    return _best(case, case.stretched, -np.log(np.maximum(far, 1e-3)), float(np.log(40)))


def _skew(case: _Case) -> float:
    lower = np.clip((case.theta < case.middle).mean(axis=0), 0.05, 0.95)
    return _best(case, case.bent, np.log(lower / (1 - lower)), float(np.log(6)))


def _kept(case: _Case, inside: Array, share: Array) -> float:
    """Draws left out: truths that are not among what is kept are far from it."""
    return case.nats(np.where(inside, case.log(case.theta) - np.log(np.maximum(share, 1e-3)), LEAST))


def _outliers(case: _Case) -> float:
    def near(values: Array) -> Array:
        return (np.abs(values - case.middle[:, None]) < 8 * case.width[:, None]).all(axis=2)

    return _kept(case, near(case.theta[:, None])[:, 0], near(case.draws()).mean(axis=1))


def _leakage(case: _Case) -> float:
    low, high = case.theta.min(axis=0), case.theta.max(axis=0)
    draws = case.draws()
    share = ((draws >= low) & (draws <= high)).all(axis=2).mean(axis=1)
    return _kept(case, np.ones(len(case.theta), bool), share)


def _tilted(case: _Case, features: Callable[[Array], Array]) -> float:
    """Draws reweighted by the exponential of a sum of features ``(..., feature)``."""
    own, theirs, plain = features(case.theta[:, None]), features(case.draws()), case.log(case.theta)
    together = np.concatenate([own, theirs], axis=1)

    def loss(weight: Array) -> tuple[float, Array]:
        # The truth among its draws bounds what any weight gains: all else is what few draws do not hold.
        score = together @ weight
        chance = special.softmax(score, axis=1)
        slope = (own[:, 0] - np.einsum("td,tdf->tf", chance, together)).mean(axis=0)
        return float((special.logsumexp(score, axis=1) - score[:, 0]).mean()), -slope

    size = own.shape[2]
    found = optimize.minimize(
        loss, np.zeros(size), jac=True, method="L-BFGS-B", bounds=[(-6, 6)] * size, options={"maxiter": 30}
    )
    score = theirs @ found.x
    worth = 1 / np.sum(special.softmax(score, axis=1) ** 2, axis=1)
    # A mean of few effective draws: without the bias of its log where there are enough, else the bound.
    mean = special.logsumexp(score, axis=1) - np.log(DRAWS) + (DRAWS / worth - 1) / (2 * DRAWS)
    bound = special.logsumexp(together @ found.x, axis=1) - np.log(DRAWS + 1)
    trusted = (worth > DRAWS / 10) & (plain > LEAST)
    gained = own[:, 0] @ found.x - np.where(trusted, mean, np.maximum(bound, mean))
    return case.nats(plain + gained)


def _other_prior(case: _Case) -> float:
    centre = np.median(case.theta, axis=0)
    wide = np.quantile(case.theta, 0.84, axis=0) - np.quantile(case.theta, 0.16, axis=0)

    def features(values: Array) -> Array:
        at = np.clip(2 * (values - centre) / wide, -3, 3)
        return np.concatenate([at, at**2], axis=-1)

    return _tilted(case, features)


def _correlations(case: _Case) -> float:
    one, other = np.triu_indices(case.p, 1)

    def features(values: Array) -> Array:
        at = np.clip((values - case.middle[:, None]) / case.width[:, None], -4, 4)
        return at[..., one] * at[..., other]

    return _tilted(case, features)


def _mode_weights(case: _Case) -> float:
    column = case.problem.modes
    assert column is not None
    centre = np.sign(case.middle[:, None, column])
    return min(
        _tilted(case, lambda values: (values[..., [column]] > 0) * 1.0),
        _tilted(case, lambda values: ((values[..., column] * centre) > 0)[..., None] * 1.0),
    )


def _missing_mode(case: _Case) -> float:
    column = case.problem.modes
    assert column is not None
    turned = np.array(case.theta)
    turned[:, column] *= -1
    here, there = case.log(case.theta), case.log(turned)
    return min(
        case.nats(np.logaddexp(np.log1p(-share) + here, np.log(share) + there))
        for share in np.linspace(0.05, 0.75, 15)
    )


def _x_noise(case: _Case) -> float:
    """The law times a power of the likelihood, by which posteriors for two noises differ."""
    laws = [case.problem.posterior(case.x, noisier=noisier) for noisier in (1.0, 2.0)]
    points = np.concatenate([case.draws(), laws[0].of_scores(case.scores())], axis=1)

    def of(law: Law, values: Array) -> Array:
        found = [np.maximum(law.log_density(values[:, k]), LEAST) for k in range(values.shape[1])]
        return np.stack(found, axis=1)

    own = of(case.law, points)
    # Where either of the two may have drawn it: the power may be below 0, and the law is narrow then.
    drawn = np.logaddexp(own, of(laws[0], points)) - np.log(2)
    likelihood = of(laws[0], points) - of(laws[1], points)
    at_truth = (of(laws[0], case.theta[:, None]) - of(laws[1], case.theta[:, None]))[:, 0]
    plain = case.log(case.theta)

    def nats(log: float) -> float:
        # Of a law for `ratio` times the noise; the other noise, of twice that, leaves 3/4 of the likelihood.
        power = (1 - np.exp(-2 * log)) / 0.75
        mass = special.logsumexp(own + power * likelihood - drawn, axis=1) - np.log(points.shape[1])
        return case.nats(plain + power * at_truth - mass)

    begun = min(np.linspace(-1.4, 1.4, 15), key=nats)
    found = optimize.minimize_scalar(nats, bounds=(begun - 0.2, begun + 0.2), method="bounded").fun
    return min(float(found), nats(0.0))


def _columns(case: _Case) -> float:
    found = []
    for i, j in combinations(range(case.p), 2):
        order = list(range(case.p))
        order[i], order[j] = j, i
        found.append(case.nats(case.log(case.theta[:, order])))
    return min(found)


def _factors(case: _Case, column: int, sign: float) -> float:
    def nats(log: float) -> float:
        return case.nats(
            case.mapped(column, lambda v: sign * v * np.exp(log), lambda v: np.full(len(v), log))
        )

    grid = np.linspace(-9, 9, 37)
    begun = min(grid, key=nats)
    return float(optimize.minimize_scalar(nats, bounds=(begun - 0.5, begun + 0.5), method="bounded").fun)


def _unit(case: _Case) -> float:
    return min(_factors(case, k, 1.0) for k in range(case.p))


def _sign(case: _Case) -> float:
    middle = np.median(case.theta, axis=0)
    return min(
        case.nats(case.mapped(k, lambda v, a=about: 2 * a - v, np.zeros_like))
        for k in range(case.p) for about in (0.0, float(middle[k]))
    )  # fmt: skip


def _log(case: _Case) -> float:
    return min(
        case.nats(case.mapped(k, change, slope))
        for k in range(case.p)
        for change, slope in ((np.log, lambda v: -np.log(v)), (np.exp, lambda v: v))
    )


def _clipped_tails(case: _Case) -> float:
    """Tails drawn out as those of a normal law whose ends are missing."""
    grid = np.linspace(-6, 6, 2001)
    found = []
    for share in (0.005, 0.01, 0.02, 0.04, 0.08, 0.15):
        inner = special.ndtri(share + (1 - 2 * share) * special.ndtr(grid))
        safe = np.where(np.abs(inner) > 1e-9, inner, 1.0)
        out = grid * np.where(np.abs(inner) > 1e-9, grid / safe, 1 / (1 - 2 * share))
        slope = np.gradient(grid, out)
        at = (case.theta - case.middle) / case.width
        before = np.interp(at, out, grid)
        log = np.log(np.maximum(np.interp(at, out, slope), 1e-9)).sum(axis=1)
        found.append(case.nats(case.log(case.middle + before * case.width) + log))
    return min(found)


def _region(case: _Case) -> float:
    """Moved or stretched on one side of a threshold that at most half of the trials lie beyond."""
    plain = case.log(case.theta)
    tried = []
    for log in (-1.2, -0.8, -0.5, -0.3, -0.15, 0.15, 0.3, 0.5, 0.8, 1.2):
        tried.append(case.stretched(np.full(case.p, log)))
        tried += [case.stretched(log * row) for row in np.eye(case.p)] if case.p > 1 else []
    for by in (-2.0, -1.3, -0.9, -0.6, -0.4, -0.2, 0.2, 0.4, 0.6, 0.9, 1.3, 2.0):
        tried += [case.moved(by * row) for row in np.eye(case.p)]
    gained = np.stack(tried, axis=1) - plain[:, None]
    places = np.concatenate([case.middle, case.x], axis=1)
    sides = []
    for share in (0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5):
        sides += [
            places < np.quantile(places, share, axis=0),
            places > np.quantile(places, 1 - share, axis=0),
        ]
    inside = np.concatenate(sides, axis=1).astype(float)
    # Each parameter by an amount of its own, as far as they act apart.
    return case.nats(plain) - float((inside.T @ gained).max()) / len(plain)


def _turned(case: _Case, turn: Callable[[Array], Array]) -> float:
    with np.errstate(all="ignore"):
        return case.nats(case.log(case.theta, case.broken.law(turn(case.x))))


def _x_scale(case: _Case) -> float:
    mean, sd = case.x.mean(axis=0), case.x.std(axis=0)
    ways: list[Callable[[Array], Array]] = [lambda x: (x - mean) / sd, lambda x: (x - x.mean()) / x.std()]
    ways += [lambda x, log=log: x * np.exp(log) for log in np.log(10) * np.arange(-4, 4.01, 0.25) if log]
    return min(_turned(case, way) for way in ways)


def _x_shift(case: _Case) -> float:
    spread = float(case.x.std())
    steps = [step for step in np.arange(-6, 6.01, 0.25) if step]
    return min(_turned(case, lambda x, step=step: x + step * spread) for step in steps)


def _x_order(case: _Case) -> float:
    return _turned(case, lambda x: x[:, ::-1])


def _x_channel(case: _Case) -> float:
    found = []
    for i, j in combinations(range(case.problem.channels), 2):
        order = list(range(case.problem.channels))
        order[i], order[j] = j, i
        found.append(_turned(case, lambda x, order=order: x[:, order]))
    return min(found)


ALONE: Mapping[str, Callable[[_Case], float]] = {
    NOTHING: lambda case: case.nats(case.log(case.theta)),
    "shift": _shift,
    "scale": _scale,
    "skew": _skew,
    "outliers": _outliers,
    "leakage": _leakage,
    "clipped_tails": _clipped_tails,
    "other_prior": _other_prior,
    "x_noise": _x_noise,
    "region": _region,
    "unit": _unit,
    "log": _log,
    "sign": _sign,
}
JOINT: Mapping[str, Callable[[_Case], float]] = {"columns": _columns, "correlations": _correlations}
MODES: Mapping[str, Callable[[_Case], float]] = {
    "mode_weights": _mode_weights,
    "missing_mode": _missing_mode,
}
CALLED: Mapping[str, Callable[[_Case], float]] = {
    "x_scale": _x_scale,
    "x_shift": _x_shift,
    "x_order": _x_order,
    "x_channel": _x_channel,
}
"""Families that need the estimator to be called again."""

UNSEEN = ("x_scale", "x_shift", "x_order", "x_channel", "knows_truth")
"""What no draws show: unfair where the estimator cannot be called."""


def _families(case: _Case) -> Iterator[tuple[str, Callable[[_Case], float]]]:
    yield from ALONE.items()
    yield from JOINT.items() if case.p > 1 else ()
    yield from MODES.items() if case.problem.modes is not None else ()
    yield from CALLED.items()


def distances(broken: Estimator, trials: int, rng: Rng) -> dict[str, float]:
    """How many standard deviations `trials` trials lie from each rival symptom; none where laws are exact."""
    if EVERY[broken.fault].shows != "law" or broken.fault == "sound":
        return {}
    case = _Case(broken, rng)
    found: dict[str, float] = {}
    for name, nats in _families(case):
        if name != broken.fault:
            least = max(nats(case), 0.0)
            found[name] = round(min(float(np.sqrt(2 * trials * least)), FAR), 2)
    return found


def rivals(apart: Mapping[str, float], *, called: bool) -> list[str]:
    """Symptoms that a case's trials do not tell from its own, nearest first."""
    near = {name: sigma for name, sigma in apart.items() if sigma < FAIR and (called or name not in CALLED)}
    return sorted(near, key=lambda name: near[name])


def fair(fault: str, apart: Mapping[str, float], *, called: bool) -> bool:
    """Whether one name can be asked for: every rival is told from it, and it shows in what there is."""
    if not called and fault in UNSEEN:
        return False
    return not rivals(apart, called=called)


def nearest(apart: Mapping[str, float], *, called: bool) -> tuple[str, float]:
    """The nearest rival and its distance."""
    seen: dict[str, Any] = {k: v for k, v in apart.items() if called or k not in CALLED}
    name = min(seen, key=lambda k: seen[k], default="")
    return name, float(seen.get(name, FAR))
