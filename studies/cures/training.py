"""Small flows that are really trained, each by a recipe in which one thing may be wrong."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import torch
import zuko
from scipy import special

import gaugeblock as gb
from gaugeblock.core.arrays import Array

BATCH, RATE, HIDDEN, TRANSFORMS = 512, 3e-3, (48, 48), 3
"""Of every training."""

Rng = np.random.Generator


@dataclass(frozen=True)
class Problem:
    """What is expected of data ``(n, channel)`` in noise of sd `noise`; priors are standard normal ones.

    `uniform` says that parameters are the normal distribution's shares of those, and so within 0 and 1.
    """

    parameters: tuple[str, ...]
    expected: Callable[[Array], Array]
    noise: float
    uniform: bool = False


def _line(theta: Array) -> Array:
    return theta[:, :1] + theta[:, 1:] * np.linspace(-1.0, 1.0, 6)


def _decay(theta: Array) -> Array:
    return np.asarray(np.exp(0.5 * theta[:, :1] - np.exp(0.5 * theta[:, 1:]) * np.linspace(0.2, 2.0, 6)))


def _bump(theta: Array) -> Array:
    place = (np.linspace(-2.0, 2.0, 10) - 0.7 * theta[:, 1:2]) / np.exp(0.3 * theta[:, 2:])
    return np.asarray(np.exp(0.4 * theta[:, :1]) * np.exp(-(place**2) / 2))


PROBLEMS: Mapping[str, Problem] = {
    "line": Problem(("level", "slope"), _line, 0.8),
    "decay": Problem(("amplitude", "rate"), _decay, 0.1),
    "bump": Problem(("height", "place", "width"), _bump, 0.2),
    "mixing": Problem(("first", "second"), _line, 0.8, uniform=True),
}


@dataclass(frozen=True)
class Recipe:
    """How a flow is trained and called; the defaults are right.

    `prior_sd`, `prior_shift` and `part` are of the prior that is simulated from (its standard deviation, its
    middle, the central share that is used), `noise` a factor, `version` an offset of all data in its sd.
    `scaled` standardises data; `steps`; `bank` simulations that are used again and again, or 0 for new ones.
    `bounded` tells the flow a uniform prior's ends. The others are of its calls: parameters or channels
    reversed, data times `called_unit`, draws stretched about the flow's middle by `temperature`, parameters
    times `theta_unit` and moved by `theta_shift` prior sd, the same random numbers in every call.
    """

    prior_sd: float = 1.0
    prior_shift: float = 0.0
    part: float = 1.0
    noise: float = 1.0
    version: float = 0.0
    scaled: bool = True
    steps: int = 900
    bank: int = 0
    bounded: bool = True
    columns: bool = False
    channels: bool = False
    called_unit: float = 1.0
    temperature: float = 1.0
    theta_unit: float = 1.0
    theta_shift: float = 0.0
    fixed_seed: bool = False

    def right(self, names: tuple[str, ...]) -> Recipe:
        """The recipe with some things as they should be."""
        return replace(self, **{one.name: one.default for one in fields(self) if one.name in names})


@dataclass(frozen=True)
class Simulator:
    """What users would have: a prior, and data in a unit that nobody has scaled."""

    problem: Problem
    unit: float

    @property
    def prior(self) -> gb.Prior:
        """Independent standard normal, or uniform, parameters."""
        one: Any = gb.Uniform(0.0, 1.0) if self.problem.uniform else gb.Normal(0.0, 1.0)
        return gb.Prior(dict.fromkeys(self.problem.parameters, one))

    def simulate(self, theta: Array, rng: Rng) -> Array:
        """Data ``(n, channel)`` of parameters ``(n, parameter)``."""
        return self.of_scores(special.ndtri(theta) if self.problem.uniform else theta, rng)

    def of_scores(self, scores: Array, rng: Rng, *, noise: float = 1.0, version: float = 0.0) -> Array:
        """The same of normal scores, in other noise, or with an offset."""
        clean = self.problem.expected(scores)
        sd = self.problem.noise
        return np.asarray(self.unit * (clean + version * sd + noise * sd * rng.standard_normal(clean.shape)))


class Trained:
    """A flow that was trained by a recipe, as an estimator: ``sample(x, n, rng)``."""

    def __init__(self, simulator: Simulator, recipe: Recipe, seed: int) -> None:
        self.simulator, self.recipe = simulator, recipe
        self.parameter_names = simulator.problem.parameters
        self._rng = np.random.default_rng(seed)
        self._fixed = int(self._rng.integers(2**31))
        theta, x = self._simulated(20_000)
        middle, sd = x.mean(axis=0), x.std(axis=0)
        self._scaling = (middle, sd) if recipe.scaled else (np.zeros(len(sd)), np.ones(len(sd)))
        self._location = theta.mean(axis=0), theta.std(axis=0)
        self._flow = self._train(x.shape[1])

    def _scores(self, number: int) -> Array:
        recipe, p = self.recipe, len(self.parameter_names)
        outside = (1 - recipe.part) / 2
        share = outside + recipe.part * self._rng.random((number, p))
        return np.asarray(recipe.prior_shift + recipe.prior_sd * special.ndtri(share))

    def _simulated(self, number: int) -> tuple[Array, Array]:
        """Parameters in the flow's coordinates, and data."""
        scores = self._scores(number)
        x = self.simulator.of_scores(scores, self._rng, noise=self.recipe.noise, version=self.recipe.version)
        uniform = self.simulator.problem.uniform and not self.recipe.bounded
        return (special.ndtr(scores) if uniform else scores), x

    def _train(self, channels: int) -> Any:
        recipe = self.recipe
        torch.set_num_threads(1)
        with torch.random.fork_rng():
            torch.manual_seed(int(self._rng.integers(2**31)))
            flow = zuko.flows.MAF(
                len(self.parameter_names), channels, transforms=TRANSFORMS, hidden_features=HIDDEN
            )
        optimiser = torch.optim.Adam(flow.parameters(), lr=RATE)
        kept = self._simulated(recipe.bank) if recipe.bank else None
        for step in range(recipe.steps):
            for group in optimiser.param_groups:
                group["lr"] = RATE * 0.5 * (1 + math.cos(math.pi * step / recipe.steps))
            if kept is None:
                theta, x = self._simulated(BATCH)
            else:
                rows = self._rng.integers(0, recipe.bank, min(BATCH, recipe.bank))
                theta, x = kept[0][rows], kept[1][rows]
            middle, sd = self._location
            loss = -flow(self._seen(x)).log_prob(_tensor((theta - middle) / sd)).mean()
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(flow.parameters(), 5.0)
            optimiser.step()
        return flow

    def _seen(self, x: Array) -> torch.Tensor:
        middle, sd = self._scaling
        return _tensor((x - middle) / sd)

    @torch.no_grad()
    def sample(self, x: Array, n: int, rng: Rng) -> Array:
        """Draws ``(batch, n, parameter)`` for data ``(batch, channel)``."""
        recipe = self.recipe
        if recipe.fixed_seed:
            rng = np.random.default_rng(self._fixed)
        x = np.asarray(x, dtype=float) * recipe.called_unit
        if recipe.channels:
            x = x[:, ::-1]
        base = recipe.temperature * rng.standard_normal((n, len(x), len(self.parameter_names)))
        if recipe.fixed_seed:
            base[:] = base[:, :1]
        found = self._flow(self._seen(x)).transform.inv(_tensor(base)).numpy().astype(float)
        middle, sd = self._location
        found = np.swapaxes(found, 0, 1) * sd + middle
        if self.simulator.problem.uniform and recipe.bounded:
            found = special.ndtr(found)
        found = recipe.theta_unit * found + recipe.theta_shift
        return np.asarray(found[..., ::-1] if recipe.columns else found)


def _tensor(values: Array) -> torch.Tensor:
    return torch.as_tensor(np.ascontiguousarray(values), dtype=torch.float32)
