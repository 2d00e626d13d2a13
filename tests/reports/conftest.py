"""Small audits of an exact, a narrow and a samples-only Gaussian toy, with the real validators and judge."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
import xarray as xr

from gaugeblock.validate import Finding, Verdict, make_trials, trials_tree
from gaugeblock.validate.judge import judge
from gaugeblock.validate.policy import read_policy
from gaugeblock.validate.validators import run_validators

HOSTILE = "<script>alert('x')</script>&\"|`*_[a](b)"


@dataclass(frozen=True)
class Audit:
    verdict: Verdict
    findings: tuple[Finding, ...]
    trials: xr.DataTree


def gaussian_trials(
    *,
    n: int = 3000,
    draws: int = 100,
    width: float = 1.0,
    densities: bool = True,
    names: tuple[str, ...] = ("alpha", "beta"),
) -> xr.DataTree:
    """theta ~ N(0, 1), x ~ N(theta, 0.5): draws of the posterior N(0.8 x, 0.2), `width` times as wide."""
    rng = np.random.default_rng(11)
    dims = len(names)
    theta = rng.normal(size=(n, dims))
    x = theta + 0.5 * rng.normal(size=(n, dims))
    sd = width * np.sqrt(0.2)

    def sampled(first: int, size: int) -> xr.Dataset:
        noise = rng.normal(size=(first, size, dims))
        theta_drawn = 0.8 * x[:first, None] + sd * noise
        half_log = 0.5 * np.log(2 * np.pi)
        logs = {
            "log_q": (-0.5 * noise**2 - np.log(sd) - half_log).sum(-1),
            "log_prior": (-0.5 * theta_drawn**2 - half_log).sum(-1),
            "log_likelihood": (-2 * (x[:first, None] - theta_drawn) ** 2 - np.log(0.5) - half_log).sum(-1),
        }
        return make_trials(theta[:first], theta_drawn, names, **(logs if densities else {}))

    return trials_tree(sampled(n, draws), sampled(100, 200)) if densities else trials_tree(sampled(n, draws))


def audited(trials: xr.DataTree, *, policy: str = "default") -> Audit:
    findings, not_checked = run_validators(trials, seed=5)
    verdict = judge(findings, not_checked, read_policy(policy), seed=5)
    provenance = {
        "started": "2026-01-02T03:04:05Z",
        "seed": 5,
        "versions": {"gaugeblock": "0.1.0"},
        "sha256": {"policy": "ab" * 32},
        "command": f"gaugeblock audit --note {HOSTILE}",
        "policy": "error_budget = 0.05\n[tolerance]\nbias = 0.1\n",
        "not a number": float("nan"),
        "nothing": None,
    }
    return Audit(replace(verdict, provenance=provenance), findings, trials)


@pytest.fixture(scope="session")
def passing() -> Audit:
    return audited(gaussian_trials())


@pytest.fixture(scope="session")
def failing() -> Audit:
    """Posteriors 0.7 times as wide as they should be, and a parameter with a hostile name."""
    return audited(gaussian_trials(width=0.7, names=(HOSTILE, "beta")))


@pytest.fixture(scope="session")
def undecided() -> Audit:
    """Too few trials, no densities where the policy requires them."""
    return audited(gaussian_trials(n=60, densities=False), policy="strict")


@pytest.fixture(params=["passing", "failing", "undecided"])
def audit(request: pytest.FixtureRequest) -> Audit:
    chosen: Audit = request.getfixturevalue(request.param)
    return chosen


@pytest.fixture(scope="session")
def make_audit() -> Callable[..., Audit]:
    """`make_audit(policy=..., **gaussian_trials options)`, for audits of one test alone."""
    return lambda *, policy="default", **options: audited(gaussian_trials(**options), policy=policy)
