"""A small epidemic: susceptible, infected, removed, and Poisson counts of reported cases a week."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.core.values import Shown
from gaugeblock.simulators._poisson_grid import ATTEMPTS, PoissonGrid
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.epidemic.with_effects import EpidemicWithEffects
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.marginals import LogUniform
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.segments import Segment


class Epidemic(Shown):
    """Weekly reported cases of a deterministic SIR epidemic, Poisson about ``reported`` x new infections.

    With s and i the susceptible and infected shares of the population, ds/dt = -contact_rate s i and
    di/dt = contact_rate s i - recovery_rate i (rates per day), integrated by fourth-order Runge-Kutta steps
    of half a day, for a whole batch at once. Both rates are log-uniform. Given the rates the trajectory is
    fixed, so the likelihood is exact; the posterior of the two rates comes from a dense grid of `nodes`^2
    points, corrected by rejection, and the evidence from the trapezoid rule on it. With an effect the
    posterior has more parameters and no such grid.

    >>> simulator = Epidemic(nodes=65)
    >>> simulator.expected([[0.4, 0.1]]).shape
    (1, 12)

    Raises
    ------
    InputError
        If a number is not positive, or `reported` or the infected share exceeds 1.

    References
    ----------
    Kermack & McKendrick (1927), Proc. R. Soc. A 115, 700.
    """

    def __init__(
        self,
        *,
        weeks: int = 12,
        population: float = 2000.0,
        infected: float = 5.0,
        reported: float = 0.2,
        nodes: int = 257,
    ):
        if not (weeks >= 1 and 0 < infected < population and 0 < reported <= 1 and nodes >= 3):
            raise InputError(
                "epidemic: needs weeks >= 1, 0 < infected < population, 0 < reported <= 1 and nodes >= 3, "
                f"got {weeks=}, {infected=}, {population=}, {reported=}, {nodes=}"
            )
        settings = {
            "weeks": int(weeks),
            "population": float(population),
            "infected": float(infected),
            "reported": float(reported),
        }
        prior = Prior({"contact_rate": LogUniform(0.1, 1.0), "recovery_rate": LogUniform(0.05, 0.5)})
        self._nodes, self._settings, self._plain = int(nodes), settings, EpidemicWithEffects(settings, prior)

    @property
    def prior(self) -> Prior:
        """Log-uniform rates per day."""
        return self._plain.prior

    def expected(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Mean reported cases of each week, ``(..., weeks)``."""
        return self._plain.expected(theta)

    def expected_jax(self, theta: Any) -> Any:
        """The same on JAX arrays, traceable."""
        return self._plain.expected_jax(theta)

    def jacobian(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Derivative of the expected cases by the rates, ``(..., weeks, 2)``."""
        return self._plain.jacobian(theta)

    def observe(self, expected: ArrayLike, rng: Rng) -> NDArray[np.int64]:
        """Poisson counts with the given means."""
        return self._plain.observe(expected, rng)

    def simulate(self, theta: ArrayLike, rng: Rng) -> NDArray[np.int64]:
        """Reported cases for each row of theta, ``(n, weeks)``."""
        return self._plain.simulate(theta, rng)

    def log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Poisson log probability of x given theta, leading axes broadcast."""
        return self._plain.log_likelihood(theta, x)

    def log_likelihood_jax(self, theta: Any, x: Any) -> Any:
        """The same on JAX arrays, traceable."""
        return self._plain.log_likelihood_jax(theta, x)

    def with_effect(self, effect: Effect) -> EpidemicWithEffects:
        """The epidemic with an effect, and without the posterior's grid."""
        return self._plain.with_effect(effect)

    def effect_library(self, theta: ArrayLike) -> dict[str, LibraryEffect]:
        """What discovery may propose, additive effects scaled by the cases at theta ``(n, parameter)``."""
        return self._plain.effect_library(theta)

    def segments(self) -> tuple[Segment, ...]:
        """The data are one run of weeks."""
        return self._plain.segments()

    @cached_property
    def _grid(self) -> PoissonGrid:
        return PoissonGrid(self.prior, self.expected, self._nodes)

    def posterior_sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        """Independent posterior draws, ``(batch, n, 2)``."""
        counts = self._plain.data(x)
        return self._grid.sample(counts, rng.random((len(counts), n, ATTEMPTS, 3)))

    def log_evidence(self, x: ArrayLike) -> NDArray[np.float64]:
        """Log probability of x with theta integrated over the prior, ``(batch,)``."""
        return self._grid.log_evidence(self._plain.data(x))

    def posterior_log_prob(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Log posterior density, ``(batch, n)`` for theta ``(batch, n, 2)``; -inf outside the prior."""
        points, counts = np.asarray(theta, dtype=float), self._plain.data(x)
        inside = self.prior.contains(points)
        safe = np.where(inside[..., None], points, self.prior.center)
        joint = self.log_likelihood(safe, counts[:, None]) + self.prior.log_prob(safe)
        return np.asarray(np.where(inside, joint, -np.inf) - self.log_evidence(counts)[:, None])

    def describe(self) -> dict[str, Any]:
        """Everything that defines it."""
        return {"simulator": "epidemic", **self._settings, "nodes": self._nodes}
