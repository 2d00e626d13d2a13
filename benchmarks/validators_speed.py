"""Cost of each validator and the judge: python benchmarks/validators_speed.py [TRIALS DRAWS PARAMS]

With --stream the trials lie on disk, as after a large audit, and are read in blocks.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import xarray as xr

from gaugeblock.validate import VALIDATORS, judge, make_trials, read_policy, trials_tree
from gaugeblock.validate.finding import Finding, NotChecked
from gaugeblock.validate.prepared import Prepared
from gaugeblock.validate.storage import write_groups
from gaugeblock.validate.trials import read_trials

# These train classifiers or permute: their cost is reported apart.
APART = ("c2st", "lc2st")
PART = 2000


def trials(first: int, last: int, draws: int, parameters: int) -> xr.Dataset:
    """theta ~ N(0, 1), x = theta + N(0, 1), exact posterior draws with all densities."""
    rng = np.random.default_rng([first, draws, parameters])
    theta = rng.normal(size=(last - first, parameters))
    x = theta + rng.normal(size=theta.shape)
    noise = rng.normal(size=(last - first, draws, parameters))
    sampled = x[:, None] / 2 + np.sqrt(0.5) * noise
    half_log = 0.5 * np.log(2 * np.pi)

    def normal(value: np.ndarray, sd: float) -> np.ndarray:
        return (-0.5 * (value / sd) ** 2 - np.log(sd) - half_log).sum(axis=-1)

    return make_trials(
        theta,
        sampled,
        [f"p{i}" for i in range(parameters)],
        x=x,
        log_q=normal(sampled - x[:, None] / 2, np.sqrt(0.5)),
        log_q_true=normal(theta - x / 2, np.sqrt(0.5)),
        log_likelihood=normal(sampled - x[:, None], 1.0),
        log_likelihood_true=normal(theta - x, 1.0),
        log_prior=normal(sampled, 1.0),
    ).assign_coords(trial=np.arange(first, last))


def parts(number: int, draws: int, parameters: int) -> Iterator[xr.Dataset]:
    for first in range(0, number, PART):
        yield trials(first, min(first + PART, number), draws, parameters)


def measure(tree: xr.DataTree, label: str) -> None:
    prepared = Prepared(tree, 1)
    start = time.perf_counter()
    chosen = {name: validator for name, validator in VALIDATORS.items() if validator.by_default}
    together = [name for name in chosen if name not in APART]
    prepared.compute([statistic for name in together for statistic in chosen[name].statistics])
    spent = {"one pass over the draws": time.perf_counter() - start}
    peak = {"one pass over the draws": _peak()}
    said: list[Finding | NotChecked] = []
    for name, validator in chosen.items():
        start = time.perf_counter()
        said += validator.findings(prepared)
        spent[name] = time.perf_counter() - start
        peak[name] = _peak()
    findings = [item for item in said if isinstance(item, Finding)]
    start = time.perf_counter()
    judge(findings, [], read_policy("default"), seed=1)
    judged = time.perf_counter() - start
    sampled = sum(seconds for name, seconds in spent.items() if name not in APART)
    print(f"{label}: all but {' and '.join(APART)} {sampled:.2f} s, judge {judged:.2f} s")
    print("    " + ", ".join(f"{name} {seconds:.2f} s" for name, seconds in spent.items()))
    print(
        f"    peak memory {_peak():.2f} GB; after each: " + ", ".join(f"{n} {p:.2f}" for n, p in peak.items())
    )


def _peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("size", nargs="*", type=int, help="TRIALS DRAWS PARAMETERS")
    parser.add_argument("--stream", action="store_true", help="trials on disk, read in blocks")
    arguments = parser.parse_args()
    sizes = [tuple(arguments.size)] if arguments.size else [(4000, 250, 5), (1000, 1000, 5)]
    for number, draws, parameters in sizes:
        label = f"{number:,} trials x {draws} draws x {parameters} parameters"
        if not arguments.stream:
            measure(trials_tree(trials(0, number, draws, parameters)), label)
            continue
        with tempfile.TemporaryDirectory() as folder:
            path = write_groups({"": parts(number, draws, parameters)}, Path(folder) / "trials.nc")
            measure(read_trials(path), f"{label}, on disk")


if __name__ == "__main__":
    main()
