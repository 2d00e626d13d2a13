"""Forecasts of how many trials settle a gate are ranges: eight of ten futures settle in theirs."""

from __future__ import annotations

import numpy as np

from gaugeblock.validate.family import Judgeable, bounds
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
