"""Pairs of spectra of one theta, with and without a gain, and what posterior draws say of both.

Members of a pair share their noise as far as two Poisson counts can, and draws share theirs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.simulators.coupling import coupled_poisson
from studies.paper.exact import exact_posteriors

ALPHA, NORM, GAIN = 1, 2, 5
"""Columns of the photon index, of the power law's norm, and of the gain where it is free."""

GAIN_RANGE = (0.95, 1.05)
MEMBERS = ("clean", "shifted")
KINDS = ("fixed", "marginalised")
"""Of flows: without and with the gain as a sixth parameter."""


@dataclass(frozen=True)
class GainPairs:
    """Pairs at a count level."""

    level: str

    @cached_property
    def simulator(self) -> Any:
        """Without a gain."""
        from gaugeblock.simulators.xray import reference

        return reference(level=self.level)

    @cached_property
    def shifted(self) -> Any:
        """With the gain as its sixth parameter."""
        from gaugeblock.simulators.effects import Effect
        from gaugeblock.simulators.marginals import Uniform

        return self.simulator.with_effect(Effect("published_gain", {"factor": Uniform(*GAIN_RANGE)}))

    def drawn(self, number: int, per_cent: float, rng: np.random.Generator) -> tuple[Array, dict[str, Array]]:
        """Theta ``(number, 5)`` from the prior, and counts ``(number, channel)`` by member."""
        theta = self.simulator.prior.sample(number, rng)
        counts = (
            np.asarray(drawn, dtype=float) for drawn in coupled_poisson(*self.means(theta, per_cent), rng)
        )
        return theta, dict(zip(MEMBERS, counts, strict=True))

    def seeded(self, theta: Array, per_cent: float, seeds: NDArray[np.int64]) -> dict[str, Array]:
        """Counts by member as in the study's pairs: both members of a pair start from one seed."""
        return {
            member: np.stack(
                [
                    np.random.default_rng(seed).poisson(mean).astype(float)
                    for seed, mean in zip(seeds, means, strict=True)
                ]
            )
            for member, means in zip(MEMBERS, self.means(theta, per_cent), strict=True)
        }

    def means(self, theta: Array, per_cent: float) -> tuple[Array, Array]:
        factor = np.full((len(theta), 1), 1.0 + per_cent / 100.0)
        return self.simulator.expected(theta), self.shifted.expected(np.hstack([theta, factor]))


def summaries(flow: Any, counts: Mapping[str, Array], *, draws: int, seed: int) -> dict[str, Array]:
    """What a flow says of every spectrum, by member: medians, widths, and the gain where it is free.

    ``alpha`` is the median photon index, ``alpha-sd``, ``alpha-low`` and ``alpha-high`` its sd and central
    90 per cent; ``norm`` the median log10 of the norm; ``gain-low`` and ``gain-high`` as of the photon index.
    """
    made: dict[str, Array] = {}
    for member, rows in counts.items():
        theta = flow.sample(rows, draws, np.random.default_rng(seed))
        low, middle, high = np.quantile(theta, [0.05, 0.5, 0.95], axis=1)
        made |= {
            f"{member}-alpha": middle[:, ALPHA],
            f"{member}-alpha-sd": theta[..., ALPHA].std(axis=1),
            f"{member}-alpha-low": low[:, ALPHA],
            f"{member}-alpha-high": high[:, ALPHA],
            f"{member}-norm": np.log10(middle[:, NORM]),
        }
        if theta.shape[-1] > GAIN:
            made |= {f"{member}-gain-low": low[:, GAIN], f"{member}-gain-high": high[:, GAIN]}
    return made


def exact_summaries(
    simulator: Any, counts: Mapping[str, Array], *, draws: int, rng: np.random.Generator
) -> dict[str, Array]:
    """The same medians and sds of exact posteriors."""
    found = exact_posteriors(simulator, np.concatenate(list(counts.values())), draws=draws, rng=rng)
    made: dict[str, Array] = {}
    for k, member in enumerate(counts):
        rows = slice(k * len(counts[member]), (k + 1) * len(counts[member]))
        made |= {
            f"{member}-alpha": found.median[rows, ALPHA],
            f"{member}-alpha-sd": found.sd[rows, ALPHA],
            f"{member}-norm": np.log10(found.median[rows, NORM]),
        }
    return made
