"""What an effect's values cost before any count was seen, where they stand at a limit, what is scanned."""

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import Effect, Gamma, LogUniform, Normal, Prior, Uniform
from gaugeblock.simulators.effects import check_parameters, reach
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
    assert slope.limits == {"slope": (0.9, 1.1)}


def test_the_wider_side_of_what_is_usual_counts_and_nothing_at_all_is_far_below():
    loss = LibraryEffect(
        name="loss", parameters={"loss": Uniform(-2.0, 0.0)}, amplitude="loss", step=-0.1,
        usual={"loss": (-0.5, 0.1), "size": (0.25, 1.0)}, derived={"size": lambda one: -2.0 * one["loss"]},
        cause="", typical="",
    )  # fmt: skip
    assert loss.cost({"loss": -0.5}) == 0.0
    assert loss.cost({"loss": -0.75}) == pytest.approx(3.0 * (np.log(1.5) + np.log(1.5)))
    assert loss.cost({"loss": -0.1}) == pytest.approx(3.0 * np.log(1.25))
    assert loss.cost({"loss": 0.0}) == pytest.approx(3.0 * np.log(0.25 / 1e-300))
    assert loss.at_limit({"loss": 0.0}) == ()
    assert loss.at_limit({"loss": -2.0}) == ("loss",)
    assert loss.limits == {"loss": (-2.0,)}
    assert effect(ends=("width",)).limits == {"size": (4.0,), "width": (1.0,)}
    assert (loss.two_sided, loss.support) == (False, (-2.0, 0.0))


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
    assert effect().at_limit({"size": 3.997, "width": 0.1}) == ("size",)
    assert effect().at_limit({"size": 4.5, "width": 0.1}) == ("size",)


def scanned():
    return LibraryEffect(
        name="line", amplitude="size", neutral=1.0, step=-0.25, cause="", typical="", kind="own",
        units={"size": "Jy"},
        parameters={"energy": LogUniform(0.5, 10.0), "size": Uniform(0.0, 4.0), "width": Uniform(0.0, 1.0)},
        scanned={"energy": np.array([1.0, 2.0]), "width": (0.1, 0.2, 0.3)},
    )  # fmt: skip


def test_nodes_are_all_combinations_one_step_from_neutral():
    expected = [[energy, 0.75, width] for energy in (1.0, 2.0) for width in (0.1, 0.2, 0.3)]
    np.testing.assert_array_equal(scanned().nodes, expected)
    assert scanned().two_sided
    fixed = scanned().effect(width=0.2)
    assert (fixed.name, fixed.kind, fixed.fixed) == ("line", "own", {"width": 0.2})
    assert list(fixed.free) == ["energy", "size"]


@pytest.mark.parametrize(
    ("energy", "low", "high"), [(2.0, 1.98, 2.02), (0.502, 0.5, 0.50702), (9.95, 9.8505, 10.0)]
)
def test_an_energy_that_is_stated_may_move_by_a_hundredth_inside_the_prior(energy, low, high):
    whole, stated = scanned(), scanned().at_energy(energy)
    assert stated.parameters["energy"].support == pytest.approx((low, high), rel=1e-12)
    assert isinstance(stated.parameters["energy"], Uniform)
    np.testing.assert_array_equal(stated.nodes, [[energy, 0.75, width] for width in (0.1, 0.2, 0.3)])
    assert (stated.name, stated.kind, stated.units) == (whole.name, whole.kind, whole.units)


@pytest.mark.parametrize("energy", [0.5, 10.0, 0.4, 11.0])
def test_an_energy_beyond_the_prior_is_refused(energy):
    said = f"effect line: energies from 0.5 to 10 keV can be stated, got {energy:g}$"
    with pytest.raises(InputError, match=said):
        scanned().at_energy(energy)


def test_what_cannot_be_scanned_is_refused():
    with pytest.raises(
        InputError, match=r"^effect line: every parameter but the amplitude 'size' needs values"
    ):
        LibraryEffect(name="line", parameters={"size": Uniform(0.0, 1.0), "width": Uniform(0.0, 1.0)},
                      amplitude="size", step=0.1, cause="", typical="")  # fmt: skip
    for neutral, step in ((1.5, -0.6), (0.5, 0.6), (0.5, -0.6), (-0.5, 0.6)):
        said = f"the prior of size must hold {neutral:g} and {neutral + step:g}, it reaches from 0 to 1$"
        with pytest.raises(InputError, match=said):
            LibraryEffect(name="line", parameters={"size": Uniform(0.0, 1.0)}, amplitude="size",
                          neutral=neutral, step=step, cause="", typical="")  # fmt: skip


def test_parameters_are_held_against_their_ranges():
    def asked(**given):
        check_parameters(Effect("line", given), {"size": (0.0, 1.0), "width": (0.5, 2.0)})

    asked(size=0, width=2.0)
    asked(size=Uniform(0.0, 1.0), width=LogUniform(0.5, 2.0))
    for given, says in (
        ({}, "takes size, width; size, width missing$"),
        ({"size": 0.5, "width": 1.0, "b": 1, "a": 2}, "takes size, width; a, b unknown$"),
        ({"size": 0.5, "width": "wide"}, "width must be a number or a distribution, got 'wide'$"),
        ({"size": -0.25, "width": 1.0}, "size must lie between 0 and 1, got -0.25$"),
        ({"size": 1.25, "width": 1.0}, "size must lie between 0 and 1, got 1.25$"),
        ({"size": 0.5, "width": Uniform(0.25, 1.0)}, "width must lie between 0.5 and 2, got 0.25 to 1$"),
        ({"size": 0.5, "width": Uniform(1.0, 3.0)}, "width must lie between 0.5 and 2, got 1 to 3$"),
    ):
        with pytest.raises(InputError, match=f"^effect line: {says}"):
            asked(**given)


def test_how_far_parameters_reach():
    assert reach(3) == (3.0, 3.0)
    assert reach(Uniform(-1.0, 2.0)) == (-1.0, 2.0)
    np.testing.assert_allclose(reach(Normal(1.0, 2.0)), stats.norm(1.0, 2.0).ppf([1e-9, 1 - 1e-9]), rtol=1e-3)
    np.testing.assert_allclose(reach(Gamma(2.0, 1.0)), stats.gamma(2.0).ppf([1e-9, 1 - 1e-9]), rtol=1e-3)


def test_an_effect_says_what_is_free_and_what_is_not():
    line = Effect("line", {"energy": 6, "size": Uniform(0.0, 1.0)})
    assert line.describe() == {
        "name": "line",
        "fixed": {"energy": 6.0},
        "free": {"size": {"distribution": "uniform", "low": 0.0, "high": 1.0}},
    }
    assert line.prior("line_2") == Prior({"line_2.size": Uniform(0.0, 1.0)})
    assert Effect("line", {"energy": 6.0}).prior("line_1") is None
