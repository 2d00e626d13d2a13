"""Time of all sample-based validators and of the judge: python benchmarks/validators_speed.py"""

from __future__ import annotations

import resource
import sys
import time

import numpy as np

from gaugeblock.validate import judge, make_trials, read_policy, run_validators


def measure(trials: int, draws: int, parameters: int) -> None:
    rng = np.random.default_rng(1)
    truth = rng.normal(size=(trials, parameters))
    sampled = rng.normal(size=(trials, draws, parameters))
    log_q = -0.5 * (sampled**2).sum(axis=-1)
    data = make_trials(
        truth,
        sampled,
        [f"p{i}" for i in range(parameters)],
        log_q=log_q,
        log_likelihood=0.1 * rng.normal(size=log_q.shape),
        log_prior=log_q,
    )
    start = time.perf_counter()
    findings, not_checked = run_validators(data, seed=1)
    middle = time.perf_counter()
    judge(findings, not_checked, read_policy("default"), seed=1)
    end = time.perf_counter()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(
        f"{trials:>7} trials x {draws} draws x {parameters} parameters: validators {middle - start:.2f} s, "
        f"judge {end - middle:.2f} s, peak memory {peak:.2f} GB"
    )


if __name__ == "__main__":
    sizes = [(4000, 250, 5), (1000, 1000, 5)]
    if len(sys.argv) == 4:
        sizes = [tuple(map(int, sys.argv[1:]))]
    for size in sizes:
        measure(*size)
