"""Size: how often each p-value rejects an exact posterior. It should be as often as its level says."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gaugeblock.estimators import build_estimator
from gaugeblock.simulators import build_simulator
from gaugeblock.validate import run_validators
from gaugeblock.validate.designs.count_ratio import count_ratio_regression
from gaugeblock.validate.designs.paired import paired_permutation, stratified_permutation
from gaugeblock.validate.designs.signed_rank import wilcoxon_signed_rank
from gaugeblock.validate.detectors.embeddings import embedding_distance
from gaugeblock.validate.detectors.kernels import mmd
from gaugeblock.validate.detectors.predictive import predictive_check
from gaugeblock.validate.detectors.roc import best_of_cells, permutation_p
from gaugeblock.validate.evidence.insertion_order import insertion_order_test
from gaugeblock.validate.evidence.perfect_runs import perfect_run
from gaugeblock.validate.learned.observations import local_c2st
from gaugeblock.validate.learned.two_sample import classifier_two_sample
from gaugeblock.validate.local.posterior_sbc import posterior_sbc_findings
from gaugeblock.validate.marginal.discrete_ranks import rank_ecdf_test
from studies.error_rates.audits import collected, plan
from studies.error_rates.boundary import Moved
from studies.error_rates.problem import problem
from studies.error_rates.replicates import Part, Replicate, Values
from studies.error_rates.summary import p_values

Rng = np.random.Generator
PERMUTATIONS = 199


def _pairs(rng: Rng) -> tuple[np.ndarray, np.ndarray]:
    """Two arms of 40 pairs that share what differs between pairs, skewed, without any difference."""
    common = rng.exponential(size=40)
    return common + 0.3 * rng.normal(size=40), common + 0.3 * rng.normal(size=40)


def _predictive(rng: Rng) -> dict[str, float]:
    """Poisson counts whose rate is known up to a gamma posterior, exactly."""
    rate = rng.gamma(50.0, size=(160, 1))
    data = rng.poisson(rate, size=(160, 20))
    drawn = rng.gamma(50 + data.sum(axis=1), 1 / 21, size=(100, 160)).T[..., None]
    replicated = rng.poisson(drawn, (160, 100, 20))
    observed, simulated = slice(0, 40), slice(40, 160)
    finding = predictive_check(
        data[observed], replicated[observed], data[simulated], replicated[simulated], rng=rng,
        permutations=PERMUTATIONS,
    )  # fmt: skip
    return {"detector.predictive_check": finding.p_value or np.nan}


def _embedding(rng: Rng) -> dict[str, float]:
    observed, simulated = rng.normal(size=(40, 3)), rng.normal(size=(160, 3))
    distance, difference = embedding_distance(observed, simulated, rng=rng, permutations=PERMUTATIONS)
    return {
        "detector.embedding_distance": distance.p_value or np.nan,
        "detector.embedding_mmd": difference.p_value or np.nan,
        "mmd": mmd(observed, simulated, rng=rng, permutations=PERMUTATIONS)[1],
    }


def _roc(rng: Rng) -> dict[str, float]:
    clean, suspicious = rng.normal(size=(3, 60)), rng.normal(size=(3, 4, 30))
    best = best_of_cells(clean, suspicious, rng=rng, permutations=PERMUTATIONS)
    return {
        "roc.permutation": permutation_p(clean[0], suspicious[0, 0], rng=rng, permutations=PERMUTATIONS),
        "roc.best_of_cells": float(np.min(best.p_adjusted)),
    }


def _paired(rng: Rng) -> dict[str, float]:
    first, second = _pairs(rng)
    stratum = np.repeat(np.arange(8), 10)
    values = stratum + rng.exponential(size=80)
    group = np.tile([False, True], 40)
    totals = rng.poisson(1000, size=(2, 40))
    by_counts = 2.0 * np.log(totals[1] / totals[0]) + rng.normal(size=40)
    return {
        "paired.permutation": paired_permutation(first, second, rng=rng, replicates=999).p_value,
        "paired.wilcoxon": wilcoxon_signed_rank(first, second).p_value,
        "paired.stratified": stratified_permutation(values, group, stratum, rng=rng, replicates=999).p_value,
        "paired.count_ratio": count_ratio_regression(by_counts, *totals, rng=rng, replicates=999).p_effect,
    }


def _classifiers(rng: Rng) -> dict[str, float]:
    found = classifier_two_sample(
        rng.normal(size=(60, 2)), rng.normal(size=(90, 2)), rng=rng, permutations=19, fit=_linear_fit
    )
    return {"two_sample.permutation": found.p_value, "two_sample.conformal": found.p_conformal}


def _linear_fit(rows: np.ndarray, labels: np.ndarray, seed: int) -> Callable[[np.ndarray], np.ndarray]:  # noqa: ARG001
    """Difference of means: a classifier that costs nothing."""
    direction = rows[labels].mean(axis=0) - rows[~labels].mean(axis=0)
    return lambda points: points @ direction


def _local(rng: Rng) -> dict[str, float]:
    """Trials of an exact estimator, and exact draws at one more observation."""
    exact = Moved(problem(2))
    theta = exact.problem.simulator.prior.sample(201, rng)
    x = exact.problem.simulator.simulate(theta, rng)
    draws = exact.sample(x, 40, rng)
    found = local_c2st(theta[1:], draws[1:], x[1:], draws[0], x[0], permutations=39, rng=rng)
    return {"local_c2st": found.p_global}


def _posterior(rng: Rng) -> dict[str, float]:
    """Calibration around an observation: truths of its posterior, draws given data simulated from these."""
    exact, simulator = Moved(problem(2)), problem(2).simulator
    observed = simulator.simulate(simulator.prior.sample(1, rng), rng)
    theta = exact.sample(observed, 300, rng)[0]
    draws = exact.sample(simulator.simulate(theta, rng), 60, rng)
    log_likelihood, of_truth = (simulator.log_likelihood(points, observed[0]) for points in (draws, theta))
    names, seed = ("theta_1", "theta_2"), int(rng.integers(2**31))
    findings = posterior_sbc_findings(theta, draws, log_likelihood, of_truth, names, seed=seed)
    return {finding.id: finding.p_value for finding in findings if not math.isnan(finding.p_value)}


def _nested(rng: Rng) -> dict[str, float]:
    """The insertion order of a run by a perfect sampler."""
    run = perfect_run(np.negative, live_points=50, depth=5, rng=rng)
    return {"insertion_order": insertion_order_test(run, rng=rng).p_value}


def _discrete(rng: Rng) -> dict[str, float]:
    return {"rank_ecdf (19 draws)": rank_ecdf_test(rng.integers(0, 20, size=100), 19, rng).p_value}


ALONE = (
    _predictive, _embedding, _roc, _paired, _classifiers, _local, _posterior, _nested, _discrete
)  # fmt: skip
"""Each from a generator to p-values by name. A new test of arrays gets a line here."""


def alone(seed: int) -> Mapping[str, float]:
    """P-values of all of them, each with random numbers of its own."""
    streams = np.random.SeedSequence(seed).spawn(len(ALONE))
    found: dict[str, float] = {}
    for test, stream in zip(ALONE, streams, strict=True):
        found |= test(np.random.default_rng(stream))
    return found


TRIALS, DRAWS = 500, 100
GROUPS: dict[str, tuple[int, int]] = {"importance": (50, 100), "joint": (300, 50)}


def _validators(simulator: Any, estimator: Any) -> Replicate:
    """P-values of all findings that have one, whatever validators there are."""

    def replicate(seed: int) -> Values:
        tree = collected(simulator, estimator, plan(TRIALS, DRAWS, seed, **GROUPS))
        findings, _ = run_validators(tree, seed=seed)
        return {finding.id: finding.p_value for finding in findings if not math.isnan(finding.p_value)}

    return replicate


def part() -> Part:
    """The part of the study."""
    mixture = build_simulator("gaussian_mixture")
    gaussian = problem(2)
    return Part(
        name="size",
        says=f"exact posteriors, {TRIALS} trials x {DRAWS} draws; and tests on arrays of their own",
        cases={
            "linear_gaussian": _validators(gaussian.simulator, Moved(gaussian)),
            "gaussian_mixture": _validators(mixture, build_estimator("exact", mixture)),
            "alone": alone,
        },
        replicates=1000,
        settings={"trials": TRIALS, "draws": DRAWS, **GROUPS, "alone": [test.__name__ for test in ALONE]},
        summarise=p_values,
    )
