"""One statistic per file; trials in, findings out; policy -> verdict.

Nothing here imports an estimator or a simulator: validators see arrays and Trials only.
"""

from gaugeblock.validate.check import check_trials
from gaugeblock.validate.finding import (
    CountFinding,
    Finding,
    MeanFinding,
    NotChecked,
    PValueFinding,
    QuantileFinding,
    SequenceFinding,
    Suggestion,
)
from gaugeblock.validate.findings_file import read_findings, write_findings
from gaugeblock.validate.judging import judge
from gaugeblock.validate.likelihood.same_likelihood import (
    LikelihoodComparison,
    LikelihoodsDiffer,
    assert_same_likelihood,
)
from gaugeblock.validate.policy import Policy, make_policy, read_policy
from gaugeblock.validate.trials import (
    importance_trials,
    main_trials,
    make_trials,
    read_trials,
    trials_tree,
    write_trials,
)
from gaugeblock.validate.validators import VALIDATORS, check_validators, run_validators
from gaugeblock.validate.verdict import Gate, Outcome, Verdict, combine

__all__ = [
    "VALIDATORS",
    "CountFinding",
    "Finding",
    "Gate",
    "LikelihoodComparison",
    "LikelihoodsDiffer",
    "MeanFinding",
    "NotChecked",
    "Outcome",
    "PValueFinding",
    "Policy",
    "QuantileFinding",
    "SequenceFinding",
    "Suggestion",
    "Verdict",
    "assert_same_likelihood",
    "check_trials",
    "check_validators",
    "combine",
    "importance_trials",
    "judge",
    "main_trials",
    "make_policy",
    "make_trials",
    "read_findings",
    "read_policy",
    "read_trials",
    "run_validators",
    "trials_tree",
    "write_findings",
    "write_trials",
]
