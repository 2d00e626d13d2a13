"""A spectrum whose first use is inside a JAX transformation, as under NUTS."""

import numpy as np
import pytest

from gaugeblock.simulators import Effect, Uniform, build_simulator

jax = pytest.importorskip("jax")
pytest.importorskip("jaxspec")
pytestmark = pytest.mark.usefixtures("xray_data")


@pytest.mark.parametrize("effects", [(), (Effect("gain_offset", {"offset": Uniform(-0.1, 0.1)}),)])
def test_constants_outlive_the_trace_that_made_them(effects):
    from gaugeblock.core.precision import double_precision

    simulator = build_simulator("xray", response="epic-pn", level="medium", effects=effects)
    theta = simulator.prior.center
    with double_precision():

        def total(place):
            counts = simulator.expected_jax(place)
            return counts.sum(), counts

        gradient, first = jax.jit(jax.grad(total, has_aux=True))(theta)
    np.testing.assert_allclose(first, simulator.expected(theta), rtol=1e-12)
    np.testing.assert_allclose(gradient, simulator.jacobian(theta).sum(axis=0), rtol=1e-9)
