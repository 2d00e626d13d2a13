"""Which flows the study trained, with its seeds."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

SEED = 20260611
SIMULATIONS = 50_000
CAP = 150
"""Epochs after which the study stopped a training that had not converged, and kept its last weights."""

UNCAPPED = 400
WORST = 90
"""Epoch of our bright training with the worst validation loss of its last twenty."""


@dataclass(frozen=True, kw_only=True)
class Variant:
    """One training of the study's.

    `data_seed` draws parameters and counts, `torch_seed` the weights, the split and the order. `cap` is the
    largest number of epochs. `gain` says that the gain is a sixth parameter, 0.95 to 1.05.
    """

    response: str
    level: str
    data_seed: int
    torch_seed: int
    cap: int = CAP
    simulations: int = SIMULATIONS
    gain: bool = False

    def describe(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)


def _variants() -> dict[str, Variant]:
    found = {}
    for offset, level in enumerate(("faint", "medium", "bright"), start=1):
        found[f"epic-pn-{level}"] = Variant(
            response="epic-pn", level=level, data_seed=SEED + 10 + offset, torch_seed=SEED + offset
        )
    bright = found["epic-pn-bright"]
    found["epic-pn-bright-uncapped"] = Variant(**bright.describe() | {"cap": UNCAPPED})
    # The study's own capped training ended on bad weights, ours had converged by then. Its worst epoch shows
    # what last-epoch weights may be.
    found["epic-pn-bright-cut"] = Variant(**bright.describe() | {"cap": WORST})
    for seed in (101, 202, 303):
        found[f"epic-pn-bright-seed{seed}"] = Variant(
            response="epic-pn", level="bright", data_seed=seed, torch_seed=seed
        )
    for offset, level in ((2, "medium"), (3, "bright")):
        # Seeds of the study's gain-marginalised trainings are not published.
        found[f"epic-pn-{level}-gain"] = Variant(
            response="epic-pn", level=level, data_seed=SEED + 20 + offset, torch_seed=SEED + offset, gain=True
        )
    return found


VARIANTS = _variants()
"""By name: level, then what is special. The capped, uncapped and cut bright flows are one training."""
