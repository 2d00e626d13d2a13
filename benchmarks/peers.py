"""What peers and gaugeblock take for the same, one after the other in one run: python benchmarks/peers.py

A row a task: CPU seconds of each (of all its threads; set OMP_NUM_THREADS=1), the best of three, or of one
where the peer takes long, and their ratio. Every peer is asked in its documented way. `tox -e bench-peers`
installs them.
"""

from __future__ import annotations

import os
import sys
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

os.environ.setdefault("KERAS_BACKEND", "torch")
Task = tuple[str, str, Callable[[], Any], Callable[[], Any], int]


class Given:
    """A posterior whose draws ``(draw, trial, parameter)`` are already there."""

    def __init__(self, draws: Any):
        self.draws = draws

    def sample_batched(self, shape: Any, x: Any, show_progress_bars: bool) -> Any:  # noqa: ARG002
        return self.draws


def sbc_ranks(rng: np.random.Generator) -> Task:
    import torch
    from sbi.diagnostics import run_sbc

    from gaugeblock.validate.ranks import randomised_ranks

    truth, draws = rng.normal(size=(1000, 5)), rng.normal(size=(1000, 1000, 5))
    theta = torch.as_tensor(truth, dtype=torch.float32)
    given = Given(torch.as_tensor(draws, dtype=torch.float32).transpose(0, 1).contiguous())
    return (
        "SBC ranks, 1,000 trials x 1,000 draws x 5",
        "sbi",
        lambda: run_sbc(theta, theta, given, num_posterior_samples=1000, show_progress_bar=False),
        lambda: randomised_ranks(truth, draws, rng),
        3,
    )


def ecdf_band(rng: np.random.Generator) -> Task:
    from arviz_stats.ecdf_utils import ecdf_pit

    from gaugeblock.validate.marginal.uniformity import adjusted_gamma, band, ecdf_test

    values = rng.random(10_000)

    def ours() -> Any:
        for cached in (band, adjusted_gamma):
            cached.cache_clear()
        return ecdf_test(values)

    return "simultaneous ECDF band, n = 10,000", "arviz-stats", lambda: ecdf_pit(values, 0.95, 1000), ours, 1


def gamma_null(rng: np.random.Generator) -> Task:
    from bayesflow.diagnostics.metrics.calibration_log_gamma import gamma_discrepancy, gamma_null_distribution

    from gaugeblock.validate.marginal.discrete_ranks import gamma_statistic
    from gaugeblock.validate.marginal.uniformity import adjusted_gamma, band

    ranks = rng.integers(0, 1001, 1000)

    def theirs() -> bool:
        return gamma_discrepancy(ranks, 1000) < np.quantile(gamma_null_distribution(1000, 1000, 1000), 0.05)

    def ours() -> bool:
        for cached in (band, adjusted_gamma):
            cached.cache_clear()
        return gamma_statistic((ranks + 0.5) / 1001, 1001) < adjusted_gamma(1000, 1001, 0.95)

    return "SBC gamma and its threshold, 1,000 trials x 1,000 draws", "bayesflow", theirs, ours, 1


def mmd_null(rng: np.random.Generator) -> Task:
    import torch
    from sbi.diagnostics import calc_misspecification_mmd

    from gaugeblock.validate.detectors.kernels import mmd

    observed, simulated = rng.normal(size=(100, 5)), rng.normal(size=(1000, 5))
    there, here = (torch.as_tensor(a, dtype=torch.float32) for a in (observed, simulated))
    return (
        "MMD with 1,000 permutations, 100 against 1,000",
        "sbi",
        lambda: calc_misspecification_mmd(there, here, n_shuffle=1000),
        lambda: mmd(observed, simulated, rng=rng, permutations=1000),
        1,
    )


def psis(rng: np.random.Generator) -> Task:
    from arviz_stats.base import array_stats

    from gaugeblock.validate.joint.psis import pareto_khat

    weight = rng.normal(size=(1000, 500)) * rng.uniform(0.3, 3, size=(1000, 1))
    return (
        "PSIS k-hat, 1,000 trials x 500 draws",
        "arviz-stats",
        lambda: [array_stats.psislw(-row)[1] for row in weight],
        lambda: pareto_khat(weight),
        3,
    )


def expected_coverage(rng: np.random.Generator) -> Task:
    """Both from draws: densities are what costs. Ours takes them from the flow, once, and ranks them."""
    import torch
    from sbi.diagnostics import run_sbc
    from sbi.inference import DirectPosterior
    from sbi.neural_nets import posterior_nn
    from sbi.utils import BoxUniform

    from gaugeblock.validate.ranks import randomised_pit

    torch.manual_seed(0)
    prior = BoxUniform(-torch.ones(2), torch.ones(2))
    theta = 0.1 * prior.sample((200,))
    x = theta + 0.1 * torch.randn(200, 2)
    posterior = DirectPosterior(posterior_nn("nsf")(theta, x), prior)
    trials, draws = 20, 1000
    theta, x = theta[:trials], x[:trials]
    sampled = posterior.sample_batched((draws,), x=x, show_progress_bars=False)

    def theirs() -> Any:
        return run_sbc(
            theta, x, Given(sampled), num_posterior_samples=draws, reduce_fns=posterior.log_prob,
            show_progress_bar=False,
        )  # fmt: skip

    def ours() -> Any:
        pooled = torch.cat([theta[None], sampled])
        with torch.no_grad():
            log_q = posterior.posterior_estimator.log_prob(pooled, condition=x).numpy()
        return randomised_pit(log_q[0][:, None], log_q[1:].T[:, :, None], rng)

    return "expected coverage by density, 20 trials x 1,000 draws", "sbi", theirs, ours, 1


def thread_errors(rng: np.random.Generator) -> Task:
    from nestcheck.error_analysis import run_std_bootstrap
    from nestcheck.estimators import logz
    from nestcheck.ns_run_utils import dict_given_run_array

    from gaugeblock.validate.evidence.bootstrap import thread_bootstrap
    from gaugeblock.validate.evidence.perfect_runs import perfect_run

    run = perfect_run(lambda v: -50 * np.exp(v / 2), live_points=400, depth=14, rng=rng)
    value = run.log_likelihood
    last = np.array([value[run.thread == k].max() for k in range(len(run.start))])
    samples = np.column_stack([value, run.thread, -np.isin(value, last).astype(float), value])
    held = dict_given_run_array(samples, np.column_stack([run.start, last]))
    return (
        f"thread bootstrap of a log evidence, {len(value):,} points, 200 resamples",
        "nestcheck",
        lambda: run_std_bootstrap(held, [logz], n_simulate=200),
        lambda: thread_bootstrap(run, rng=rng, replicates=200),
        1,
    )


TASKS = (sbc_ranks, ecdf_band, gamma_null, mmd_null, psis, expected_coverage, thread_errors)


def seconds(function: Callable[[], Any], times: int) -> float:
    taken = []
    for _ in range(times):
        start = time.process_time()
        function()
        taken.append(time.process_time() - start)
    return min(taken)


def main(chosen: list[str]) -> None:
    print("| task | peer | peer (CPU s) | gaugeblock (CPU s) | ratio |\n|---|---|---|---|---|")
    for make in TASKS:
        if chosen and make.__name__ not in chosen:
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            what, peer, theirs, ours, times = make(np.random.default_rng(1))
            ours()  # what is imported or compiled on a first call is nobody's cost
            theirs_took, ours_took = seconds(theirs, times), seconds(ours, 3)
        print(f"| {what} | {peer} | {theirs_took:.3g} | {ours_took:.3g} | {theirs_took / ours_took:.3g} |")
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
