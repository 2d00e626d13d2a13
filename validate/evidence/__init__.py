"""Log evidences of nested sampling: their errors, and whether these hold."""

from gaugeblock.validate.evidence.insertion_order import InsertionTest, insertion_order_test
from gaugeblock.validate.evidence.nested_threads import Threads, split_threads, threads_of
from gaugeblock.validate.evidence.perfect_run import perfect_run
from gaugeblock.validate.evidence.thread_bootstrap import (
    LogEvidence,
    evidence_difference,
    evidence_sum,
    simulated_shrinkage,
    thread_bootstrap,
)

__all__ = [
    "InsertionTest",
    "LogEvidence",
    "Threads",
    "evidence_difference",
    "evidence_sum",
    "insertion_order_test",
    "perfect_run",
    "simulated_shrinkage",
    "split_threads",
    "thread_bootstrap",
    "threads_of",
]
