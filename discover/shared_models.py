"""Models that all sources of a catalogue share: named effects, a smooth correction, random shapes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.discover.confirm.held_out_sources import SharedModel, Trained
from gaugeblock.discover.fit import Fit, fit
from gaugeblock.discover.name.score import projection, scores
from gaugeblock.discover.name.shared import Term, fit_held, share
from gaugeblock.discover.name.shared_profile import profile_shared
from gaugeblock.discover.name.unnamed import curves
from gaugeblock.discover.sources import Sources
from gaugeblock.simulators.protocol import can

Array = NDArray[np.float64]

SIZE = 0.1
"""Prior standard deviation of the log of a shared smooth correction, at each of its curves."""


def before() -> SharedModel:
    """The model as it was given."""
    return SharedModel(lambda _groups, _fits: lambda _tested, found: found, "before")


def effect_model(terms: Sequence[Term], kind: str, start: Array) -> SharedModel:
    """Effects with shared amplitudes, the first of them profiled with all others."""

    def train(groups: Sequence[Sources], fits: Sequence[Fit]) -> Trained:
        phi = profile_shared(groups, terms[0], terms[1:], start=start, fits=fits).phi

        def judge(tested: Sequence[Sources], found: Sequence[Fit]) -> list[Fit]:
            return [
                fit_held(share(one.simulator, terms), one, phi, old.theta)
                for one, old in zip(tested, found, strict=True)
            ]

        return judge

    return SharedModel(train, kind)


@dataclass(frozen=True, eq=False)
class Multiplied:
    """A simulator whose expected counts are multiplied by a fixed factor ``(channel,)``."""

    simulator: Any
    factor: Array

    def __post_init__(self) -> None:
        if can(self.simulator, "jacobian"):
            object.__setattr__(self, "jacobian", self._jacobian)

    @property
    def prior(self) -> Any:
        """The simulator's own."""
        return self.simulator.prior

    def expected(self, theta: Any) -> Array:
        """Expected counts ``(..., channel)``."""
        return np.asarray(self.simulator.expected(theta) * self.factor)

    def _jacobian(self, theta: Any) -> Array:
        return np.asarray(self.simulator.jacobian(theta) * self.factor[:, None])


def curve_model(shapes: Array, size: float, kind: str) -> SharedModel:
    """``exp(shapes @ b)`` on every source, b from one Gauss-Newton step over all training sources.

    `shapes` is ``(channel, curve)``; b has a Gaussian prior of standard deviation `size`.
    """

    def train(groups: Sequence[Sources], fits: Sequence[Fit]) -> Trained:
        log_factor = shapes @ shared_step(groups, fits, shapes, size)[0]

        def judge(tested: Sequence[Sources], found: Sequence[Fit]) -> list[Fit]:
            return [
                fit(
                    Multiplied(one.simulator, np.exp(log_factor)),
                    one.counts,
                    scale=one.scale,
                    start=old.theta,
                )
                for one, old in zip(tested, found, strict=True)
            ]

        return judge

    return SharedModel(train, kind)


def shared_step(
    groups: Sequence[Sources], fits: Sequence[Fit], shapes: Array, size: float
) -> tuple[Array, Array]:
    """Coefficients ``(curve,)`` of shared log factors, one step from 0, and their covariance."""
    score = np.zeros(shapes.shape[1])
    information = np.eye(shapes.shape[1]) / size**2
    for group, found in zip(groups, fits, strict=True):
        values = found.expected[:, None] * shapes.T
        tested = scores(group.counts, found, values)
        score += tested.score.sum(axis=0)
        projected = projection(found)(values)
        information += np.einsum(
            "ntc,nuc->tu", projected, values / np.sqrt(found.expected)[:, None], optimize=True
        )
    covariance = np.asarray(np.linalg.inv(information), dtype=float)
    return covariance @ score, covariance


def smooth_model(groups: Sequence[Sources]) -> SharedModel | None:
    """`unnamed`: a smooth correction in channel space; None where responses differ."""
    if len(groups) != 1:
        return None
    shapes = curves(groups[0].simulator, groups[0].counts.shape[1])
    return curve_model(shapes, SIZE, "unnamed") if shapes.shape[1] else None


def random_models(
    groups: Sequence[Sources], *, number: int, rng: np.random.Generator
) -> dict[str, SharedModel]:
    """Random smooth shapes in channel space, each with one free amplitude."""
    if len(groups) != 1:
        return {}
    basis = curves(groups[0].simulator, groups[0].counts.shape[1])
    if not basis.shape[1]:
        return {}
    return {
        f"random {i + 1}": curve_model(basis @ rng.normal(size=(basis.shape[1], 1)), 1.0, "random")
        for i in range(number)
    }
