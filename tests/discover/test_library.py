"""Candidates: where their parameters stand in theta, and that each is worked in once."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.library import Candidates, amplitude_places, gaps, proposed
from gaugeblock.simulators import Uniform
from gaugeblock.simulators.library import LibraryEffect

THETA = np.array([[1000.0, 1.5]])
AREA = LibraryEffect(
    name="effective_area",
    parameters={"area": Uniform(-0.5, 0.5), "energy": Uniform(0.6, 7.5), "width": Uniform(0.1, 5.0)},
    amplitude="area",
    neutral=0.0,
    step=0.02,
    scanned={"energy": [1.0, 2.0], "width": [0.3]},
    cause="",
    typical="",
)


@pytest.fixture(name="library")
def library_fixture(power_law):
    return Candidates.of(power_law(), THETA, own={"effective_area": AREA})


def test_values_of_an_effect_stand_behind_the_theta_before_it(library):
    area, dip = library["effective_area"], library["dip"]
    theta = area.at(THETA, np.array([0.1, 2.0, 0.3]))
    np.testing.assert_array_equal(theta, [[1000.0, 1.5, 0.1, 2.0, 0.3]])
    assert area.values(theta[0]) == {"area": 0.1, "energy": 2.0, "width": 0.3}
    assert (area.amplitude_index, dip.amplitude_index) == (-3, -1)
    many = area.at(np.zeros((4, 5, 2)), np.array([0.1, 2.0, 0.3]))
    assert many.shape == (4, 5, 5)
    found = amplitude_places(library.entries, ("dip", "effective_area", "line"), 2)
    assert [(key, entry.name, at) for key, entry, at in found] == [
        ("dip", "dip", 3), ("effective_area", "effective_area", 4), ("line", "line", 8)
    ]  # fmt: skip


def test_each_effect_is_worked_in_once_and_beside_those_before_it(library):
    assert len(library) == 4
    assert [one.key for one in library] == ["line", "dip", "edge", "effective_area"]
    assert library["dip"] is library["dip"]
    after = library.after("dip")
    assert after is library.after("dip")
    assert after["line"].simulator.prior.names == (
        "norm", "index", "dip_1.energy", "dip_1.depth", "line_1.energy", "line_1.counts"
    )  # fmt: skip


def test_a_search_without_effects_is_refused(power_law):
    class Bare:
        prior = power_law().prior

    with pytest.raises(InputError, match="Bare has no effect_library"):
        Candidates.of(Bare(), THETA)
    with pytest.raises(InputError, match="no effect glow; there are effective_area"):
        Candidates.of(Bare(), THETA, own={"effective_area": AREA}, only=("glow",))
    assert list(Candidates.of(Bare(), THETA, own={"effective_area": AREA}).entries) == ["effective_area"]


def test_an_energy_that_is_stated_and_effects_of_ones_own(power_law):
    """One's own replace the library's of that name; at an energy only those that have one are left."""
    own = {"dip": replace(AREA, name="dip")}
    made = Candidates.of(power_law(), THETA, own=own)
    assert list(made.entries) == ["line", "dip", "edge"]
    assert made.entries["dip"] is own["dip"]
    assert list(Candidates.of(power_law(), THETA, only=("edge", "line")).entries) == ["line", "edge"]
    (line,) = Candidates.of(power_law(), THETA, energy=2.0).entries.values()
    assert (line.name, line.scanned["energy"].tolist()) == ("line", [2.0])
    with pytest.raises(InputError, match=r"no effect glow, haze; there are line, dip, edge$"):
        Candidates.of(power_law(), THETA, only=("haze", "line", "glow"))

    class Gappy(power_law):
        def not_in_library(self):
            return {"glow": "its band is too hard", "haze": "it has no frame time"}

    with pytest.raises(InputError, match=r"no effect haze: it has no frame time$"):
        Candidates.of(Gappy(), THETA, only=("haze", "line"))
    with pytest.raises(InputError, match="an energy was stated, and no effect that is searched for has one"):
        Candidates.of(power_law(), THETA, only=("edge",), energy=2.0)
    with pytest.raises(InputError, match="the library holds no effect; give at least one"):
        Candidates(power_law(), {})

    class Sized(power_law):
        def effect_library(self, theta):
            assert theta.shape == (1, 2)
            return super().effect_library(theta)

    assert len(Candidates.of(Sized(), [1000.0, 1.5])) == 3


def test_one_library_for_several_simulators_is_scanned_at_the_same_values_in_all(power_law):
    """The first's entry counts; a source's effect is sought if one has it, an instrument's if all have it."""

    class Second(power_law):
        def effect_library(self, theta):
            made = super().effect_library(theta)
            glow = replace(made["edge"], name="glow")
            return {"glow": glow, "line": replace(made["line"], scanned={"energy": np.array([3.0])})}

        def not_in_library(self):
            return {"dip": "its area is not known", "haze": "no"}

    class Third(power_law):
        def not_in_library(self):
            return {"haze": "nobody knows", "mist": "it is dry"}

    first, second = power_law(), Second()
    assert list(proposed([first, second], THETA)) == ["line", "edge", "glow"]
    assert list(proposed([second, first], THETA)) == ["glow", "line", "edge"]
    assert len(proposed([first, second], THETA)["line"].scanned["energy"]) == 36
    assert len(proposed([second, first], THETA)["line"].scanned["energy"]) == 1
    assert list(proposed([first, second], THETA, own={"dip": AREA})) == ["line", "edge", "glow", "dip"]
    assert list(proposed([first, second], THETA, only=("glow",))) == ["glow"]
    with pytest.raises(InputError, match=r"no effect dip: its area is not known$"):
        proposed([first, second], THETA, only=("dip",))
    assert gaps([first, Third(), second]) == {
        "haze": "nobody knows", "mist": "it is dry", "dip": "its area is not known"
    }  # fmt: skip


def test_at_a_stated_energy_is_what_can_be_there(power_law):
    """Of several that have an energy those whose priors hold it; where none does, that is said."""
    library = power_law().effect_library(THETA)
    inside = {**library["edge"].parameters, "energy": Uniform(0.7, 0.8)}
    own = {"edge": replace(library["edge"], parameters=inside, energies=("energy",))}
    for energy, there in ((3.3, ["line"]), (0.75, ["edge", "line"])):
        found = Candidates.of(power_law(), THETA, own=own, energy=energy).entries
        assert sorted(found) == there
        assert all(one.scanned["energy"].tolist() == [energy] for one in found.values())
    with pytest.raises(
        InputError, match=r"effect edge: energies from 0\.7 to 0\.8 keV can be stated, got 3\.3"
    ):
        Candidates.of(power_law(), THETA, own=own, only=("edge",), energy=3.3)
