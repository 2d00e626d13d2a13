"""When the estimator is what is wrong: locate, name, repair, confirm.

The mirror of `discovery`: a library of faults, each with a repair of the draws, or of the call, that mends it
if that is what is wrong.
"""

from gaugeblock.diagnosis.diagnosis import Diagnosis, diagnose

__all__ = ["Diagnosis", "diagnose"]
