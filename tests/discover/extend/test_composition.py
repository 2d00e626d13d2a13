import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.extend import extended
from gaugeblock.simulators import Effect, Uniform
from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.simulators.two_moons import TwoMoons


def test_effects_join_the_prior_behind_the_simulator_s_own_parameters(line, parabola, kink):
    both = extended(line, [parabola, kink])
    assert both.prior.names == ("level", "slope", "bend_1.amplitude", "bend_2.amplitude")
    assert both.prior.names == extended(extended(line, parabola), kink).prior.names
    theta = np.array([0.3, -0.2, 1.1, -0.7])
    np.testing.assert_allclose(
        both.expected(theta), line.expected(theta[:2]) + 1.1 * parabola.kind - 0.7 * kink.kind
    )


def test_an_entry_of_a_library_brings_all_its_parameters(epidemic):
    entry = epidemic.effect_library(epidemic.prior.center[None])["reporting_step"]
    assert extended(epidemic, entry).prior.names[2:] == ("reporting_step_1.share", "reporting_step_1.week")
    fixed = extended(epidemic, entry.effect(week=4.0))
    assert fixed.prior.names[2:] == ("reporting_step_1.share",)


@pytest.mark.parametrize("effects", [[], ()])
def test_nothing_to_add_is_said(line, effects):
    with pytest.raises(InputError, match="no effect given"):
        extended(line, effects)


def test_a_simulator_that_takes_no_effects_is_said():
    with pytest.raises(InputError, match="TwoMoons has no with_effect"):
        extended(TwoMoons(), Effect("gain_slope", {"slope": 1.02}))


def test_what_the_simulator_does_not_know_is_said(epidemic):
    entry = LibraryEffect(
        name="gremlins", parameters={"size": Uniform(0.0, 1.0)}, amplitude="size", neutral=0.0, step=0.1,
        cause="", typical="",
    )  # fmt: skip
    with pytest.raises(InputError, match="gremlins"):
        extended(epidemic, entry)
