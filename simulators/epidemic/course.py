"""The course of an epidemic: new infections a week, from what drives it, on NumPy and on JAX arrays.

With s and i the susceptible and infected shares of the population, r the removed one,

    ds/dt = -contact_rate s^(1 + mixing) i + waning r
    di/dt =  contact_rate s^(1 + mixing) i - recovery_rate i

(rates per day), integrated by fourth-order Runge-Kutta steps of half a day, for a whole batch at once. Only
additions, products and powers: what drives it may be complex, for derivatives by a complex step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gaugeblock.simulators.marginals import namespace

STEPS_PER_WEEK = 14
DAYS = 7.0 / STEPS_PER_WEEK
LEAST_SHARE = 0.01


@dataclass(frozen=True)
class Drive:
    """What drives an epidemic; every number is an array over the batch, or None where it plays no part.

    `changes` are pairs of a week, counted from 0 at the start, and the factor on the contact rate from then.
    """

    contact: Any
    recovery: Any
    waning: Any = None
    mixing: Any = None
    changes: tuple[tuple[Any, Any], ...] = ()

    def contact_in_step(self, number: Any) -> Any:
        """Contact rate in a step, counted from the start; a change within the step counts for its part."""
        rate = self.contact
        for week, factor in self.changes:
            rate = rate * (1.0 + (factor - 1.0) * ramp(number + 1.0 - STEPS_PER_WEEK * week))
        return rate


def ramp(value: Any) -> Any:
    """0 below 0, 1 above 1, itself between: complex values keep their imaginary part there.

    >>> ramp(np.array([-1.0, 0.25, 3.0])).tolist()
    [0.0, 0.25, 1.0]
    """
    xp = namespace(value)
    real = value.real
    return xp.where(real <= 0.0, 0.0, xp.where(real >= 1.0, 1.0, value))


def floored(share: Any) -> Any:
    """A share of the population, or the least that a power is taken of: steps may end below 0 by rounding."""
    return namespace(share).where(share.real > LEAST_SHARE, share, LEAST_SHARE)


def start(zero: Any, infected: float, drive: Drive) -> tuple[Any, Any, Any]:
    """Infections so far, infected now and returned to the susceptible, as shares of the population.

    Where nobody returns that is a plain number, which costs the steps nothing.
    """
    return zero, zero + infected, 0.0 if drive.waning is None else zero


def step(state: tuple[Any, Any, Any], drive: Drive, number: Any, infected: float) -> tuple[Any, Any, Any]:
    """One Runge-Kutta step of half a day."""
    contact = drive.contact_in_step(number)

    def slope(case: Any, now: Any, returned: Any) -> tuple[Any, Any, Any]:
        susceptible = 1.0 - infected - case + returned
        new = contact * susceptible * now
        if drive.mixing is not None:
            new = new * floored(susceptible) ** drive.mixing
        back = 0.0 if drive.waning is None else drive.waning * (infected + case - now - returned)
        return new, new - drive.recovery * now, back

    def moved(by: float, slopes: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
        return state[0] + by * slopes[0], state[1] + by * slopes[1], state[2] + by * slopes[2]

    first = slope(*state)
    second = slope(*moved(0.5 * DAYS, first))
    third = slope(*moved(0.5 * DAYS, second))
    fourth = slope(*moved(DAYS, third))
    return tuple(
        before + DAYS / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        for before, a, b, c, d in zip(state, first, second, third, fourth, strict=True)
    )


def weekly(drive: Drive, weeks: int, infected: float) -> Any:
    """New infections of each week as shares of the population, ``(..., weeks)``; `infected` at the start."""
    state = start(np.zeros_like(drive.contact), infected, drive)
    found = np.empty((*np.shape(drive.contact), weeks), dtype=np.asarray(drive.contact).dtype)
    for week in range(weeks):
        before = state[0]
        for number in range(week * STEPS_PER_WEEK, (week + 1) * STEPS_PER_WEEK):
            state = step(state, drive, float(number), infected)
        found[..., week] = state[0] - before
    return found


def weekly_jax(drive: Drive, weeks: int, infected: float) -> Any:
    """The same on JAX arrays, traceable."""
    import jax
    import jax.numpy as jnp

    def one_week(state: Any, first: Any) -> Any:
        def one_step(number: Any, inner: Any) -> Any:
            return step(inner, drive, first + number, infected)

        after = jax.lax.fori_loop(0, STEPS_PER_WEEK, one_step, state)
        return after, after[0] - state[0]

    begin = start(jnp.zeros_like(drive.contact), infected, drive)
    _, found = jax.lax.scan(one_week, begin, jnp.arange(weeks) * float(STEPS_PER_WEEK))
    return jnp.moveaxis(found, 0, -1)
