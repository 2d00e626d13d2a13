"""Exact and broken estimators of a conjugate Gaussian problem, as Trials, without any package code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr
from scipy import special

from gaugeblock.validate import Finding, make_trials
from gaugeblock.validate.marginal.half_widths import bias_finding, half_width_scores, log_width_finding
from gaugeblock.validate.ranks import randomised_pit

SD = np.sqrt(0.5)


def _normal(x: Any, mean: Any, sd: float) -> np.ndarray:
    return (-0.5 * ((x - mean) / sd) ** 2 - np.log(sd) - 0.5 * np.log(2 * np.pi)).sum(axis=-1)


def gaussian(
    n: int,
    draws: int,
    dimensions: int,
    *,
    seed: int,
    ratio: float = 1.0,
    bias: float = 0.0,
    density: bool = True,
    log_q_noise: float = 0.0,
    **extra: Any,
) -> xr.Dataset:
    """theta ~ N(0, 1), x ~ N(theta, 1), q = N(posterior mean + bias sd, (ratio sd)^2)."""
    rng = np.random.default_rng(seed)
    theta = rng.normal(size=(n, dimensions))
    x = theta + rng.normal(size=(n, dimensions))
    centre = (x / 2 + bias * SD)[:, None]
    sampled = centre + ratio * SD * rng.normal(size=(n, draws, dimensions))
    if density:
        extra |= {
            "log_q": _normal(sampled, centre, ratio * SD) + log_q_noise * rng.normal(size=(n, draws)),
            "log_prior": _normal(sampled, 0.0, 1.0),
            "log_likelihood": _normal(x[:, None], sampled, 1.0),
        }
    return make_trials(theta, sampled, [f"p{i}" for i in range(dimensions)], x=x, **extra)


@pytest.fixture(scope="session")
def marginal_findings() -> Callable[..., list[Finding]]:
    """Bias and log width of one parameter: of truths and draws, or of normal errors ``(trial,)`` alone."""
    grid = special.ndtri((np.arange(199) + 0.5) / 199)

    def found(name: str, truth: Any, draws: Any = None, *, seed: int = 0) -> list[Finding]:
        if draws is None:
            truth, draws = -np.asarray(truth)[:, None], np.tile(grid[None, :, None], (len(truth), 1, 1))
        scores = np.concatenate(half_width_scores(truth, draws), axis=-1)[:, 0]
        pit = randomised_pit(truth, draws, np.random.default_rng([seed, 5]))[:, 0]
        return [
            bias_finding(name, scores, pit),
            log_width_finding(name, scores, pit, draws=draws.shape[1]),
        ]

    return found


@pytest.fixture(scope="session")
def gaussian_trials() -> Callable[..., xr.Dataset]:
    return gaussian


@pytest.fixture(scope="session")
def zoo_trials() -> Callable[..., xr.DataTree]:
    """Trials of a member of the zoo, or of the exact posterior, as an audit collects them, in memory.

    Two parameters whose posterior has sd 0.55 and correlation -0.67, data along which it moves.
    """
    from gaugeblock.auditing.samples import ImportanceTrials, JointTrials, MainTrials, Plan
    from gaugeblock.estimators import build_estimator
    from gaugeblock.estimators.broken import WithTruth
    from gaugeblock.estimators.protocol import has_density
    from gaugeblock.simulators import build_simulator
    from gaugeblock.validate import trials_tree

    def collected(fault: str | None, n: int, draws: int, *, seed: int, **options: Any) -> xr.DataTree:
        own = {"name": "linear_gaussian", "matrix": [[1.0, 1.0], [0.5, 0.0], [0.0, 0.5]]}
        simulator = build_simulator(**options.pop("simulator", own))
        if options.pop("leaky", fault == "leaking"):
            simulator = WithTruth(simulator)
        chosen = {"fault": fault, **options} if fault else {}
        estimator = build_estimator("broken" if fault else "exact", simulator, **chosen)
        plan = Plan(
            number=n,
            draws=draws,
            block=n,
            importance_number=min(n, 100),
            importance_draws=200,
            joint_number=min(n, 1000),
            joint_draws=min(draws, 100),
            seed=seed,
        )
        main = MainTrials(simulator, estimator, plan)(range(n))
        weighed, first = None, lambda trials: main.isel(trial=slice(len(trials)))
        if has_density(estimator):
            weighed = ImportanceTrials(simulator, estimator, plan, first)(range(plan.importance_number))
        joint = JointTrials(simulator, estimator, plan, first)(range(plan.joint_number))
        return trials_tree(main, weighed, joint=joint)

    return collected


@pytest.fixture
def quick_judging(monkeypatch: pytest.MonkeyPatch) -> None:
    """For rates over many audits: fewer replicates, and no forecasts, which nobody reads there.

    10,000 replicates know the share beyond a critical value, 4%, to 0.2%: little beside binomial limits.
    """
    monkeypatch.setattr("gaugeblock.validate.family.REPLICATES", 10_000)
    monkeypatch.setattr("gaugeblock.validate.forecast.FUTURES", 1)
