"""Forecasts of how many trials settle a gate are ranges: eight of ten futures settle in theirs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.family import Judgeable, bounds, pass_level
from gaugeblock.validate.finding import MeanFinding, QuantileFinding
from gaugeblock.validate.forecast import GROWTH, LOOKS, forecast

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


def test_a_range_is_that_of_futures_followed_one_by_one():
    """A fault that is hardly known, in a loop that draws trials' means for one future after the other."""
    n, sd = 30, 0.8
    noise = np.random.default_rng(8).normal(size=(1, n))
    noise = sd * (noise - noise.mean()) / noise.std()
    item = Judgeable(finding=mean_of(noise), low=-TOLERANCE, high=TOLERANCE)
    (bound,) = bounds([item], budget=0.05, number=1, seed=1)
    found = forecast(item, bound, look=1, seed=1)
    rng, error = np.random.default_rng(9), sd / np.sqrt(n)
    reach = stats.norm.ppf(pass_level(2))
    settled = []
    for _ in range(2000):
        fault, total, before = rng.normal(0, error), 0.0, n
        for look in range(1, LOOKS + 1):
            after = n * GROWTH**look
            total += (after - before) * fault + np.sqrt(after - before) * rng.normal(0, sd)
            mean, spread, before = total / after, sd / np.sqrt(after), after
            if (
                abs(mean) + reach * spread <= TOLERANCE
                or abs(mean) - bound.next_critical * spread > TOLERANCE
            ):
                break
        settled.append(after)
    low, high = np.quantile(settled, [0.1, 0.9])
    # A tenth of 500 futures lies within a look or two of where a tenth of all does.
    assert low / GROWTH**2 <= found.low <= low * GROWTH**2
    assert high / GROWTH**3 <= found.high <= high * GROWTH**3


@pytest.mark.parametrize("sense", ["at-least", "at-most"])
def test_a_one_sided_quantile_is_forecast_as_the_share_on_its_wrong_side(sense):
    values, sign = np.random.default_rng(10).normal(size=(1, 200)), 1 if sense == "at-least" else -1
    edge, q = sign * -1.1, 0.1 if sense == "at-least" else 0.9
    said = {"id": "importance.ess", "quantity": "efficiency", "claim": "", "null": "", "reference": ""}
    quantile = QuantileFinding(
        **said, n_trials=200, sense=sense, values=values, quantile=np.array([q]),
        estimate=np.quantile(values, q, axis=1), standard_error=np.array([0.1]),
    )  # fmt: skip
    item = Judgeable(
        finding=quantile,
        low=edge if sense == "at-least" else -np.inf,
        high=np.inf if sense == "at-least" else edge,
    )
    wrong = (sign * values < -1.1).astype(float) - 0.1
    share = replace(mean_of(wrong), standard_error=np.array([0.3 / np.sqrt(200)]))
    same = Judgeable(finding=share, low=-np.inf, high=0.0)
    (bound,) = bounds([same], budget=0.05, number=1, seed=1)
    found = forecast(item, bound, look=1, seed=3)
    assert found == forecast(same, bound, look=1, seed=3)
    assert 200 < found.low < found.high
