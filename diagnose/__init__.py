"""When the estimator is what is wrong: locate, name, repair, confirm.

The mirror of `discovery`: a library of faults, each with a repair of the draws, or of the call, that mends it
if that is what is wrong.
"""

from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.causes import Cause
from gaugeblock.diagnosis.diagnosis import Diagnosis, Fault, diagnose
from gaugeblock.diagnosis.repair import Repair, mends
from gaugeblock.diagnosis.repaired import Repaired

__all__ = ["Cases", "Cause", "Diagnosis", "Fault", "Repair", "Repaired", "diagnose", "mends"]
