"""Forecasts of how many trials settle a gate are ranges: eight of ten futures settle in theirs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import forecast as module
from gaugeblock.validate.family import Judgeable, bounds, pass_level
from gaugeblock.validate.finding import MeanFinding, QuantileFinding
from gaugeblock.validate.forecast import GROWTH, LOOKS, Forecast, forecast

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
    assert found.high > 10**8
    assert str(found) == (
        f"{found.low:,} to {found.high:,} would, but it may lie on the edge of what is tolerated"
    )
    clear = Judgeable(finding=mean_of(noise[:, :400] - noise[:, :400].mean()), low=-0.15, high=0.15)
    near = forecast(clear, bound, look=1, seed=1)
    assert str(near) == f"{near.low:,} to {near.high:,} would"
    assert 400 < near.low < 1500
    assert near.high <= 50 * near.low


@pytest.mark.parametrize(("off", "edged"), [(0.5, True), (-0.5, True), (1.6, False), (-1.6, False)])
def test_within_an_error_of_the_edge_it_may_lie_there(off, edged):
    noise = np.random.default_rng(7).normal(size=(1, 900))
    finding = mean_of((noise - noise.mean()) / noise.std() + 0.2 + off / 30)
    item = Judgeable(finding=finding, low=-0.2, high=0.2)
    (bound,) = bounds([item], budget=0.05, number=1, seed=1)
    assert ("edge" in str(forecast(item, bound, look=1, seed=1))) is edged


def test_what_no_number_of_trials_that_was_looked_at_settles_may_lie_on_the_edge():
    said = "it may lie on the edge of what is tolerated, which no number of trials would settle"
    assert {str(Forecast(None, None)), str(Forecast(1200, None))} == {said}


@pytest.mark.parametrize(("components", "known"), [(1, 1.0), (5, 0.4)])
def test_a_range_is_that_of_futures_followed_one_by_one(components, known, monkeypatch):
    """A fault that is hardly known, in a loop that draws trials' means and ends no future before its time.

    Of five estimates that are one error off each, James and Stein leave 1 - 3 / 5.
    """
    n, sd = 30, 0.8
    error = sd / np.sqrt(n)
    noise = np.random.default_rng(8).normal(size=(components, n))
    noise = np.linalg.qr((noise - noise.mean(axis=1, keepdims=True)).T)[0].T * sd * np.sqrt(n)
    off = 0.0 if components == 1 else error
    item = Judgeable(finding=mean_of(noise + off), low=-TOLERANCE, high=TOLERANCE)
    (bound,) = bounds([item], budget=0.05, number=1, seed=1)
    monkeypatch.setattr(module, "FUTURES", 40_000)
    found = forecast(item, bound, look=1, seed=1)
    rng, shape = np.random.default_rng(9), (40_000, components)
    reach = stats.norm.ppf(pass_level(2))
    fault = known * off + np.sqrt(known) * rng.normal(0, error, shape)
    total, before, settled = n * off, n, np.full(len(fault), np.inf)
    for look in range(2, LOOKS):  # not at less than a tenth more
        after = n * GROWTH**look
        total = total + (after - before) * fault + np.sqrt(after - before) * rng.normal(0, sd, shape)
        far, spread, before = np.abs(total / after).max(axis=1), sd / np.sqrt(after), after
        ends = (far + reach * spread <= TOLERANCE) | (far - bound.next_critical * spread > TOLERANCE)
        settled = np.where(ends, np.minimum(settled, after), settled)
    # Four errors of shares of 40,000 beside as many: 0.009.
    unit = {end: 10 ** (len(str(end)) - 2) for end in found}
    assert np.mean(settled < found.low) <= 0.1 + 0.009
    assert np.mean(settled < found.low + unit[found.low]) >= 0.1 - 0.009
    # Of all numbers of two digits the upper end holds the share that is nearest to eight of ten.
    off = [
        abs(np.mean((found.low <= settled) & (settled <= found.high + step * unit[found.high])) - 0.8)
        for step in (-1, 0, 1)
    ]
    assert off[1] <= min(off) + 0.009


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
