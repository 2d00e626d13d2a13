"""Effects of a user's own: one function, no registration; and what is wrong about an effect, in one line."""

import pickle
import re

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import Effect, LogUniform, Uniform
from gaugeblock.simulators.library import LibraryEffect

pytest.importorskip("jaxspec")
from gaugeblock.simulators.xray import factor_effect, reference

pytestmark = pytest.mark.usefixtures("xray_data")


@pytest.fixture(scope="module")
def simulator():
    return reference(level="bright")


@pytest.fixture(scope="module")
def theta(simulator):
    return simulator.prior.sample(32, np.random.default_rng(3))


def bump(energy, height, width):
    """An effect of a user's own."""
    import jax.numpy as jnp

    return 1.0 + height * jnp.exp(-((energy - 3.0) ** 2) / width)


def test_an_effect_of_ones_own_needs_a_function(simulator, theta):
    kind = factor_effect(bump, limits={"width": (0.01, 10.0)})
    effect = Effect("bump", {"height": Uniform(-0.5, 0.5), "width": 0.5}, kind=kind)
    changed = simulator.with_effect(effect).with_effect(effect)
    assert changed.prior.names[5:] == ("bump_1.height", "bump_2.height")
    counts = changed.expected(np.column_stack([theta, np.full((len(theta), 2), 0.1)]))
    nearest = np.argmin(np.abs(simulator.channels.mean(axis=1) - 3.0))
    np.testing.assert_allclose((counts / simulator.expected(theta))[:, nearest], 1.21, rtol=0.01)
    assert changed.describe()["effects"][0]["kind"].endswith("test_xray_own_effect.bump")
    copy = pickle.loads(pickle.dumps(changed))
    np.testing.assert_array_equal(copy.expected(copy.prior.center), changed.expected(changed.prior.center))
    entry = LibraryEffect(
        name="bump", parameters={"height": Uniform(-0.5, 0.5), "width": LogUniform(0.1, 1.0)},
        amplitude="height", neutral=0.0, step=0.1, scanned={"width": [0.5]}, cause="Made up.",
        typical="a tenth", kind=kind,
    )  # fmt: skip
    assert simulator.with_effect(entry.effect(width=0.5)).prior.names[5:] == ("bump_1.height",)


def test_a_function_is_averaged_over_bins_and_belongs_to_the_source_or_the_area():
    """Two points integrate a cubic exactly."""
    low, high = np.array([1.0, 2.0]), np.array([2.0, 5.0])
    for instrument, where in ((False, "factors"), (True, "areas")):
        kind = factor_effect(lambda energy, size: size * energy**3 - energy, instrument=instrument)
        assert kind.apply.where == where
        mean = kind.apply.what(low, high, size=2.0)
        exact = ((high**4 - low**4) / 2 - (high**2 - low**2) / 2) / (high - low)
        np.testing.assert_allclose(mean, exact, rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: factor_effect(lambda energy: energy), "at least one parameter"),
        (lambda: factor_effect(bump, limits={"depth": (0, 1)}), "limits of depth; it takes height, width"),
        (lambda: Effect("bump", {"height": 0.1, "width": 0.5}), "one of your own needs its kind"),
        (lambda: Effect("bump", {"height": 0.1, "width": 0.5}, kind=bump), "must be an EffectKind"),
        (
            lambda: Effect(
                "bump", {"height": 0.1, "width": -1.0}, kind=factor_effect(bump, limits={"width": (0, 1)})
            ),
            "width must lie between 0 and 1, got -1",
        ),
        (lambda: Effect("resolution", {"variance": -1e-3}), "variance must lie between 0"),
        (lambda: Effect("effective_area", {"energy": 2, "width": 0.1, "depth": -1.5}), "depth must lie"),
        (lambda: Effect("pileup", {"overlap": 1.5}), "overlap must lie between 0 and 1"),
    ],
)
def test_wrong_ones_are_one_line(simulator, make, words):
    with pytest.raises(InputError, match=re.escape(words)) as caught:
        simulator.with_effect(make())
    assert "\n" not in str(caught.value)
