"""An instrument that floats beside an effect: as free as its priors say, and nothing at neutral."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.discovery.confirm.floated import AREA, FAR, floated, has_gain, near
from gaugeblock.simulators import Uniform
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.segments import Segment

THETA = np.array([[20_000.0, 1.5]])
SHIFT = LibraryEffect(
    name="gain_slope", parameters={"slope": Uniform(0.9, 1.1)}, amplitude="slope", neutral=1.0, step=0.01,
    cause="", typical="", origin="instrument",
)  # fmt: skip


def test_gain_and_area_float_and_change_nothing_at_neutral(power_law):
    simulator = power_law()
    made, start = floated(simulator, {}, ("line",), THETA, channels=60)
    assert start.shape == (1, 10)
    np.testing.assert_allclose(made.expected(start), simulator.expected(THETA))
    moved = start.copy()
    moved[:, 2:] = AREA
    np.testing.assert_allclose(made.expected(moved), simulator.expected(THETA) * np.exp(AREA))
    sizes = {one.sd for name, one in made.prior.marginals.items() if name.startswith("area")}
    assert sizes == {AREA}
    assert floated(simulator, {}, ("effective_area",), THETA, channels=60)[1].shape == (1, 2)


def test_no_area_floats_where_channels_have_no_energy(power_law):
    class Weeks(power_law):
        def segments(self):
            return (replace(super().segments()[0], unit="week"),)

    assert floated(Weeks(), {}, ("line",), THETA, channels=60)[1].tolist() == THETA.tolist()


def test_a_gain_that_the_library_has_floats_with_a_normal_prior(power_law):
    made, start = floated(power_law(), {"gain_slope": SHIFT}, ("line",), THETA, channels=60)
    assert made.prior.names[2] == "gain_slope_1.slope"
    assert (made.prior.marginals["gain_slope_1.slope"].mean, start[0, 2]) == (1.0, 1.0)
    assert made.prior.marginals["gain_slope_1.slope"].sd == pytest.approx(0.01)
    named = floated(power_law(), {"gain_slope": SHIFT}, ("gain_slope",), THETA, channels=60)[0]
    assert "gain_slope_1.slope" not in named.prior.names


def test_of_several_instruments_each_floats_unless_it_is_named(power_law):
    class Two(power_law):
        def segments(self):
            (whole,) = super().segments()
            return (Segment("a", 0, 30, whole.edges[:30]), Segment("b", 30, 60, whole.edges[30:]))

    entries = {"gain_slope[a]": SHIFT, "gain_slope[b]": replace(SHIFT, neutral=1.01)}
    made, start = floated(Two(), entries, ("line",), THETA, channels=60)
    assert made.prior.names[2:4] == ("gain_slope_1.slope", "gain_slope_2.slope")
    assert start[0, 2:4].tolist() == [1.0, 1.01]
    assert start.shape == (1, 20)
    named, start = floated(Two(), entries, ("line", "gain_slope[b]"), THETA, channels=60)
    assert (named.prior.names[2], start[0, 2], start.shape) == ("gain_slope_1.slope", 1.0, (1, 19))
    # The area of the one that is named does not float besides, the other's does.
    area, start = floated(Two(), {}, ("effective_area[b]",), THETA, channels=60)
    assert start.shape == (1, 10)
    moved = start.copy()
    moved[:, 2:] = AREA
    ratio = area.expected(moved) / area.expected(start)
    np.testing.assert_allclose(ratio[0], np.repeat([np.exp(AREA), 1.0], 30))


def test_what_has_a_gain_has_it_of_any_instrument_and_kind():
    assert has_gain([replace(SHIFT, name="line"), SHIFT])
    assert has_gain([replace(SHIFT, name="gain_curve")])
    assert not has_gain([replace(SHIFT, name="effective_area")])


def test_an_instrument_far_from_neutral_is_no_calibration(power_law):
    made, start = floated(power_law(), {"gain_slope": SHIFT}, ("line",), THETA, channels=60)
    for at, sd in ((2, 0.01), (3, AREA), (10, AREA)):
        for side in (-1.0, 1.0):
            moved = start[0].copy()
            moved[at] += side * 0.999 * FAR * sd
            assert near(made.prior, moved, 2)
            moved[at] += side * 0.002 * FAR * sd
            assert not near(made.prior, moved, 2)
    # What is not floated may be anywhere.
    assert near(made.prior, np.concatenate([[1e9, -50.0], start[0, 2:]]), 2)
