"""One statistic per file; trials in, findings out; policy -> verdict.

Nothing here imports an estimator or a simulator: validators see arrays and Trials only.
"""

from gaugeblock.validate.finding import Finding, NotChecked
from gaugeblock.validate.verdict import Gate, Outcome, Verdict, combine

__all__ = ["Finding", "Gate", "NotChecked", "Outcome", "Verdict", "combine"]
