"""What a response is made into is made once for all models of it, and goes with it."""

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.simulators import Effect, Uniform

pytest.importorskip("jaxspec")
from gaugeblock.simulators import build_simulator
from gaugeblock.simulators.xray.kept import kept

pytestmark = pytest.mark.usefixtures("xray_data")
GAIN = Effect("gain_offset", {"offset": Uniform(-0.05, 0.05)})


def test_the_same_object_again_for_the_same_response_and_numbers():
    asked = []

    @kept
    def made(response, low, *, high=2):
        """Docs."""
        asked.append((response, low, high))
        return object()

    one = build_simulator("xray", response="epic-pn", level="medium").response
    other = replace(one)
    first = made(one, 1)
    assert made(one, 1) is first
    further = [made(one, 2), made(one, 1, high=3), made(other, 1), made(other, 1, high=3)]
    assert len({id(first), *map(id, further)}) == 5
    assert made(other, 1, high=3) is further[-1]
    assert len(asked) == 5
    assert made.__doc__ == "Docs."


def test_it_is_forgotten_with_the_response():
    made = kept(lambda response: object.__new__(Thing))
    response = replace(build_simulator("xray", response="epic-pn", level="medium").response)
    made(response)
    seen = weakref.ref(made(response))
    assert seen() is not None
    del response
    gc.collect()
    assert seen() is None


class Thing:
    """Something that can be seen to be gone."""


def test_models_of_one_response_hold_its_matrices_once():
    """A search has dozens of models, and each held 4 MB of the response of its own."""
    import jax

    simulator = build_simulator("xray", response="epic-pn", level="medium")
    theta = simulator.prior.sample(1, np.random.default_rng(1))

    def held():
        gc.collect()
        large = [array for array in jax.live_arrays() if array.ndim == 2 and array.size > 5_000]
        return sum(array.nbytes for array in large)

    plain, moved = [simulator], [simulator.with_effect(GAIN)]
    plain[0].expected(theta)
    moved[0].expected(np.append(theta, [[0.01]], axis=1))
    before = held()
    assert before > 0
    for k in (0.8, 0.9, 1.1):
        plain.append(simulator.with_effect(Effect("partial_covering", {"nh": 1.0, "fraction": 0.5 * k})))
        plain[-1].expected(theta)
        moved.append(plain[-1].with_effect(GAIN))
        moved[-1].expected(np.append(theta, [[0.01]], axis=1))
    assert held() == before
