"""A small epidemic with ways in which reality may differ from it: the simulator that is not a spectrum.

`simulator` has the plain one, with its exact posterior; `with_effects` the one that effects were worked
into; `course` integrates the epidemic; `effects` says what each effect does, `library` which of them
discovery may propose.
"""

from gaugeblock.simulators.epidemic.effects import EFFECTS, EpidemicEffect
from gaugeblock.simulators.epidemic.simulator import Epidemic
from gaugeblock.simulators.epidemic.with_effects import EpidemicWithEffects

__all__ = ["EFFECTS", "Epidemic", "EpidemicEffect", "EpidemicWithEffects"]
