"""Effects move spectra the documented way, cost nothing when fixed, and compose."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import Effect, LogUniform, Normal, Prior, Uniform

pytest.importorskip("jaxspec")
from gaugeblock.simulators.xray import Response, XraySpectrum, family, reference
from gaugeblock.simulators.xray.reference import epic_pn

pytestmark = pytest.mark.usefixtures("xray_data")

LINE = {"energy": 6.4, "sigma": 0.02, "norm": 1.0}


@pytest.fixture(scope="module")
def simulator():
    return reference(level="bright")


@pytest.fixture(scope="module")
def theta(simulator):
    return simulator.prior.sample(64, np.random.default_rng(0))


@pytest.fixture(scope="module")
def line():
    """A narrow line on next to nothing, in ungrouped detector channels from 5 to 8 keV."""
    from gaugeblock.simulators.xray import data

    response = Response.from_ogip(
        data.path(data.EXAMPLE + "PN.rmf"), data.path(data.EXAMPLE + "PN.arf"), band=(5.0, 8.0), exposure=1e4
    )
    prior = Prior({"powerlaw_1.alpha": Uniform(1, 3), "powerlaw_1.norm": Uniform(1e-9, 1e-8)})
    return XraySpectrum("powerlaw", response, prior).with_effect(Effect("emission_line", LINE))


PLACE = (2.0, 1e-9)


def centre(simulator, *values):
    """Mean channel energy of the peak, keV; values of what is free beside the power law."""
    counts = simulator.expected([*PLACE, *values])
    middle = simulator.channels.mean(axis=1)
    near = np.abs(middle - middle[np.argmax(counts)]) < 0.15
    return np.average(middle[near], weights=counts[near])


def test_a_line_moves_the_documented_way(line):
    slope = line.with_effect(Effect("gain_slope", {"slope": Uniform(0.9, 1.1)}))
    offset = line.with_effect(Effect("gain_offset", {"offset": Uniform(-0.2, 0.2)}))
    published = line.with_effect(Effect("published_gain", {"factor": 1.02}))
    at, plain = centre(line), line.expected(PLACE)
    for spectrum, values, moved in (
        (slope, [1.02], 1.02 * at),
        (slope, [0.97], 0.97 * at),
        (offset, [0.05], at + 0.05),
        (offset, [-0.05], at - 0.05),
        (published, [], at / 1.02),
    ):
        # The detector's own line profile is a little wider at a higher energy: a few eV of freedom.
        assert centre(spectrum, *values) == pytest.approx(moved, abs=0.004)
    # A physical gain neither makes nor loses counts.
    for spectrum, value in ((slope, 1.03), (offset, -0.1)):
        assert spectrum.expected([*PLACE, value]).sum() == pytest.approx(plain.sum(), rel=2e-3)


def test_gains_act_one_after_the_other(simulator, theta):
    """The same three free gains throughout: a slope, an offset, another slope."""
    gains = simulator
    for name, parameter in (("gain_slope", "slope"), ("gain_offset", "offset"), ("gain_slope", "slope")):
        neutral = float(parameter == "slope")
        gains = gains.with_effect(Effect(name, {parameter: Uniform(neutral - 0.05, neutral + 0.05)}))

    def moved(*values):
        return gains.expected(np.column_stack([theta, np.tile(values, (len(theta), 1))]))

    both, other, equal = moved(1.02, 0.03, 1.0), moved(1.0, 0.03, 1.02), moved(1.02, 1.02 * 0.03, 1.0)
    np.testing.assert_allclose(other, equal, rtol=1e-11)
    assert not np.allclose(both, other, rtol=1e-6)
    np.testing.assert_allclose(moved(1.02, 0.0, 1 / 1.02), simulator.expected(theta), rtol=1e-10)


def test_published_gain_is_exactly_invisible_without_absorption():
    prior = Prior({name: m for name, m in reference().prior.marginals.items() if name != "tbabs_1.nh"})
    plain = XraySpectrum("powerlaw+bbodyrad", epic_pn(), prior)
    g = 1.03
    theta = prior.sample(200, np.random.default_rng(1))
    gamma, norm, temperature, radius = theta.T
    rescaled = np.column_stack([gamma, norm * g ** (1 - gamma), temperature / g, radius * g**3])
    shifted = plain.with_effect(Effect("published_gain", {"factor": g})).expected(theta)
    np.testing.assert_allclose(shifted, plain.expected(rescaled), rtol=1e-13)


def test_published_gain_is_visible_through_the_absorber(simulator, theta):
    changed = simulator.with_effect(family("B4", 3)).expected(theta)
    assert np.abs(changed / simulator.expected(theta) - 1).max() > 0.05


FREE = {
    "photons": (
        (Effect("published_gain", {"factor": Uniform(0.95, 1.05)}), {"factor": 0.98}),
        (Effect("published_thermal_continuum", {"kT": LogUniform(1.0, 20.0)}), {"kT": 3.0}),
        (Effect("published_partial_covering", {"fraction": Uniform(0.0, 1.0)}), {"fraction": 0.4}),
        (
            Effect(
                "emission_line",
                {"energy": Uniform(1, 8), "sigma": LogUniform(0.01, 1.0), "norm": LogUniform(1e-6, 1e-2)},
            ),
            {"energy": 6.4, "sigma": 0.05, "norm": 3e-4},
        ),
    ),
    "gains": (
        (Effect("gain_slope", {"slope": Uniform(0.95, 1.05)}), {"slope": 1.03}),
        (Effect("gain_offset", {"offset": Uniform(-0.05, 0.05)}), {"offset": -0.025}),
    ),
    # Priors without ends.
    "slope": ((Effect("gain_slope", {"slope": Normal(1.0, 0.01)}), {"slope": 0.987}),),
    "offset": ((Effect("gain_offset", {"offset": Normal(0.0, 0.01)}), {"offset": 0.013}),),
}


@pytest.mark.parametrize("which", FREE)
def test_fixed_and_free_agree(simulator, theta, which):
    with_free, with_fixed, names, values = simulator, simulator, [], []
    for free, given in FREE[which]:
        with_free, with_fixed = with_free.with_effect(free), with_fixed.with_effect(Effect(free.name, given))
        names += [f"{free.name}_1.{key}" for key in given]
        values += given.values()
    assert with_fixed.prior == simulator.prior
    assert with_free.prior.names == simulator.prior.names + tuple(names)
    rows = np.column_stack([theta, np.tile(values, (len(theta), 1))])
    np.testing.assert_allclose(with_free.expected(rows), with_fixed.expected(theta), rtol=1e-10)
    assert np.abs(with_fixed.expected(theta) / simulator.expected(theta) - 1).max() > 1e-3
    if which in ("photons", "gains"):
        jacobian = with_free.jacobian(rows[:4])
        assert np.isfinite(jacobian).all()
        # By each of them: a change of as much as the value itself is seen.
        seen = np.abs(jacobian * rows[:4, None] / with_fixed.expected(theta[:4])[..., None]).max(axis=(0, 1))
        assert np.all(np.delete(seen, simulator.prior.names.index("powerlaw_1.alpha")) > 1e-3), seen


def test_what_is_added_before_a_fixed_gain_is_added_once(simulator, theta):
    """Background and gain: worked into one matrix where both are fixed, evaluated where the gain is free."""
    added = simulator.with_effect(Effect("background", {"level": 0.02, "index": 0.5}))
    fixed = added.with_effect(Effect("gain_slope", {"slope": 1.02}))
    free = added.with_effect(Effect("gain_slope", {"slope": Uniform(0.95, 1.05)}))
    rows = np.column_stack([theta, np.full(len(theta), 1.02)])
    np.testing.assert_allclose(fixed.expected(theta), free.expected(rows), rtol=1e-10)


def test_some_parameters_free_and_some_fixed(simulator, theta):
    mixed = simulator.with_effect(
        Effect("emission_line", {"energy": 6.4, "sigma": 0.05, "norm": Uniform(0, 1e-3)})
    )
    assert mixed.prior.names[5:] == ("emission_line_1.norm",)
    rows = np.column_stack([theta, np.full(len(theta), 3e-4)])
    np.testing.assert_allclose(
        mixed.expected(rows), simulator.with_effect(family("B1", 3e-4)).expected(theta), rtol=1e-13
    )


def test_effects_that_change_nothing_change_nothing(simulator, theta):
    changed = simulator
    for effect in (
        Effect("emission_line", {"energy": 6.4, "sigma": 0.05, "norm": 0.0}),
        Effect("published_partial_covering", {"fraction": 1.0}),
        Effect("gain_slope", {"slope": 1.0}),
        Effect("gain_offset", {"offset": 0.0}),
        Effect("published_gain", {"factor": 1.0}),
    ):
        changed = changed.with_effect(effect)
    np.testing.assert_allclose(changed.expected(theta), simulator.expected(theta), rtol=1e-12)


def test_effects_compose_and_are_counted_by_name(simulator, theta):
    weak = {"energy": 6.4, "sigma": 0.05, "norm": Uniform(0, 1e-3)}
    changed = (
        simulator.with_effect(Effect("emission_line", weak))
        .with_effect(Effect("gain_slope", {"slope": Uniform(0.95, 1.05)}))
        .with_effect(Effect("published_partial_covering", {"fraction": 0.5}))
        .with_effect(Effect("emission_line", {**weak, "energy": 2.0}))
    )
    assert changed.prior.names[5:] == ("emission_line_1.norm", "gain_slope_1.slope", "emission_line_2.norm")
    rows = np.column_stack([theta, np.tile([2e-4, 1.0, 0.0], (len(theta), 1))])
    same = simulator.with_effect(Effect("published_partial_covering", {"fraction": 0.5})).with_effect(
        Effect("emission_line", {"energy": 6.4, "sigma": 0.05, "norm": 2e-4})
    )
    np.testing.assert_allclose(changed.expected(rows), same.expected(theta), rtol=1e-11)
    described = changed.describe()["effects"]
    assert [e["name"] for e in described] == [e.name for e in changed.effects]
    assert simulator.effects == ()


def test_the_line_is_absorbed_with_the_rest(theta, simulator):
    low = Effect("emission_line", {"energy": 0.7, "sigma": 0.02, "norm": 1e-3})
    thick, thin = theta.copy(), theta.copy()
    thick[:, 0], thin[:, 0] = 0.35, 0.15
    added = [
        (simulator.with_effect(low).expected(t) - simulator.expected(t)).sum(axis=-1) for t in (thick, thin)
    ]
    # tbabs at 0.7 keV: about 2.5e-22 cm2, so 2e21 cm-2 more take away some 40 per cent.
    assert np.all(added[0] < 0.75 * added[1])


def test_thermal_continuum_ignores_the_index_and_is_the_documented_formula(theta):
    from scipy.integrate import quad

    prior = Prior({"powerlaw_1.alpha": Uniform(1, 3), "powerlaw_1.norm": LogUniform(1e-4, 1e-2)})
    spectrum = XraySpectrum("powerlaw", epic_pn(), prior)
    thermal = spectrum.with_effect(Effect("published_thermal_continuum", {"kT": 3.0}))
    pair = thermal.expected(np.array([[1.0, 1e-3], [3.0, 1e-3]]))
    assert np.array_equal(pair[0], pair[1])
    response = thermal.response
    flux = [quad(lambda e: 1e-3 * np.exp(-e / 3.0) / e, low, high)[0] for low, high in response.energies]
    # Two-point integration of each 5 eV bin: below 1e-4 where the bins are narrow against the energy.
    np.testing.assert_allclose(pair[0], response.transfer @ flux, rtol=3e-4)


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        (Effect("scattering"), "not known to X-ray spectra; there are emission_line"),
        (Effect("gain_slope"), "slope missing"),
        (Effect("gain_slope", {"slope": 1.0, "offset": 0.0}), "offset unknown"),
        (Effect("gain_slope", {"slope": -1.0}), "between 0.5 and 2"),
        (Effect("gain_slope", {"slope": Uniform(0.1, 1.1)}), "got 0.1 to 1.1"),
        (Effect("gain_slope", {"slope": "1.02"}), "number or a distribution, got '1.02'"),
        (Effect("published_partial_covering", {"fraction": 1.2}), "between 0 and 1"),
        (
            Effect("published_partial_covering", {"fraction": Normal(0.5, 0.1)}),
            r"between 0 and 1, got -0\.09978",
        ),
        (Effect("gain_offset", {"offset": float("inf")}), "offset must lie"),
        (Effect("emission_line", {**LINE, "sigma": 0.0}), "sigma must lie"),
        (Effect("emission_line", {**LINE, "norm": float("nan")}), "norm must lie"),
    ],
)
def test_wrong_effects_are_one_line(simulator, effect, words):
    with pytest.raises(InputError, match=words) as caught:
        simulator.with_effect(effect)
    assert "\n" not in str(caught.value)


def test_an_effect_that_finds_nothing_to_change_says_so():
    prior = Prior({"blackbodyrad_1.kT": Uniform(0.3, 3), "blackbodyrad_1.norm": LogUniform(0.01, 1)})
    spectrum = XraySpectrum("bbodyrad", epic_pn(), prior)
    with pytest.raises(InputError, match="no tbabs"):
        spectrum.with_effect(Effect("published_partial_covering", {"fraction": 0.5}))
    with pytest.raises(InputError, match="no powerlaw"):
        spectrum.with_effect(Effect("published_thermal_continuum", {"kT": 5.0}))


def test_a_gains_derivative_at_neutral_is_whole(simulator):
    # There every channel's energy lies on an edge, where a clipped interpolation has half its derivative.
    gains = simulator.with_effect(Effect("gain_slope", {"slope": Uniform(0.95, 1.05)}))
    gains = gains.with_effect(Effect("gain_offset", {"offset": Uniform(-0.05, 0.05)}))
    theta = np.array([*simulator.prior.center, 1.0, 0.0])
    jacobian = gains.jacobian(theta)
    for column in (5, 6):
        step = 1e-4 * np.eye(7)[column]
        difference = (gains.expected(theta + step) - gains.expected(theta - step)) / 2e-4
        assert np.abs(jacobian[:, column] - difference).max() < 0.02 * np.abs(difference).max()
