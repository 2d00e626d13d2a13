"""What an effect's values cost before any count was seen, and where they stand at a limit."""

import numpy as np
import pytest

from gaugeblock.simulators import LogUniform, Uniform
from gaugeblock.simulators.library import LibraryEffect


def effect(**given):
    return LibraryEffect(
        name="line", parameters={"width": LogUniform(0.01, 1.0), "size": Uniform(0.0, 4.0)}, amplitude="size",
        step=0.1, scanned={"width": np.array([0.1])}, cause="", typical="", **given,
    )  # fmt: skip


def test_a_factor_of_e_beyond_what_is_usual_costs_three_nats():
    line = effect(usual={"size": (0.0, 0.5), "width": (0.05, 0.2)})
    assert line.cost({"size": 0.4, "width": 0.1}) == 0.0
    assert line.cost({"size": 0.5 * np.e, "width": 0.1}) == pytest.approx(3.0)
    assert line.cost({"size": 0.4, "width": 0.2 * np.e**2}) == pytest.approx(6.0)
    assert line.cost({"size": 0.4, "width": 0.05 / np.e}) == pytest.approx(3.0)


def test_an_amplitude_counts_from_neutral_on_either_side():
    slope = LibraryEffect(
        name="slope", parameters={"slope": Uniform(0.9, 1.1)}, amplitude="slope", neutral=1.0, step=0.01,
        usual={"slope": (0.97, 1.03)}, cause="", typical="",
    )  # fmt: skip
    assert slope.cost({"slope": 0.98}) == 0.0
    assert slope.cost({"slope": 0.94}) == pytest.approx(3.0 * np.log(2.0))
    assert slope.cost({"slope": 1.06}) == pytest.approx(3.0 * np.log(2.0))
    assert slope.at_limit({"slope": 0.9}) == slope.at_limit({"slope": 1.1}) == ("slope",)
    assert slope.at_limit({"slope": 0.901}) == ()


def test_odds_and_derived_sizes_count():
    line = effect(
        odds=0.5, usual={"area": (0.0, 0.1)}, derived={"area": lambda one: one["size"] * one["width"]}
    )
    assert line.cost({"size": 1.0, "width": 0.05}) == pytest.approx(np.log(2.0))
    assert line.cost({"size": 2.0, "width": 0.1}) == pytest.approx(np.log(2.0) + 3.0 * np.log(2.0))


def test_limits_are_the_far_end_of_the_amplitude_and_the_ends_that_are_listed():
    assert effect().at_limit({"size": 4.0, "width": 1.0}) == ("size",)
    assert effect(ends=("width",)).at_limit({"size": 0.0, "width": 1.0}) == ("width",)
    assert effect(ends=("width",)).at_limit({"size": 3.9, "width": 0.01}) == ()
