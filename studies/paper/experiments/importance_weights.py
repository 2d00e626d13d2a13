"""Importance weights of spectra under a trained flow, population by population.

As the study did: draws that are not rejected to the prior's box, weight zero outside it, and inside the exact
likelihood times a prior that is uniform in both norms. Beside it the same with the prior that was simulated
from, which is uniform in their logarithms.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from gaugeblock.core.arrays import Array
from gaugeblock.validate.joint.importance import kish_fraction
from gaugeblock.validate.joint.psis import pareto_khat
from studies.paper.interpolated import AREA, NORM, Interpolated, interpolated

LINE = 3e-4
"""Norm of the line, in photons/cm2/s."""

FEW = "few-"

WORST = 99.0
"""k-hat of weights of which hardly any is above zero: no number, but beyond all others."""


def diagnostics(
    flow: Any, level: Any, counts: Array, *, draws: int, few: int, rng: np.random.Generator
) -> dict[str, Array]:
    """What the weights of draws ``(spectrum, draw)`` say of each spectrum.

    Its counts, the share of draws inside the box and of those effective (Kish) under either prior, and
    k-hat; names that begin with ``few-`` are of the first few draws alone.
    """
    _, inside, weight, simulated = weighted(flow, level, counts, draws=draws, rng=rng)
    made = {"counts": counts.sum(axis=1), "accepted": inside.mean(axis=1)}
    for prefix, number in (("", draws), (FEW, few)):
        made |= {
            f"{prefix}effective": kish_fraction(weight[:, :number]),
            f"{prefix}effective_simulated": kish_fraction(simulated[:, :number]),
            f"{prefix}khat": np.minimum(pareto_khat(weight[:, :number]), WORST),
        }
    return made


def weighted(
    flow: Any, level: Any, counts: Array, *, draws: int, rng: np.random.Generator
) -> tuple[Array, NDArray[np.bool_], Array, Array]:
    """Draws ``(spectrum, draw, parameter)``, whether each is in the box, and its log weight by either prior.

    First by the study's, which is uniform in both norms, then by the one that was simulated from.
    """
    theta, log_q = flow.raw(counts, draws, rng)
    inside = flow.inside(theta) & np.isfinite(log_q)
    held = np.where(inside[..., None], theta, flow.box[0])
    weight = np.where(inside, level.log_likelihood(held, counts) - log_q, -np.inf)
    # Both priors are flat in the three other parameters; constants do not matter here.
    return theta, inside, weight, weight - np.log(held[..., NORM] * held[..., AREA])


@dataclass(frozen=True)
class WeightLevel:
    """A count level: spectra of it as the study perturbed them, and its likelihood without."""

    name: str

    @cached_property
    def plain(self) -> Any:
        """The simulator that the flow knows."""
        from gaugeblock.simulators.xray import reference

        return reference(level=self.name)

    @cached_property
    def fast(self) -> Interpolated:
        """The same, by interpolation."""
        return interpolated(self.plain)

    def log_likelihood(self, theta: Array, counts: Array) -> Array:
        """What the flow's draws ``(spectrum, draw, parameter)`` of counts ``(spectrum, channel)`` weigh."""
        found = np.empty(theta.shape[:2])
        for i, (draws, row) in enumerate(zip(theta, counts, strict=True)):  # bounds memory
            mean = self.fast.expected(draws)
            found[i] = np.log(mean) @ row - mean.sum(axis=1)
        return np.asarray(found - gammaln(counts + 1.0).sum(axis=1)[:, None])

    @cached_property
    def shifted(self) -> Any:
        """With a gain as its sixth parameter: compiled once for all amplitudes."""
        from gaugeblock.simulators.effects import Effect
        from gaugeblock.simulators.marginals import Uniform

        return self.plain.with_effect(Effect("published_gain", {"factor": Uniform(0.8, 1.2)}))

    @cached_property
    def lined(self) -> Any:
        """With a line."""
        from gaugeblock.simulators.xray.published import family

        return self.plain.with_effect(family("B1", LINE))

    def spectra(self, kind: str, amplitude: float, number: int, rng: np.random.Generator) -> Array:
        """Counts ``(number, channel)``: clean, with a line, or with a gain of so many per cent."""
        theta = self.plain.prior.sample(number, rng)
        if kind == "gain":
            factor = np.full((number, 1), 1.0 + amplitude / 100.0)
            return np.asarray(self.shifted.simulate(np.hstack([theta, factor]), rng), dtype=float)
        simulator = self.lined if kind == "line" else self.plain
        return np.asarray(simulator.simulate(theta, rng), dtype=float)


def ceiling(simulator: Any, draws: int, rows: slice, rng: np.random.Generator) -> Mapping[str, Array]:
    """Effective share of draws of the exact posterior under the other prior's weights, ``(spectrum,)``.

    No flow that learns from the simulations does better.
    """
    from gaugeblock.discovery.fitting import fit
    from gaugeblock.discovery.name.drawn_posterior import posterior_draws

    number = rows.stop - rows.start
    counts = np.asarray(simulator.simulate(simulator.prior.sample(number, rng), rng), dtype=float)
    scale = np.ones(number)
    fitted = fit(simulator, counts, scale=scale, seed=int(rng.integers(2**31)))
    found = posterior_draws(simulator, counts, fitted, scale=scale, draws=draws, rng=rng)
    ratio = found.theta[..., NORM] * found.theta[..., AREA]
    first = (found.weight * ratio).sum(axis=1) ** 2
    return {"ceiling": np.asarray(first / (found.weight * ratio**2).sum(axis=1))}
