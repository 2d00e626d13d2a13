"""Log evidences of nested sampling: their errors, and whether these hold."""

from gaugeblock.validate.evidence.bootstrap import (
    LogEvidence,
    evidence_difference,
    evidence_sum,
    thread_bootstrap,
)
from gaugeblock.validate.evidence.insertion_order import InsertionTest, insertion_order_test
from gaugeblock.validate.evidence.nested_threads import Threads, split_threads, threads_of
from gaugeblock.validate.evidence.perfect_runs import perfect_run

__all__ = [
    "InsertionTest",
    "LogEvidence",
    "Threads",
    "evidence_difference",
    "evidence_sum",
    "insertion_order_test",
    "perfect_run",
    "split_threads",
    "thread_bootstrap",
    "threads_of",
]
