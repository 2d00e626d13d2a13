"""Forecasts of how many trials settle a gate are ranges: eight of ten futures settle in theirs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.family import Judgeable, bounds, pass_level
from gaugeblock.validate.finding import MeanFinding
from gaugeblock.validate.forecast import forecast

TOLERANCE = 0.1


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
            mean, reach = total / size, np.array([stats.norm.ppf(pass_level(2)), bound.next_critical])
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
