"""Parameters that many spectra share: held for all at once they give what each spectrum would give alone."""

import numpy as np
import pytest

from gaugeblock.simulators import Effect, Uniform

pytest.importorskip("jaxspec")
from gaugeblock.simulators.xray import reference
from gaugeblock.simulators.xray.forward import HELD_CHUNK

pytestmark = pytest.mark.usefixtures("xray_data")

EFFECTS = {
    "gain": (Effect("gain_slope", {"slope": Uniform(0.9, 1.1)}), [0.985]),
    "resolution": (Effect("resolution", {"variance": Uniform(0.0, 0.02)}), [0.0025]),
    "area": (Effect("effective_area", {"energy": 2.0, "width": 0.3, "depth": Uniform(-0.5, 0.5)}), [0.1]),
}


@pytest.fixture(scope="module")
def extended():
    """A spectrum with each effect."""
    plain = reference()
    return {name: plain.with_effect(effect) for name, (effect, _) in EFFECTS.items()}


@pytest.mark.parametrize("name", EFFECTS)
def test_equals_the_whole_theta(extended, name):
    spectrum, values = extended[name], EFFECTS[name][1]
    theta = reference().prior.sample(HELD_CHUNK + 3, np.random.default_rng(1))
    whole = np.concatenate([theta, np.broadcast_to(values, (len(theta), 1))], axis=1)
    held = spectrum.held(values)
    np.testing.assert_allclose(held.expected(theta), spectrum.expected(whole), rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(
        held.jacobian(theta[:4]),
        spectrum.jacobian(whole[:4])[..., :5],
        rtol=1e-7,
        atol=1e-9 * np.abs(whole).max(),
    )


def test_other_values_and_exposures_compile_nothing_again(extended):
    spectrum, values = extended["gain"], EFFECTS["gain"][1]
    theta = spectrum.prior.sample(40, np.random.default_rng(2))[:, :5]
    first, second = spectrum.held(values), spectrum.held([1.02])
    one, two = first.expected(theta), second.expected(theta)
    assert first._model is second._model
    assert first._model.expected.compilations == 1
    # Going back gives the same numbers: no value is taken for another's.
    np.testing.assert_array_equal(first.expected(theta), one)
    assert np.abs(two / one - 1.0).max() > 0.01
    longer = spectrum.with_exposure(2.0 * spectrum.exposure).held(values)
    np.testing.assert_allclose(longer.expected(theta), 2.0 * one, rtol=1e-9, atol=2e-6)


def test_a_gain_of_its_own_beside_one_that_is_held():
    """What is held is no matrix then: counts are moved by both."""
    spectrum = reference()
    for effect in (EFFECTS["gain"][0], Effect("gain_offset", {"offset": Uniform(-0.1, 0.1)})):
        spectrum = spectrum.with_effect(effect)
    theta = spectrum.prior.sample(5, np.random.default_rng(3))
    theta[:, -1] = 0.03
    np.testing.assert_allclose(
        spectrum.held([0.03]).expected(theta[:, :-1]), spectrum.expected(theta), rtol=1e-7, atol=1e-9
    )
