"""A small epidemic: susceptible, infected, removed, and Poisson counts of reported cases a week."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.errors import InputError
from gaugeblock.simulators._poisson_grid import ATTEMPTS, PoissonGrid
from gaugeblock.simulators._shapes import data_array
from gaugeblock.simulators.marginals import LogUniform
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.protocol import poisson_log_likelihood
from gaugeblock.streams import Rng

STEPS_PER_WEEK = 14


class Epidemic:
    """Weekly reported cases of a deterministic SIR epidemic, Poisson about ``reported`` x new infections.

    With s and i the susceptible and infected shares of the population, ds/dt = -contact_rate s i and
    di/dt = contact_rate s i - recovery_rate i (rates per day), integrated by fourth-order Runge-Kutta steps
    of half a day, for a whole batch at once. Both rates are log-uniform. Given the rates the trajectory is
    fixed, so the likelihood is exact; the posterior of the two rates comes from a dense grid of `nodes`^2
    points, corrected by rejection, and the evidence from the trapezoid rule on it.

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
        self._weeks, self._nodes = int(weeks), int(nodes)
        self._population, self._infected, self._reported = float(population), float(infected), float(reported)
        self._prior = Prior({"contact_rate": LogUniform(0.1, 1.0), "recovery_rate": LogUniform(0.05, 0.5)})

    @property
    def prior(self) -> Prior:
        """Log-uniform rates per day."""
        return self._prior

    def expected(self, theta: ArrayLike) -> NDArray[np.float64]:
        """Mean reported cases of each week, ``(..., weeks)``."""
        rates = np.asarray(theta, dtype=float)
        contact, recovery = rates[..., 0].copy(), rates[..., 1].copy()
        case, infected = self._start(np.zeros_like(contact))
        weekly = np.empty((*contact.shape, self._weeks))
        for week in range(self._weeks):
            before = case
            for _ in range(STEPS_PER_WEEK):
                case, infected = self._step(case, infected, contact, recovery)
            weekly[..., week] = case - before
        return weekly * (self._population * self._reported)

    def expected_jax(self, theta: Any) -> Any:
        """The same on JAX arrays, traceable."""
        import jax
        import jax.numpy as jnp

        contact, recovery = theta[..., 0], theta[..., 1]

        def week(state: Any, _: None) -> Any:
            def step(_: int, inner: Any) -> Any:
                return self._step(inner[0], inner[1], contact, recovery)

            after = jax.lax.fori_loop(0, STEPS_PER_WEEK, step, state)
            return after, after[0] - state[0]

        _, weekly = jax.lax.scan(week, self._start(jnp.zeros_like(contact)), None, length=self._weeks)
        return jnp.moveaxis(weekly, 0, -1) * (self._population * self._reported)

    def _start(self, zero: Any) -> tuple[Any, Any]:
        """Cases so far and infected, as shares of the population."""
        return zero, zero + self._infected / self._population

    def _step(self, case: Any, infected: Any, contact: Any, recovery: Any) -> tuple[Any, Any]:
        """One Runge-Kutta step of half a day."""
        step, susceptible = 7.0 / STEPS_PER_WEEK, 1.0 - self._infected / self._population

        def slope(case: Any, infected: Any) -> tuple[Any, Any]:
            new = contact * (susceptible - case) * infected
            return new, new - recovery * infected

        c1, i1 = slope(case, infected)
        c2, i2 = slope(case + 0.5 * step * c1, infected + 0.5 * step * i1)
        c3, i3 = slope(case + 0.5 * step * c2, infected + 0.5 * step * i2)
        c4, i4 = slope(case + step * c3, infected + step * i3)
        return (
            case + step / 6.0 * (c1 + 2.0 * c2 + 2.0 * c3 + c4),
            infected + step / 6.0 * (i1 + 2.0 * i2 + 2.0 * i3 + i4),
        )

    def observe(self, expected: ArrayLike, rng: Rng) -> NDArray[np.int64]:
        """Poisson counts with the given means."""
        return np.asarray(rng.poisson(np.asarray(expected, dtype=float)))

    def simulate(self, theta: ArrayLike, rng: Rng) -> NDArray[np.int64]:
        """Reported cases for each row of theta, ``(n, weeks)``."""
        return self.observe(self.expected(theta), rng)

    def _data(self, x: ArrayLike) -> NDArray[np.float64]:
        return data_array(x, self._weeks, "epidemic")

    def log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Poisson log probability of x given theta, leading axes broadcast."""
        return poisson_log_likelihood(self.expected(theta), self._data(x))

    def log_likelihood_jax(self, theta: Any, x: Any) -> Any:
        """The same on JAX arrays, traceable."""
        import jax.numpy as jnp
        from jax.scipy.special import gammaln

        mean = self.expected_jax(theta)
        return (x * jnp.log(mean) - mean - gammaln(x + 1.0)).sum(-1)

    @cached_property
    def _grid(self) -> PoissonGrid:
        return PoissonGrid(self._prior, self.expected, self._nodes)

    def posterior_sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        """Independent posterior draws, ``(batch, n, 2)``."""
        counts = self._data(x)
        return self._grid.sample(counts, rng.random((len(counts), n, ATTEMPTS, 3)))

    def log_evidence(self, x: ArrayLike) -> NDArray[np.float64]:
        """Log probability of x with theta integrated over the prior, ``(batch,)``."""
        return self._grid.log_evidence(self._data(x))

    def posterior_log_prob(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Log posterior density, ``(batch, n)`` for theta ``(batch, n, 2)``; -inf outside the prior."""
        points, counts = np.asarray(theta, dtype=float), self._data(x)
        inside = self._prior.contains(points)
        safe = np.where(inside[..., None], points, self._prior.center)
        joint = self.log_likelihood(safe, counts[:, None]) + self._prior.log_prob(safe)
        return np.asarray(np.where(inside, joint, -np.inf) - self.log_evidence(counts)[:, None])

    def describe(self) -> dict[str, Any]:
        """Everything that defines it."""
        return {
            "simulator": "epidemic",
            "weeks": self._weeks,
            "population": self._population,
            "infected": self._infected,
            "reported": self._reported,
            "nodes": self._nodes,
        }
