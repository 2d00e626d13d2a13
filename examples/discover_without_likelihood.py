"""Find a missing effect with a simulator that can only simulate.

    python examples/discover_without_likelihood.py

Weekly cases of two hundred towns, each with contact and recovery rates of its own, from a population that is
not the prior. In the fifth week people began to meet less, by 15%, and the simulator knows nothing of it.
`SimulateOnly` hides the simulator's likelihood and mean, to show that neither is used.
"""

import sys

import numpy as np

from gaugeblock.discovery import discover_simulated
from gaugeblock.simulators import build_simulator

TOWNS, FACTOR, WEEK = 200, 0.85, 4.5


class SimulateOnly:
    """A simulator as it might come from elsewhere: parameters in, data out."""

    def __init__(self, inner):
        self.inner, self.prior = inner, inner.prior

    def simulate(self, theta, rng):
        """Reported cases (n, week)."""
        return self.inner.simulate(theta, rng)

    def with_effect(self, effect):
        """The same with an effect worked in."""
        return SimulateOnly(self.inner.with_effect(effect))


def story():
    """Hide the effect, find it, say what was found."""
    epidemic, rng = build_simulator("epidemic"), np.random.default_rng(2026)
    # Contact rates near 0.4 a day and recovery rates near 0.13, log-normal, 20% apart from town to town.
    theta = np.exp(rng.normal(np.log([0.4, 0.13]), 0.2, size=(TOWNS, 2)))
    library = epidemic.effect_library(theta)
    reality = epidemic.with_effect(library["contact_change"].effect(factor=FACTOR, week=WEEK))
    cases = reality.simulate(theta, rng)

    found = discover_simulated(SimulateOnly(epidemic), cases, effects=library, seed=1, simulations=8000)

    yield f"global p of a disagreement: {found.p_global:.3g}"
    yield f"named: {found.named}; just as likely: {', '.join(found.indistinguishable[1:]) or 'nothing'}"
    for said in found.amplitude:
        low, high = said.interval
        yield f"{said.parameter} {said.value:.3f}, 90% interval {low:.3f} to {high:.3f} (hidden: 0.85)"
    gap = found.gap.held_out
    if found.named_all:
        yield f"held-out gap (1 where all is well): {gap.before:.2f} before, {gap.after:.2f} after"
    for decoy in found.decoys:
        yield f"  with {decoy.name} instead: {decoy.deviance:.2f}"


if __name__ == "__main__":
    sys.stdout.writelines(line + "\n" for line in story())
