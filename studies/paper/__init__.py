"""The published study that the reference case comes from, claim by claim.

`claims` are its 477 quantitative claims, `experiments` measure them, `judge` holds one against the other,
`reproduce` does all of it and writes files. Nothing but its command imports this room.
"""

from studies.paper.claim import Claim, Kind
from studies.paper.experiment import Experiment, Setting
from studies.paper.judge import Agreement, Judgement, judge
from studies.paper.measurement import Measured, Untestable
from studies.paper.registry import claims, find
from studies.paper.run import Reproduction, from_committed, reproduce

__all__ = [
    "Agreement",
    "Claim",
    "Experiment",
    "Judgement",
    "Kind",
    "Measured",
    "Reproduction",
    "Setting",
    "Untestable",
    "claims",
    "find",
    "from_committed",
    "judge",
    "reproduce",
]
