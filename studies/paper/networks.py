"""The study's network where we have another: what is lacking to judge a claim about it."""

from __future__ import annotations

from studies.paper.paper_flow.shipped import FLOWS
from studies.paper.paper_flow.variants import VARIANTS

OF_ONE_TRAINING = ("-uncapped", "-cut")
"""Where the bright training was stopped: no trainings of their own."""

WORDS = {
    "undertrained": "one that its cap left undertrained, chosen by its loss before all else; ours converged",
    "stopped": "one of that seed that stops by itself, of which the rule is; the cap ended ours",
}


def planned() -> tuple[str, ...]:
    """Trainings of the study's network that were fixed beforehand."""
    return tuple(name for name in VARIANTS if not name.endswith(OF_ONE_TRAINING))


def made() -> frozenset[str]:
    """Those that are made."""
    return frozenset(path.stem for path in FLOWS.glob("*.json"))


def lacking(network: str) -> str:
    """What would settle a claim whose rule speaks of this network."""
    return f"another network: {WORDS[network]}"
