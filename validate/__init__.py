"""One statistic per file; trials in, findings out; policy -> verdict.

Nothing here imports an estimator or a simulator: validators see arrays and Trials only.
"""

from gaugeblock.validate.check import check_trials
from gaugeblock.validate.finding import Finding, NotChecked
from gaugeblock.validate.same_likelihood import LikelihoodComparison, assert_same_likelihood
from gaugeblock.validate.trials import (
    importance_trials,
    main_trials,
    make_trials,
    read_trials,
    trials_tree,
    write_trials,
)
from gaugeblock.validate.verdict import Gate, Outcome, Verdict, combine

__all__ = [
    "Finding",
    "Gate",
    "LikelihoodComparison",
    "NotChecked",
    "Outcome",
    "Verdict",
    "assert_same_likelihood",
    "check_trials",
    "combine",
    "importance_trials",
    "main_trials",
    "make_trials",
    "read_trials",
    "trials_tree",
    "write_trials",
]
