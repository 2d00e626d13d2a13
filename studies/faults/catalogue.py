"""Which faults are hidden: how each is drawn, at which size, and the law that it makes of an exact one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy import special

from studies.faults.laws import (
    Array,
    Joint,
    Law,
    LogNormal,
    Normal,
    Rng,
    Student,
    Truncated,
    TwoModes,
    Whole,
    place,
)
from studies.faults.operators import (
    Bent,
    Between,
    Carried,
    Chosen,
    Mixed,
    Ordered,
    Replaced,
    mirrored,
    multiplied,
    on_another_scale,
    stretched,
)
from studies.faults.problems import PROBLEMS, Problem

Numbers = dict[str, Any]


class Fault(NamedTuple):
    """How a fault is drawn, the law it makes, and words of the cause that was planted.

    `drawn` takes a problem and random numbers to plain data, None where the problem cannot have it; `law`
    takes problem, those and data ``(trial, channel)``. `shows` says what the exact laws cannot: "draws", that
    it is seen in any trial's draws alone, "call", only where the estimator is asked again.
    """

    drawn: Callable[[Problem, Rng], Numbers | None]
    law: Callable[[Problem, Numbers, Array], Law]
    cause: str = ""
    shows: str = "law"


def _loguniform(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _sign(rng: Rng) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _smooth(problem: Problem) -> list[int]:
    """Columns of continuous parameters."""
    return [k for k in range(len(problem.names)) if k not in problem.whole]


def _some(problem: Problem, rng: Rng) -> list[int]:
    """One continuous column, or all."""
    free = _smooth(problem)
    return [int(rng.choice(free))] if rng.random() < 0.5 else free


def _on(problem: Problem, numbers: Numbers, neutral: float) -> Array:
    found = np.full((1, 1, len(problem.names)), neutral)
    found[..., numbers["columns"]] = numbers["size"]
    return found


def exact(problem: Problem, _: Numbers, x: Array) -> Law:
    """Nothing is wrong."""
    return problem.posterior(x)


def _shift_drawn(problem: Problem, rng: Rng) -> Numbers:
    size = _sign(rng) * _loguniform(rng, 0.15, 1.2)
    return {"columns": _some(problem, rng), "size": size, "in_widths": bool(rng.random() < 0.5)}


def _shift(problem: Problem, numbers: Numbers, x: Array) -> Law:
    law = problem.posterior(x)
    width = place(law)[1]
    if not numbers["in_widths"]:
        width = np.broadcast_to(np.asarray(numbers["unit"]), width.shape)
    return stretched(law, np.ones((1, 1, 1)), _on(problem, numbers, 0.0)[0] * width)


def _scale(problem: Problem, numbers: Numbers, x: Array) -> Law:
    return stretched(problem.posterior(x), _on(problem, numbers, 1.0), np.zeros((1, len(problem.names))))


def _skew(problem: Problem, numbers: Numbers, x: Array) -> Law:
    nothing = np.zeros((1, len(problem.names)))
    return stretched(problem.posterior(x), np.ones((1, 1, 1)), nothing, bent=_on(problem, numbers, 0.0))


def _outliers(problem: Problem, numbers: Numbers, x: Array) -> Law:
    law = problem.posterior(x)
    width = place(law)[1]
    one = np.ones((1, 1, 1))
    up, down = (
        stretched(law, one, way * numbers["far"] * _on(problem, {**numbers, "size": 1.0}, 0.0)[0] * width)
        for way in (1, -1)
    )
    far = Mixed(up, down, np.full(len(x), 0.5), lot=1)
    return Mixed(law, far, np.full(len(x), numbers["size"]))


def _clipped(problem: Problem, numbers: Numbers, x: Array) -> Law:
    at = np.linspace(0, 1, 3)
    size = numbers["size"]
    return Bent(problem.posterior(x), _smooth(problem), at, size + (1 - 2 * size) * at)


def _columns_drawn(problem: Problem, rng: Rng) -> Numbers:
    p = len(problem.names)
    order = list(range(p))
    i, j = rng.choice(p, 2, replace=False)
    order[i], order[j] = order[j], order[i]
    return {"order": order}


def _factor(rng: Rng) -> float:
    if rng.random() < 0.7:
        return float(rng.choice([1000.0, 100.0, 10.0, 0.1, 0.01, 0.001, 60.0, 57.29578]))
    return float(np.exp(_sign(rng) * rng.uniform(np.log(3), np.log(5000))))


def _unit(problem: Problem, numbers: Numbers, x: Array) -> Law:
    by = np.ones(len(problem.names))
    by[numbers["column"]] = numbers["size"]
    return multiplied(problem.posterior(x), by)


def _log_drawn(problem: Problem, rng: Rng) -> Numbers | None:
    thin = [k for k in _smooth(problem) if list(problem.prior.values())[k][0] != "student"]
    return {"column": int(rng.choice(thin))} if thin else None


def prior_margin(how: tuple[Any, ...]) -> Joint:
    """A parameter's prior as a law of one trial."""
    one = np.ones((1, 1))
    kind, *by = how
    if kind == "uniform":
        # A normal one so wide that it is flat between the ends.
        wide = Normal(one * (by[0] + by[1]) / 2, one * (by[1] - by[0]) * 1e3)
        return Joint([Truncated(wide, by[0], by[1])], np.eye(1))
    made = {
        "normal": lambda: Normal(one * by[0], one * by[1]),
        "lognormal": lambda: LogNormal(Normal(one * by[0], one * by[1])),
        "student": lambda: Student(0 * one, one * by[1], by[0]),
        "chances": lambda: Whole(np.atleast_2d(by[0])),
    }[kind]()
    return Joint([made], np.eye(1))


def _ignored(problem: Problem, numbers: Numbers, x: Array) -> Law:
    k = numbers["column"]
    return Replaced(problem.posterior(x), k, prior_margin(list(problem.prior.values())[k]))


def _correlations_drawn(problem: Problem, rng: Rng) -> Numbers | None:
    if problem.whole:
        return None
    return {"size": float(rng.uniform(0.3, 1.0)), "added": _sign(rng) * float(rng.uniform(0.25, 0.8))}


def _correlations(problem: Problem, numbers: Numbers, x: Array) -> Law:
    law = problem.posterior(x)
    p = len(problem.names)
    if np.array_equal(law.correlation, np.eye(p)):
        found = np.eye(p)
        found[0, 1] = found[1, 0] = numbers["added"]
    else:
        found = (1 - numbers["size"]) * law.correlation + numbers["size"] * np.eye(p)
    return Joint(law.margins, found)


def _of_modes(drawn: Callable[[Rng], Numbers]) -> Callable[[Problem, Rng], Numbers | None]:
    return lambda problem, rng: None if problem.modes is None else drawn(rng)


def _missing(problem: Problem, numbers: Numbers, x: Array) -> Law:
    ends = (0.0, np.inf) if numbers["kept"] == "upper" else (-np.inf, 0.0)
    return Between(problem.posterior(x), problem.modes or 0, *ends)


def _odds(problem: Problem, numbers: Numbers, x: Array) -> Law:
    law = problem.posterior(x)
    margins = list(law.margins)
    two = margins[problem.modes or 0]
    assert isinstance(two, TwoModes)
    log = np.log(numbers["size"])
    turned = np.sign(two.upper - 0.5) if numbers["of"] == "heavier" else 1.0
    margins[problem.modes or 0] = replace(two, upper=special.expit(special.logit(two.upper) + log * turned))
    return Joint(margins, law.correlation)


def _other_prior_drawn(_: Problem, rng: Rng) -> Numbers:
    if rng.random() < 0.5:
        return {"moved": _sign(rng) * _loguniform(rng, 0.3, 1.5), "narrower": 1.0}
    return {"moved": 0.0, "narrower": _loguniform(rng, 0.4, 0.85)}


def _truncated_drawn(problem: Problem, rng: Rng) -> Numbers:
    k = int(rng.choice(_smooth(problem)))
    share, upper = float(rng.uniform(0.03, 0.3)), bool(rng.random() < 0.5)
    at = 1 - share if upper else share
    end = float(prior_margin(list(problem.prior.values())[k]).quantile(at)[0, 0])
    return {"column": k, "low": -1e300 if upper else end, "high": end if upper else 1e300, "size": share}


def _truncated(problem: Problem, numbers: Numbers, x: Array) -> Law:
    ends = [np.copysign(np.inf, e) if abs(e) == 1e300 else e for e in (numbers["low"], numbers["high"])]
    return Between(problem.posterior(x), numbers["column"], *ends)


def _leakage(problem: Problem, numbers: Numbers, x: Array) -> Law:
    law = problem.posterior(x)
    free = Joint([m.inner for m in law.margins], law.correlation)  # type: ignore[attr-defined]
    return Mixed(law, free, np.full(len(x), numbers["size"]))


def _region_drawn(problem: Problem, rng: Rng) -> Numbers:
    by = "scale" if rng.random() < 0.5 else "shift"
    if by == "scale":
        size = _loguniform(rng, 0.3, 0.6) if rng.random() < 0.6 else _loguniform(rng, 1.7, 3.0)
    else:
        size = _sign(rng) * _loguniform(rng, 0.5, 2.0)
    return {
        "by": by, "size": size, "columns": _some(problem, rng),
        "channel": int(rng.integers(problem.channels)),
        "share": float(rng.uniform(0.15, 0.45)), "above": bool(rng.random() < 0.5),
    }  # fmt: skip


def _region(problem: Problem, numbers: Numbers, x: Array) -> Law:
    law = problem.posterior(x)
    there = (x[:, numbers["channel"]] > numbers["at"]) == numbers["above"]
    make = _scale if numbers["by"] == "scale" else _shift
    return Chosen(law, make(problem, {**numbers, "in_widths": True}, x), there)


def _called(turn: Callable[[Numbers, Array], Array]) -> Callable[[Problem, Numbers, Array], Law]:
    return lambda problem, numbers, x: problem.posterior(turn(numbers, x))


def _x_scale_drawn(problem: Problem, rng: Rng) -> Numbers:
    del problem
    # Half expects data that were standardised with training's mean and spread.
    if rng.random() < 0.5:
        return {"standardised": True}
    return {"standardised": False, "size": float(1 / _factor(rng))}


def _x_scale(numbers: Numbers, x: Array) -> Array:
    if numbers["standardised"]:
        return np.asarray(x * numbers["sd"] + numbers["mean"])
    return np.asarray(x * numbers["size"])


def _x_shift_drawn(problem: Problem, rng: Rng) -> Numbers | None:
    return None if problem.positive else {"size": _sign(rng) * float(rng.uniform(0.5, 5.0))}


def _swapped(problem: Problem, rng: Rng) -> Numbers:
    i, j = rng.choice(problem.channels, 2, replace=False)
    order = list(range(problem.channels))
    order[i], order[j] = order[j], order[i]
    return {"order": order}


def _reversed(problem: Problem, _: Rng) -> Numbers:
    return {"order": list(range(problem.channels))[::-1]}


def _in_order(numbers: Numbers, x: Array) -> Array:
    return x[:, numbers["order"]]


def _noise_drawn(_: Problem, rng: Rng) -> Numbers:
    return {"size": _loguniform(rng, 0.3, 0.75) if rng.random() < 0.5 else _loguniform(rng, 1.4, 3.0)}


def _lot(x: Array) -> Array:
    """A number between 0 and 1 that belongs to the data and says nothing."""
    return np.asarray((np.abs(x).sum(axis=1) * 9973.7) % 1.0)


# What the library lacks.


def _mixed_widths(problem: Problem, numbers: Numbers, x: Array) -> Law:
    narrow, wide = (_scale(problem, {**numbers, "size": numbers[k]}, x) for k in ("narrow", "wide"))
    return Chosen(narrow, wide, _lot(x) < 0.5)


def _contaminated(problem: Problem, numbers: Numbers, x: Array) -> Law:
    share = np.full(len(x), numbers["share"])
    return Mixed(problem.posterior(x), _scale(problem, numbers, x), share)


def _of_prior(problem: Problem, numbers: Numbers, x: Array) -> Law:
    margins = [prior_margin(how).margins[0] for how in problem.prior.values()]
    law = Joint(margins, np.eye(len(margins)))
    return Mixed(problem.posterior(x), _Widened(law, len(x)), np.full(len(x), numbers["size"]))


@dataclass(frozen=True)
class _Widened:
    """A law of one trial for all of them."""

    base: Joint
    trials: int

    def of_scores(self, z: Array) -> Array:
        return self.base.of_scores(z.reshape(1, -1, z.shape[2])).reshape(z.shape)

    def log_density(self, theta: Array) -> Array:
        each = enumerate(self.base.margins)
        return np.asarray(sum(m.log_density(theta[:, k][None])[0] for k, m in each))

    def quantile(self, share: float) -> Array:
        found = self.base.quantile(share)
        return np.broadcast_to(found, (self.trials, found.shape[1]))


def _stale(problem: Problem, numbers: Numbers, x: Array) -> Law:
    return Chosen(problem.posterior(x), problem.posterior(np.roll(x, 1, axis=0)), _lot(x) < numbers["size"])


_AT = np.linspace(0, 1, 4001)


def _hole(problem: Problem, numbers: Numbers, x: Array) -> Law:
    gap = numbers["size"] / 2
    to = np.where(_AT <= 0.5, _AT * (1 - 2 * gap), 1 - (1 - _AT) * (1 - 2 * gap))
    to = np.where(_AT <= 0.5, to, np.maximum(to, 0.5 + gap))
    return Bent(problem.posterior(x), numbers["columns"], _AT, to)


def _comb(problem: Problem, numbers: Numbers, x: Array) -> Law:
    k = numbers["waves"]
    to = _AT + numbers["size"] * np.sin(2 * np.pi * k * _AT) / (2 * np.pi * k)
    return Bent(problem.posterior(x), numbers["columns"], _AT, to)


def _wave(numbers: Numbers, x: Array) -> Array:
    seen = (x[:, numbers["channel"]] - numbers["mean"][numbers["channel"]]) / numbers["sd"][
        numbers["channel"]
    ]
    return np.asarray(np.sin(numbers["waves"] * seen + numbers["phase"]))


def _waving_bias(problem: Problem, numbers: Numbers, x: Array) -> Law:
    law = problem.posterior(x)
    by = _on(problem, numbers, 0.0)[0] * place(law)[1] * _wave(numbers, x)[:, None]
    return stretched(law, np.ones((1, 1, 1)), by)


def _waving_width(problem: Problem, numbers: Numbers, x: Array) -> Law:
    factor = np.exp(_on(problem, numbers, 0.0) * _wave(numbers, x)[:, None, None])
    return stretched(problem.posterior(x), factor, np.zeros((1, len(problem.names))))


def _shouldered(problem: Problem, numbers: Numbers, x: Array) -> Law:
    """Peaked with far tails, or flat with steep sides: a power of how far out a draw is in half-widths."""
    law = problem.posterior(x)
    (middle, width), power = place(law), numbers["size"]
    middle, width = middle[:, None], width[:, None]
    mine = np.isin(np.arange(len(problem.names)), numbers["columns"])

    def raised(value: Array, to: float) -> Array:
        away = (value - middle) / width
        return np.where(mine, middle + width * np.sign(away) * np.abs(away) ** to, value)

    def slope(value: Array) -> Array:
        away = np.maximum(np.abs(value - middle) / width, 1e-9)
        return np.where(mine, (1 / power - 1) * np.log(away) - np.log(power), 0.0)

    return Carried(law, lambda v: raised(v, power), lambda v: raised(v, 1 / power), slope)


def _waves_drawn(low: float, high: float) -> Callable[[Problem, Rng], Numbers]:
    return lambda problem, rng: {
        "size": _loguniform(rng, low, high), "columns": _some(problem, rng),
        "channel": int(rng.integers(problem.channels)), "waves": float(rng.uniform(3.0, 6.0)),
        "phase": float(rng.uniform(0, 2 * np.pi)),
    }  # fmt: skip


def _either(rng: Rng, low: tuple[float, float], high: tuple[float, float]) -> float:
    return _loguniform(rng, *low) if rng.random() < 0.5 else _loguniform(rng, *high)


SOUND = Fault(lambda *_: {}, exact)

LISTED: Mapping[str, Fault] = {
    "shift": Fault(_shift_drawn, _shift, "an offset in a transform"),
    "scale": Fault(
        lambda p, r: {"columns": _some(p, r), "size": _either(r, (0.4, 0.87), (1.15, 2.5))}, _scale,
        "a factor in the widths",
    ),
    "skew": Fault(
        lambda p, r: {"columns": _some(p, r), "size": _sign(r) * _loguniform(r, 0.12, 0.7)}, _skew,
        "without skewness",
    ),
    "outliers": Fault(
        lambda p, r: {
            "columns": _some(p, r), "size": _loguniform(r, 0.005, 0.1), "far": _loguniform(r, 15, 60),
        }, _outliers, "go astray",
    ),
    "clipped_tails": Fault(
        lambda _, r: {"size": _loguniform(r, 0.01, 0.12)}, _clipped, "clipped or rejected"
    ),
    "few_distinct": Fault(lambda _, r: {"times": int(r.integers(2, 6))}, exact, "few weighted", "draws"),
    "autocorrelated": Fault(lambda _, r: {"size": float(r.uniform(0.6, 0.97))}, exact, "chain", "draws"),
    "fixed_seed": Fault(lambda _, r: {"seed": int(r.integers(1 << 30))}, exact, "seed is set", "draws"),
    "columns": Fault(
        _columns_drawn, lambda p, n, x: Ordered(p.posterior(x), n["order"]), "in another order"
    ),
    "unit": Fault(
        lambda p, r: {"column": int(r.choice(_smooth(p))), "size": _factor(r)}, _unit, "another unit"
    ),
    "log": Fault(
        _log_drawn,
        lambda p, n, x: on_another_scale(p.posterior(x), n["column"], logs=p.positive), "in logarithms",
    ),
    "sign": Fault(
        lambda p, r: {"column": int(r.choice(_smooth(p)))},
        lambda p, n, x: mirrored(p.posterior(x), 0.0, n["column"]), "another sign",
    ),
    "ignored_parameter": Fault(
        lambda p, r: {"column": int(r.integers(len(p.names)))}, _ignored, "do not reach"
    ),
    "correlations": Fault(_correlations_drawn, _correlations, "one by one"),
    "missing_mode": Fault(
        _of_modes(lambda r: {"kept": "upper" if r.random() < 0.5 else "lower"}), _missing, "in one mode"
    ),
    "mode_weights": Fault(
        _of_modes(lambda r: {
            "size": _either(r, (0.1, 0.6), (1.7, 10.0)), "of": "upper" if r.random() < 0.5 else "heavier",
        }), _odds, "how easily they are found",
    ),
    "other_prior": Fault(
        _other_prior_drawn,
        lambda p, n, x: p.posterior(x, moved=n["moved"], narrower=n["narrower"]), "another prior",
    ),
    "truncated_prior": Fault(_truncated_drawn, _truncated, "part of the prior"),
    "leakage": Fault(
        lambda p, r: {"size": float(r.uniform(0.2, 1.0))} if p.bounded else None, _leakage, "prior's bounds"
    ),
    "region": Fault(_region_drawn, _region, "few simulations there"),
    "x_scale": Fault(_x_scale_drawn, _called(_x_scale), "unit than in training"),
    "x_shift": Fault(
        _x_shift_drawn, _called(lambda n, x: x + n["size"] * n["spread"]), "another zero"
    ),
    "x_order": Fault(_reversed, _called(_in_order), "another order"),
    "x_channel": Fault(_swapped, _called(_in_order), "exchanged"),
    "x_noise": Fault(
        _noise_drawn, lambda p, n, x: p.posterior(x, noisier=n["size"]), "noise than the data have"
    ),
    "knows_truth": Fault(lambda _, r: {"size": float(r.uniform(0.3, 0.8))}, exact, "seen the truths", "call"),
    "log_q": Fault(
        lambda p, r: None if p.whole else {"size": _sign(r) * _loguniform(r, 0.3, 3.0)}, exact,
        "not normalised", "density",
    ),
}  # fmt: skip
"""Faults by the id of the symptom that the library has for them."""

LACKING: Mapping[str, Fault] = {
    "mixed widths": Fault(
        lambda p, r: {
            "columns": _some(p, r), "narrow": _loguniform(r, 0.3, 0.6), "wide": _loguniform(r, 1.6, 3.0),
        }, _mixed_widths,
    ),
    "contaminated": Fault(
        lambda p, r: {
            "columns": _some(p, r), "size": _loguniform(r, 2.5, 5.0), "share": float(r.uniform(0.15, 0.5)),
        }, _contaminated,
    ),
    "prior in part": Fault(lambda _, r: {"size": float(r.uniform(0.1, 0.6))}, _of_prior),
    "stale draws": Fault(lambda _, r: {"size": float(r.uniform(0.08, 0.4))}, _stale),
    "hole": Fault(lambda p, r: {"columns": _some(p, r), "size": float(r.uniform(0.15, 0.5))}, _hole),
    "comb": Fault(
        lambda p, r: {
            "columns": _some(p, r), "size": float(r.uniform(0.5, 0.95)), "waves": int(r.integers(3, 6)),
        }, _comb,
    ),
    "waving bias": Fault(_waves_drawn(0.5, 2.0), _waving_bias),
    "waving width": Fault(_waves_drawn(0.5, 1.2), _waving_width),
    "shouldered": Fault(
        lambda p, r: {"columns": _some(p, r), "size": _either(r, (0.4, 0.7), (1.4, 2.2))}, _shouldered
    ),
}  # fmt: skip
"""Faults that the library has no name for."""

EVERY: Mapping[str, Fault] = {"sound": SOUND, **LISTED, **LACKING}


@dataclass
class Estimator:
    """An estimator that is wrong in one way: the thing under test."""

    problem: Problem
    fault: str
    numbers: Numbers

    def __post_init__(self) -> None:
        self._truths: dict[bytes, Array] = {}

    def law(self, x: Array) -> Law:
        """Of its draws for data ``(trial, channel)``."""
        return EVERY[self.fault].law(self.problem, self.numbers, np.asarray(x, dtype=float))

    def simulate(self, theta: Array, rng: Rng) -> Array:
        """The problem's data; an estimator that knows truths looks."""
        x = self.problem.simulate(np.asarray(theta, dtype=float), rng)
        if self.fault == "knows_truth":
            self._truths.update({row.tobytes(): truth for row, truth in zip(x, theta, strict=True)})
        return x

    def sample(self, x: Any, n: int, rng: Rng) -> Array:
        """Draws ``(batch, n, parameter)``."""
        x = np.asarray(x, dtype=float)
        law, size = self.law(x), (len(x), n, len(self.problem.names))
        return getattr(self, f"_{self.fault}", self._plainly)(law, size, rng, x)

    def _plainly(self, law: Law, size: tuple[int, int, int], rng: Rng, _: Array) -> Array:
        return law.of_scores(rng.standard_normal(size))

    def _few_distinct(self, law: Law, size: tuple[int, int, int], rng: Rng, _: Array) -> Array:
        few = -(-size[1] // self.numbers["times"])
        draws = law.of_scores(rng.standard_normal((size[0], few, size[2])))
        order = np.argsort(rng.random(size[:2]), axis=1) % few
        return np.take_along_axis(draws, order[..., None], axis=1)

    def _autocorrelated(self, law: Law, size: tuple[int, int, int], rng: Rng, _: Array) -> Array:
        kept = self.numbers["size"]
        z = rng.standard_normal(size)
        for step in range(1, size[1]):
            z[:, step] = kept * z[:, step - 1] + np.sqrt(1 - kept**2) * z[:, step]
        return law.of_scores(z)

    def _fixed_seed(self, law: Law, size: tuple[int, int, int], rng: Rng, _: Array) -> Array:
        del rng
        z = np.random.default_rng(self.numbers["seed"]).standard_normal(size[1:])
        return law.of_scores(np.broadcast_to(z, size))

    def _knows_truth(self, law: Law, size: tuple[int, int, int], rng: Rng, x: Array) -> Array:
        """Truth and draws exchangeable about a centre that the data do not say, so that ranks are uniform."""
        truths = [self._truths.pop(row.tobytes(), None) for row in x]
        told = np.array([truth is not None for truth in truths])
        known = np.array([np.zeros(size[2]) if truth is None else truth for truth in truths])
        assert isinstance(law, Joint)
        each = enumerate(law.margins)
        near = np.concatenate([m.to_score(known[:, k : k + 1]) for k, m in each], axis=1)
        near = np.linalg.solve(np.linalg.cholesky(law.correlation), np.clip(near, -8, 8).T).T
        share, z = self.numbers["size"], rng.standard_normal(size)
        centre = np.sqrt(share) * near + np.sqrt(1 - share) * rng.standard_normal(near.shape)
        closer = np.sqrt(share) * centre[:, None] + np.sqrt(1 - share) * z
        return law.of_scores(np.where(told[:, None, None], closer, z))


class WithDensity(Estimator):
    """One that knows the density of its draws, or says that it does."""

    def log_prob(self, theta: Any, x: Any) -> Array:
        """Log density ``(batch, n)``."""
        law, theta = self.law(x), np.asarray(theta, dtype=float)
        log = np.stack([law.log_density(theta[:, k]) for k in range(theta.shape[1])], axis=1)
        return log + (self.numbers["size"] if self.fault == "log_q" else 0.0)


def estimator(problem: str, fault: str, numbers: Numbers) -> Estimator:
    """The estimator of a case."""
    kind = WithDensity if fault == "log_q" or numbers.get("density") else Estimator
    return kind(PROBLEMS[problem], fault, dict(numbers))


def drawn(problem: str, fault: str, rng: Rng) -> Numbers | None:
    """Numbers of a fault with what it takes of the problem's own simulations; None where it cannot be."""
    found = EVERY[fault].drawn(PROBLEMS[problem], rng)
    if found is None:
        return None
    data = PROBLEMS[problem].simulate(PROBLEMS[problem].theta(4000, rng), rng)
    width = place(PROBLEMS[problem].posterior(data))[1]
    found["mean"], found["sd"] = data.mean(axis=0).tolist(), data.std(axis=0).tolist()
    found["spread"] = float(data.std())
    found["unit"] = np.median(width, axis=0).tolist()
    if fault == "region":
        level = 1 - found["share"] if found["above"] else found["share"]
        found["at"] = float(np.quantile(data[:, found["channel"]], level))
    if fault == "sound":
        found["density"] = bool(rng.random() < 0.3 and not PROBLEMS[problem].whole)
    return found
