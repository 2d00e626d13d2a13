"""Fresh simulations for a check, and what an estimator says of each of them."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from gaugeblock.auditing.samples import MainTrials, Plan, checked
from gaugeblock.core.arrays import Array, plain
from gaugeblock.core.errors import InputError, blamed
from gaugeblock.core.streams import Rng, generator, whole_blocks
from gaugeblock.estimators.protocol import Embeds, Estimator
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.protocol import Simulator
from gaugeblock.validate.observation import Sets

BLOCK = 500


class Predictive(MainTrials):
    """Data sets of the prior predictive, a purpose's apart from another's."""

    def __init__(self, simulator: Simulator, seed: int, purpose: str):
        plan = Plan(
            number=0, draws=0, block=BLOCK, importance_number=0, importance_draws=0, joint_number=0,
            joint_draws=0, seed=seed,
        )  # fmt: skip
        super().__init__(simulator, cast(Estimator, None), plan)
        self.purpose = purpose

    def rng(self, purpose: str, trials: range) -> Rng:
        return generator(self.plan.seed, f"check {self.purpose} {purpose}", trials.start // BLOCK)

    def data(self, number: int) -> NDArray[Any]:
        """So many data sets ``(number, *data_shape)``."""
        return self.pairs(number)[1]

    def pairs(self, number: int) -> tuple[Array, NDArray[Any]]:
        """So many parameters ``(number, parameter)``, and data sets ``(number, *data_shape)``."""
        blocks = [self.truth_and_data(trials) for trials in whole_blocks(number, BLOCK)]
        theta, x = (np.concatenate(part)[:number] for part in zip(*blocks, strict=True))
        return theta, x


class Answering:
    """What an estimator, if there is one, says of data sets: features, and data replicated at its draws."""

    def __init__(self, simulator: Simulator, estimator: Estimator | None, *, draws: int, seed: int):
        self.simulator, self.estimator, self.draws, self.seed = simulator, estimator, draws, seed

    def sets(self, x: NDArray[Any], purpose: str) -> Sets:
        """Of data ``(n, *data_shape)``."""
        if self.estimator is None:
            return Sets(x)
        made = []
        for number, start in enumerate(range(0, len(x), BLOCK)):
            rng = generator(self.seed, f"check answers {purpose}", number)
            made.append(self._block(x[start : start + BLOCK], range(start, min(start + BLOCK, len(x))), rng))
        return Sets.joined(made)

    def posterior(self, x: NDArray[Any], number: int, purpose: str) -> Array:
        """Draws ``(n, number, parameter)``.

        Raises
        ------
        InputError
            If the estimator fails.
        """
        assert self.estimator is not None
        rng = generator(self.seed, f"check posterior {purpose}")
        trials = range(len(x))
        with blamed("the estimator", trials):
            drawn = self.estimator.sample(x, number, rng)
        return checked(drawn, (len(x), number, self.simulator.prior.size))

    def _block(self, x: NDArray[Any], trials: range, rng: Rng) -> Sets:
        embedded = None
        if isinstance(self.estimator, Embeds):
            with blamed("the estimator's embed", trials):
                embedded = plain(self.estimator.embed(x), what="the estimator's features").reshape(len(x), -1)
            if not np.isfinite(embedded).all():
                raise InputError("the estimator's embed gave NaN or infinite features; mend it")
        estimator = cast(Estimator, self.estimator)
        with blamed("the estimator", trials):
            drawn = estimator.sample(x, self.draws, rng)
        draws = possible(
            checked(drawn, (len(x), self.draws, self.simulator.prior.size)), self.simulator.prior, rng
        )
        with blamed("the simulator at the estimator's draws, for data sets", trials):
            made = np.asarray(self.simulator.simulate(draws.reshape(-1, draws.shape[-1]), rng))
        if not np.isfinite(made).all():
            raise InputError("the simulator gave NaN or infinite data at draws of the estimator; mend it")
        return Sets(x, embedded, made.reshape(len(x), self.draws, *made.shape[1:]))


def possible(draws: Array, prior: Prior, rng: Rng) -> Array:
    """Draws ``(n, draw, parameter)`` at which one can simulate: others give way to draws of the prior."""
    flat = draws.reshape(-1, draws.shape[-1])
    finite = np.asarray(np.isfinite(flat).all(axis=1))
    known = np.where(finite[:, None], flat, prior.center)
    inside = np.asarray(finite & np.isfinite(prior.log_prob_or_support(known)))
    fallback = prior.sample(len(flat), rng)
    return np.asarray(np.where(inside[:, None], flat, fallback).reshape(draws.shape))
