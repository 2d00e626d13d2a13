"""Smallest faults from hand-made controls, against a scan over sizes."""

import math

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from gaugeblock.validate.controls.ladder import LARGEST, RUNGS, ladder
from gaugeblock.validate.family import bounds_at
from gaugeblock.validate.finding import PValueFinding, QuantileFinding, RootFinding
from gaugeblock.validate.policy import make_policy

POLICY = make_policy(
    {"tolerance": {"bias": 0.12, "log_width": 0.2, "local": 0.03}, "planning": {"power": 0.8}}, source="test"
)
WORDS = {"quantity": "", "claim": "", "null": "", "reference": "", "n_trials": 60}


def bias(shift=0.3):
    """A rising mean of 60 trials that crosses 0 at some place."""
    place = np.linspace(-12, 12, 97)
    scores = np.random.default_rng(1).uniform(-0.4, 0.4, 60)
    return RootFinding(
        id="controls.bias[a b]", **WORDS, estimate=np.array([shift]), standard_error=np.array([0.1]),
        curve=np.tanh(0.5 * (place - shift))[None] / 2, place=place, influence=(scores - scores.mean())[None],
    )  # fmt: skip


def width(still=0.0, n=60):
    """Log widths of two components, some of which no stretch would move."""
    rng = np.random.default_rng(2)
    values = rng.normal([[0.1], [-0.2]], [[0.5], [0.3]], (2, n))
    fixed = rng.random((2, n)) < still
    found = np.median(values, axis=1)
    return QuantileFinding(
        id="controls.width[a]", **WORDS | {"n_trials": n}, estimate=found, standard_error=np.ones(2),
        values=np.where(fixed, 0.0, values), quantile=np.array([0.5, 0.4]),
        details=xr.Dataset({"still": (("component", "trial"), fixed)}),
    )  # fmt: skip


def made(finding, reach, name):
    (control,) = ladder([finding], {name: reach, "other": 1.0}, POLICY)
    return control


@pytest.mark.parametrize("shift", [0.3, -0.7])
def test_a_bias_is_caught_where_the_farther_bound_is_beyond_the_tolerance(shift):
    control = made(bias(shift), 2.5, "sbc.bias[a b]")
    low, high = bounds_at(bias(shift), stats.t.sf(2.5 + stats.norm.ppf(0.8), 59), 59)
    size = 0.12 + max(shift - low[0], high[0] - shift)
    assert control.size == pytest.approx(size)
    assert (control.kind, control.parameter, control.unit) == ("bias", "a b", "half-widths")
    assert (control.caught, control.tolerance, control.power) == (True, 0.12, 0.8)
    assert control.text == f"a bias of {size:.2g} half-widths"
    steps = 0.12 * np.array([1, 2**0.5, 2, 2**1.5, 4, 2**2.5, 8])
    np.testing.assert_allclose(RUNGS * 0.12, steps)
    assert control.rungs == tuple((float(step), bool(step >= size)) for step in 0.12 * RUNGS)
    assert 0 < sum(caught for _, caught in control.rungs) < 7
    far = made(bias(shift), 20.0, "sbc.bias[a b]")
    assert (far.caught, far.size, far.text) == (False, 10.0, "a bias of 10 half-widths")
    assert not any(caught for _, caught in far.rungs)


@pytest.mark.parametrize("still", [0.0, 0.15])
def test_a_width_is_caught_from_the_size_at_which_both_signs_are(still):
    """Draws that no stretch widens stay; a scan over sizes, to what eleven halvings resolve."""
    finding = width(still)
    tail = stats.t.sf(2.0 + stats.norm.ppf(0.8), 59)
    fixed, smallest = finding.details["still"].values, {}
    for sign in (1, -1):
        for size in np.arange(0.2, 3.0, 5e-4):
            moved = finding.values + np.where(fixed, 0.0, sign * size - finding.estimate[:, None])
            kept = QuantileFinding(**{**vars(finding), "values": moved})
            low, high = bounds_at(kept, tail, 59)
            if (low > 0.2).any() if sign > 0 else (high < -0.2).any():
                smallest[sign] = size
                break
    control = made(finding, 2.0, "sbc.log_width[a]")
    assert control.size == pytest.approx(max(smallest.values()), abs=2.8 / 2**11 + 5e-4)
    assert (control.kind, control.parameter, control.unit) == ("width", "a", "natural log of the width")
    assert (control.caught, control.tolerance) == (True, 0.2)
    narrow, wide = math.exp(-smallest[-1]), math.exp(smallest[1])
    said = control.text.split()
    assert said[0] == "widths"
    assert float(said[1]) == pytest.approx(narrow, rel=0.02)
    assert float(said[3]) == pytest.approx(wide, rel=0.02)
    assert said[4:] == ["times", "what", "they", "should", "be"]
    assert [caught for _, caught in control.rungs] == [rung >= control.size for rung in 0.2 * RUNGS]


def test_a_width_that_hardly_anything_moves_is_not_caught():
    control = made(width(0.97), 3.0, "sbc.log_width[a]")
    assert (control.caught, control.size) == (False, LARGEST["width"])
    assert not any(caught for _, caught in control.rungs)


def test_reach_is_of_the_gate_of_the_same_parameter():
    other = PValueFinding(id="sbc.bias[a b]", **WORDS, estimate=np.zeros(1), standard_error=np.ones(1))
    assert ladder([bias(), other], {"sbc.bias[a]": 2.0, "sbc.log_width[a b]": 2.0}, POLICY) == ()
    found = ladder([other, width(), bias()], {"sbc.bias[a b]": 2.0, "sbc.log_width[a]": 2.0}, POLICY)
    assert [(one.kind, one.parameter) for one in found] == [("width", "a"), ("bias", "a b")]
