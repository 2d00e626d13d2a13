"""An audit may be enlarged and judged again: its rates hold over all looks, and forecasts over all faults."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import Outcome, judge, make_policy
from gaugeblock.validate.family import Judgeable, bounds
from gaugeblock.validate.finding import MeanFinding
from gaugeblock.validate.forecast import forecast
from gaugeblock.validate.looks import PASS_LEVEL, pass_level, share

TOLERANCE = 0.1
POLICY = make_policy({"required": ["sbc.bias"], "tolerance": {"bias": TOLERANCE}}, source="test")
SIZES = [1000 * 3**look // 2**look for look in range(8)]


def mean_of(values):
    """A finding of means ``(component, trial)``, as judged as a bias."""
    estimate = values.mean(axis=1)
    return MeanFinding(
        id="sbc.bias[a]",
        quantity="bias",
        claim="",
        null="",
        reference="",
        n_trials=values.shape[1],
        components=tuple(f"a{k}" for k in range(len(values))),
        estimate=estimate,
        standard_error=values.std(axis=1) / np.sqrt(values.shape[1]),
        influence=values - estimate[:, None],
    )


def test_looks_share_everything_and_no_more():
    assert sum(share(look) for look in range(1, 60)) == pytest.approx(1.0)
    assert all(share(look) > share(look + 1) > 0 for look in range(1, 30))
    assert pass_level(1) < pass_level(2) < 1
    # One look alone costs at most a tenth more trials, for PASS and for the power of a single comparison.
    for level in (PASS_LEVEL, 0.975):
        reach = [stats.norm.isf((1 - level) * part) + stats.norm.ppf(0.9) for part in (1.0, share(1))]
        assert (reach[1] / reach[0]) ** 2 < 1.1


def test_each_look_spends_its_share():
    item = Judgeable(finding=mean_of(np.random.default_rng(1).normal(size=(2, 500))), low=-0.1, high=0.1)
    first, second = (bounds([item], budget=0.05, number=1, seed=1, look=look)[0] for look in (1, 2))
    assert first.critical_next == second.critical > first.critical
    assert (second.low < first.low).all()
    assert (second.pass_high > first.pass_high).all()
    reach = (first.pass_high - item.finding.estimate) / item.finding.standard_error
    np.testing.assert_allclose(reach, stats.t.ppf(1 - 0.05 * 0.75, 499))
    one, _ = (2 * stats.t.sf(found.critical, 499) for found in (first, second))
    # Two components that are as good as independent.
    assert 1 - (1 - one) ** 2 == pytest.approx(0.05 * 0.75, rel=0.1)


@pytest.mark.parametrize("shape", ["normal", "t", "rare"])
def test_on_the_edge_eight_looks_pass_and_fail_in_at_most_five_percent_each(shape):
    """600 audits that are enlarged until they are settled, 1,000 to 17,000 trials; limit: 0.999 quantile."""
    rng = np.random.default_rng(3)
    passed = failed = late = 0
    reach = [
        (stats.norm.isf(0.05 * share(look)), stats.norm.isf(0.025 * share(look))) for look in range(1, 9)
    ]
    for _ in range(600):
        if shape == "normal":
            noise = rng.normal(size=SIZES[-1])
        elif shape == "t":
            noise = rng.standard_t(4, size=SIZES[-1]) / np.sqrt(2)
        else:
            noise = np.where(rng.random(SIZES[-1]) < 0.05, 1.0, 0.0)
            noise = (noise - 0.05) / np.sqrt(0.05 * 0.95)
        total = np.cumsum(TOLERANCE + noise)
        for look, size in enumerate(SIZES):
            z = (total[size - 1] / size - TOLERANCE) * np.sqrt(size)
            if z < -reach[look][0] or z > reach[look][1]:
                passed, failed = passed + (z < 0), failed + (z > 0)
                late += look > 0
                break
    limit = stats.binom.ppf(0.999, 600, 0.05)
    assert failed <= limit
    assert passed <= limit
    # The first look alone spends three quarters of it, and later ones are taken.
    assert min(passed, failed) >= stats.binom.ppf(0.001, 600, 0.05 * share(1) / 2)
    assert late


def test_the_judge_takes_the_share_of_the_look():
    """Between what PASSes at a first look and at a second one."""
    noise = np.random.default_rng(5).normal(size=(1, 1000))
    noise = (noise - noise.mean()) / noise.std()
    z = stats.norm.ppf([pass_level(1), pass_level(2)]).mean()
    found = mean_of(noise + TOLERANCE - z / np.sqrt(1000))
    said = [judge([found], [], POLICY, seed=1, look=look).outcome for look in (1, 2)]
    assert said == [Outcome.PASS, Outcome.INCONCLUSIVE]
    z = np.mean(
        [
            bounds([Judgeable(finding=found, low=-1, high=1)], budget=0.05, number=1, seed=1, look=look)[
                0
            ].critical
            for look in (1, 2)
        ]
    )
    found = mean_of(noise + TOLERANCE + z / np.sqrt(1000))
    said = [judge([found], [], POLICY, seed=1, look=look).outcome for look in (1, 2)]
    assert said == [Outcome.FAIL, Outcome.INCONCLUSIVE]


@pytest.mark.parametrize("components", [1, 8])
def test_ranges_hold_eight_of_ten_futures(components):
    """Faults spread around the edge; audits of 400 trials, 95 to 99% limits on 0.8 of those INCONCLUSIVE."""
    rng = np.random.default_rng(components)
    n, held, asked = 400, 0, 0
    sizes = n * 1.15 ** np.arange(1, 62)
    while asked < 300:
        fault = rng.normal(0, 0.15, size=components)
        values = fault[:, None] + rng.normal(size=(components, n))
        finding = mean_of(values)
        item = Judgeable(finding=finding, low=-TOLERANCE, high=TOLERANCE)
        (bound,) = bounds([item], budget=0.05, number=1, seed=1)
        outside = (bound.low > TOLERANCE) | (bound.high < -TOLERANCE)
        inside = (bound.pass_low >= -TOLERANCE) & (bound.pass_high <= TOLERANCE)
        if outside.any() or inside.all():
            continue
        asked += 1
        found = forecast(item, bound, look=1, seed=asked)
        total, done, settled = finding.estimate * n, float(n), np.inf
        for size in sizes:
            more = size - done
            total = total + more * fault + np.sqrt(more) * rng.normal(size=components)
            done = size
            mean, reach = total / size, np.array([stats.norm.ppf(1 - 0.05 / 8), bound.critical_next])
            reach = reach / np.sqrt(size)
            if (np.abs(mean) > TOLERANCE + reach[1]).any() or (np.abs(mean) <= TOLERANCE - reach[0]).all():
                settled = size
                break
        low, high = (np.inf if edge is None else edge for edge in found)
        held += low <= settled * 1.1 and settled <= high
    assert stats.binom.ppf(0.001, asked, 0.76) <= held <= stats.binom.ppf(0.999, asked, 0.9)


def test_what_lies_on_the_edge_is_said_to():
    noise = np.random.default_rng(7).normal(size=(1, 10**6))
    finding = mean_of(noise - noise.mean() + TOLERANCE)
    item = Judgeable(finding=finding, low=-TOLERANCE, high=TOLERANCE)
    (bound,) = bounds([item], budget=0.05, number=1, seed=1)
    found = forecast(item, bound, look=1, seed=1)
    assert found.high is None or found.high > 10**7
    clear = Judgeable(finding=mean_of(noise[:, :400] - noise[:, :400].mean()), low=-0.15, high=0.15)
    near = forecast(clear, bound, look=1, seed=1)
    assert str(near) == f"{near.low:,} to {near.high:,} would"
    assert 400 < near.low < 1500
