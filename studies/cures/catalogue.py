"""What is wrong with recipes, which causes that is, and what each cure of the library's puts right in one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.cures.training import PROBLEMS, Recipe, Rng

PRIOR = ("prior_sd", "prior_shift", "part")
NOT_SCALED = "x is not scaled"
"""How the diagnosis begins, where it has seen the data's standard deviations."""

UNDERTRAINED = (
    "undertrained",
    "undertrained, or not trained at all",
    "training stopped early or at a poor optimum",
)
FACTOR = (
    "a factor in the widths (variance for standard deviation, temperature)",
    "a factor in the widths (standard deviation for variance, temperature)",
)
PUTS_RIGHT: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(UNDERTRAINED, ("steps",)),
    **dict.fromkeys(FACTOR, ("temperature",)),
    "trained on simulations of another simulator or version": ("version",),
    "called with another zero than in training": ("version",),
    "an offset in a transform of the parameters": ("theta_shift",),
    "overfitted": ("bank",),
    "trained with less noise than the data have": ("noise",),
    "trained with more noise than the data have": ("noise",),
    "parameters in another order": ("columns",),
    "another unit": ("theta_unit",),
    "the data do not reach the network": ("scaled",),
    NOT_SCALED: ("scaled",),
    "trained on data that were not scaled": ("scaled",),
    "trained on another prior": PRIOR,
    "trained on a part of the prior": PRIOR,
    "a flow that does not know the prior's bounds": ("bounded",),
    "called with data in another unit than in training": ("called_unit",),
    "called with data in another order than in training": ("channels",),
    "channels are exchanged": ("channels",),
    "a seed is set inside sample()": ("fixed_seed",),
}
"""By cause; of all others nothing in a recipe can be put right: its user would look, and find nothing."""


def cured(recipe: Recipe, causes: list[str]) -> Recipe:
    """The recipe with everything put right that these causes name, one look at each."""
    known = [next((key for key in PUTS_RIGHT if cause.startswith(key)), None) for cause in causes]
    return recipe.right(tuple(name for key in known if key for name in PUTS_RIGHT[key]))


def _either(rng: Rng, low: tuple[float, float], high: tuple[float, float]) -> float:
    return float(rng.uniform(*(low if rng.random() < 0.5 else high)))


def _prior(rng: Rng) -> dict[str, Any]:
    if rng.random() < 0.5:
        return {"prior_sd": _either(rng, (0.5, 0.7), (1.5, 2.0))}
    return {"prior_shift": float(rng.uniform(0.7, 1.5))}


@dataclass(frozen=True)
class Fault:
    """What is drawn of a recipe, and the symptoms and causes that are right to name."""

    drawn: Callable[[Rng], dict[str, Any]]
    symptoms: tuple[str, ...]
    causes: tuple[str, ...]


FAULTS: Mapping[str, Fault] = {
    "another prior": Fault(_prior, ("other_prior",), ("trained on another prior",)),
    "part of the prior": Fault(
        lambda rng: {"part": float(rng.uniform(0.5, 0.8))},
        ("truncated_prior", "other_prior"),
        ("trained on a part of the prior", "trained on another prior"),
    ),
    "data not scaled": Fault(
        lambda _: {"scaled": False},
        ("ignored_parameter", "scale", "x_scale", "few_distinct"),
        (NOT_SCALED, "the data do not reach the network", "trained on data that were not scaled"),
    ),
    "too few steps": Fault(
        lambda rng: {"steps": int(rng.integers(20, 81))},
        ("ignored_parameter", "scale", "shift", "skew", "correlations"),
        UNDERTRAINED,
    ),
    "few simulations": Fault(
        lambda rng: {"bank": int(rng.integers(100, 401))}, ("scale", "x_noise"), ("overfitted",)
    ),
    "another noise": Fault(
        lambda rng: {"noise": _either(rng, (0.4, 0.7), (1.5, 2.2))},
        ("x_noise", "scale"),
        (
            "trained with less noise than the data have",
            "trained with more noise than the data have",
        ),
    ),
    "another version": Fault(
        lambda rng: {"version": float(rng.choice([-1, 1]) * rng.uniform(0.5, 1.5))},
        ("shift", "x_shift"),
        (
            "trained on simulations of another simulator or version",
            "called with another zero than in training",
        ),
    ),
    "columns": Fault(lambda _: {"columns": True}, ("columns",), ("parameters in another order",)),
    "channels": Fault(
        lambda _: {"channels": True},
        ("x_order", "x_channel"),
        ("called with data in another order than in training", "channels are exchanged"),
    ),
    "unit of the data": Fault(
        lambda rng: {"called_unit": _either(rng, (0.5, 0.8), (1.25, 2.0))},
        ("x_scale",),
        ("called with data in another unit than in training",),
    ),
    "temperature": Fault(
        lambda rng: {"temperature": _either(rng, (0.6, 0.8), (1.3, 1.6))}, ("scale",), FACTOR
    ),
    "unit of the parameters": Fault(
        lambda rng: {"theta_unit": float(10 ** _either(rng, (-1.0, -0.2), (0.2, 1.0)))},
        ("unit",),
        ("another unit",),
    ),
    "offset": Fault(
        lambda rng: {"theta_shift": float(rng.choice([-1, 1]) * rng.uniform(0.3, 1.0))},
        ("shift",),
        ("an offset in a transform of the parameters",),
    ),
    "fixed seed": Fault(lambda _: {"fixed_seed": True}, ("fixed_seed",), ("a seed is set inside sample()",)),
    "bounds": Fault(
        lambda _: {"bounded": False}, ("leakage",), ("a flow that does not know the prior's bounds",)
    ),
}
"""Fixed before any case was drawn. Where draws of several symptoms are the same, all of them are right."""


@dataclass(frozen=True)
class Case:
    """A mistrained flow: its recipe, and the seeds of training, audit, second trainings and their audits."""

    number: int
    fault: str
    problem: str
    unit: float
    recipe: Recipe
    seeds: tuple[int, int, int, int]


def cases(number: int, seed: int) -> list[Case]:
    """So many cases, every fault equally often up to one; the first of them are a smaller set's cases.

    >>> [one.fault for one in cases(2, 1)] == [one.fault for one in cases(20, 1)[:2]]
    True
    """
    rng, made, round_of = np.random.default_rng(seed), [], list[str]()
    for k in range(number):
        round_of = round_of or [str(name) for name in rng.permutation(list(FAULTS))]
        fault = round_of.pop()
        problems = [name for name in PROBLEMS if PROBLEMS[name].uniform or fault != "bounds"]
        problem = str(rng.choice(problems))
        unit = float(10 ** rng.uniform(2.5, 4.0)) if fault == "data not scaled" else 1.0
        recipe = Recipe(**FAULTS[fault].drawn(rng))
        seeds = tuple(int(value) for value in rng.integers(2**31, size=4))
        made.append(Case(k, fault, problem, unit, recipe, seeds))  # type: ignore[arg-type]
    return made
