"""Which flows the study trained, with its seeds, and how often each recipe is trained again."""

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
    largest number of epochs. `gain` says that the gain is a sixth parameter, 0.95 to 1.05; `base` that the
    model is the study's smaller one, an absorbed power law, with fewer summaries.
    """

    response: str
    level: str
    data_seed: int
    torch_seed: int
    cap: int = CAP
    simulations: int = SIMULATIONS
    gain: bool = False
    base: bool = False

    @property
    def summaries(self) -> int:
        """Numbers that the network makes of a spectrum."""
        return 16 if self.base else 20

    def describe(self) -> dict[str, Any]:
        """Plain data; records of the larger model are from before there was a smaller."""
        return {name: value for name, value in asdict(self).items() if name != "base" or value}


LEVELS = ("faint", "medium", "bright")
GAIN_LEVELS = ("medium", "bright")

SEEDS = (101, 202, 303, 404)
"""Of the trainings beside the first: by the first three the study trained its bright flow again."""

FEWER = SEEDS[:2]
"""Of those on NICER."""

MADE = SEEDS[:3]
"""Those of which there are flows at every level, with a free gain too; the fourth is still to be trained."""

TRAININGS = ("", *(f"-seed{seed}" for seed in MADE))
"""How the names of a recipe's trainings end, the first first."""

ON_NICER = ("", *(f"-seed{seed}" for seed in FEWER))
"""Those on NICER."""


def _variants() -> dict[str, Variant]:
    found = {}
    for offset, level in enumerate(LEVELS, start=1):
        first = Variant(
            response="epic-pn", level=level, data_seed=SEED + 10 + offset, torch_seed=SEED + offset
        )
        found |= _trainings(f"epic-pn-{level}", first, SEEDS)
        # Seeds of the study's trainings on NICER, and of those with a gain, are not published.
        nicer = Variant(**first.describe() | {"response": "nicer", "data_seed": SEED + 30 + offset})
        found |= _trainings(f"nicer-{level}", nicer, FEWER)
        if level in GAIN_LEVELS:
            gain = Variant(**first.describe() | {"data_seed": SEED + 20 + offset, "gain": True})
            found |= _trainings(f"epic-pn-{level}-gain", gain, SEEDS)
    bright = found["epic-pn-bright"]
    found["epic-pn-bright-uncapped"] = Variant(**bright.describe() | {"cap": UNCAPPED})
    # The study's own capped training ended on bad weights, ours had converged by then. Its worst epoch shows
    # what last-epoch weights may be.
    found["epic-pn-bright-cut"] = Variant(**bright.describe() | {"cap": WORST})
    return found


def _trainings(name: str, first: Variant, seeds: tuple[int, ...]) -> dict[str, Variant]:
    """One recipe's trainings: the first by its own seeds, the others by one seed for data and weights."""
    again = {
        f"{name}-seed{seed}": Variant(**first.describe() | {"data_seed": seed, "torch_seed": seed})
        for seed in seeds
    }
    return {name: first, **again}


VARIANTS = _variants()
"""By name: response, level, what is special. The capped, uncapped and cut bright flows are one training."""
