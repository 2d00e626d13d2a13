from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from gaugeblock.validate import Finding, NotChecked, Outcome, judge, make_policy, make_trials
from gaugeblock.validate.features import TrialFeatures
from gaugeblock.validate.learned.lc2st import LEVELS, feature_regions, largest_gap, lc2st, local_finding
from gaugeblock.validate.local.regions import quantile_regions
from gaugeblock.validate.prepared import Prepared


def audit(n: int, *, seed: int, fault: float = 0.0, data: bool = True, draws: int = 40, **extra) -> Prepared:
    """theta ~ N(0, 1), x ~ N(theta, 1); draws displaced by `fault` sd where x > 1."""
    rng = np.random.default_rng([seed, n])
    theta = rng.normal(size=(n, 1))
    x = theta + rng.normal(size=(n, 1))
    sampled = x[:, None] / 2 + np.sqrt(0.5) * (rng.normal(size=(n, draws, 1)) + fault * (x > 1)[:, None])
    trials = make_trials(theta, sampled, ["a"], x=x if data else None)
    for name, values in extra.items():
        trials[name] = ("trial", values)
    return Prepared(xr.DataTree(trials), seed)


def one(prepared: Prepared) -> Finding:
    (found,) = lc2st(prepared)
    assert isinstance(found, Finding)
    return found


def test_a_local_fault_is_seen_where_it_is():
    found = one(audit(2000, seed=1, fault=1.0))
    assert found.p_value == 1e-3
    worst = str(found.details["region"].values[0])
    low = float(worst.split()[1])
    assert worst.startswith("total")
    assert low > 0.8  # the upper quarter of x ~ N(0, 2) begins at 0.95
    middle = list(LEVELS).index(0.5)
    gap = {
        str(r): g for r, g in zip(found.details["region"].values, found.details["gap"].values, strict=True)
    }
    assert gap[worst][middle] < -0.1
    assert all(abs(g[middle]) < 0.1 for r, g in gap.items() if r != worst)
    policy = make_policy({"required": ["lc2st"]}, source="test")
    verdict = judge([found], [], policy, seed=0)
    assert verdict.outcome is Outcome.FAIL
    assert "total" in verdict.gates[0].component
    assert verdict.gates[0].component.endswith(tuple(f"@ {level:g}" for level in LEVELS))


def test_size_of_the_p_value():
    """100 exact audits of 260 trials: rejections at 5% within the 0.999 binomial limit."""
    p = [one(audit(260, seed=s, draws=10)).p_value for s in range(100)]
    assert np.count_nonzero(np.array(p) <= 0.05) <= stats.binom.ppf(0.999, 100, 0.05)
    assert np.median(p) < 0.8


def test_p_value_of_the_largest_gap():
    """Uniform ranks in overlapping regions, 400 replicates of 99: exact within 0.999 binomial limits."""
    rng = np.random.default_rng(2)
    member = rng.random((5, 60)) < 0.4
    p = np.array([largest_gap(rng.random(60), member, seed=s, replicates=99)[0] for s in range(400)])
    assert np.count_nonzero(p <= 0.05) <= stats.binom.ppf(0.999, 400, 0.05)
    # Counts of 20 or so tie, so it is a little conservative, but no more than a little.
    assert np.count_nonzero(p <= 0.1) >= stats.binom.ppf(0.001, 400, 0.06)
    assert largest_gap(np.full(60, 0.999), member, seed=0, replicates=99)[0] == 0.01


def test_influences_agree_with_the_errors():
    rng = np.random.default_rng(3)
    u, x = rng.random(900), rng.normal(size=900)
    found = local_finding(
        u, [quantile_regions("total", x)], row=np.arange(100, 1000), n=1000, order=np.argsort(x), seed=0
    )
    assert found.influence.shape == (12, 1000)
    assert (found.influence[:, :100] == 0).all()
    np.testing.assert_allclose(found.influence.mean(axis=1), 0, atol=1e-12)
    error = np.sqrt((found.influence**2).mean(axis=1) / 1000)
    # Apart from what steadies extreme levels in regions of few trials.
    np.testing.assert_allclose(error[1::3], found.standard_error[1::3], rtol=0.01)
    assert (found.standard_error > 0.99 * error).all()


def test_features_of_the_users_own_come_first():
    rng = np.random.default_rng(4)
    names = ("total", *(f"component {k}" for k in range(1, 9)), "exposure", "broken")
    values = rng.normal(size=(600, 11))
    values[3, 10] = np.nan
    chosen = [regions.name for regions in feature_regions(TrialFeatures(names, values), np.arange(500))]
    assert chosen[:2] == ["total", "exposure"]
    assert "broken" not in chosen
    assert len(chosen) == 8


def test_what_cannot_be_checked_is_said():
    (without,) = lc2st(audit(400, seed=5, data=False))
    assert isinstance(without, NotChecked)
    assert "make_trials takes them as x" in without.why
    (few,) = lc2st(audit(239, seed=5))
    assert isinstance(few, NotChecked)
    assert "at least 240" in few.why
    assert isinstance(one(audit(240, seed=5)), Finding)
    (constant,) = lc2st(audit(300, seed=6, data=False, exposure=np.ones(300)))
    assert isinstance(constant, NotChecked)
    assert "no feature" in constant.why


@pytest.mark.parametrize("seed", [0, 1])
def test_the_same_seed_gives_the_same_bits(seed):
    first, second = (one(audit(300, seed=seed)) for _ in range(2))
    xr.testing.assert_identical(first.to_dataset(), second.to_dataset())
