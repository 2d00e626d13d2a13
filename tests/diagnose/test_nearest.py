"""What is said of a fault that has no name: what comes nearest, its causes, the next best."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from tests.diagnose.test_calls import QUICK

import gaugeblock as gb
from gaugeblock.diagnosis.causes import causes
from gaugeblock.diagnosis.diagnosis import next_best


@pytest.mark.parametrize(("size", "share", "nearest"), [(2.5, 0.5, True), (30.0, 0.004, False)])
def test_what_has_no_name_says_the_causes_of_what_comes_nearest(size, share, nearest):
    """Some draws so many times as far out: a width takes most of it away; where they are few, hardly any."""
    rng = np.random.default_rng([1, 2])
    middle = rng.normal(size=(1000, 1))
    theta = middle + 0.5 * rng.normal(size=(1000, 1))
    away = 0.5 * rng.normal(size=(1000, 128, 1))
    draws = middle[:, None] + away * np.where(rng.random(away.shape) < share, size, 1.0)
    found = gb.audit_draws(theta, draws, x=middle, names=["a"], progress=False, **QUICK).diagnose()
    wide = {cause.cause for cause in causes("scale", wide=True)}
    if nearest:
        assert found.named == "other"
        assert "scale" in found.text.partition(" would take ")[0]
        assert wide <= {cause.cause for cause in found.causes}
        assert found.runner_up not in (None, "scale")
    else:
        assert not wide & {cause.cause for cause in found.causes}


def test_the_runner_up_takes_most_of_those_that_are_not_named():
    def tried(share, *symptoms):
        repairs = tuple(SimpleNamespace(symptom=one) for one in symptoms)
        return SimpleNamespace(repairs=repairs, symptoms=symptoms, share=share)

    every = (
        tried(0.0),
        tried(0.9, "scale"),
        tried(0.5, "shift"),
        tried(0.7, "skew"),
        tried(0.8, "skew", "log"),
    )
    assert next_best(SimpleNamespace(tried=every), ("scale",)) == "skew"
    assert next_best(SimpleNamespace(tried=every), ("scale", "skew", "shift")) is None
    assert next_best(SimpleNamespace(tried=(tried(-0.1, "shift"),)), ()) is None
