"""Double precision and the device for our own calls alone: the host program keeps its JAX configuration."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from gaugeblock.core.devices import jax_device
from gaugeblock.core.errors import require


@contextmanager
def double_precision() -> Iterator[None]:
    """Context in which JAX works in float64, on the device that was chosen; build, trace and call inside it.

    jaxspec reads its cross-section tables in the dtype that is active when a component is made, so
    making one outside would leave a float32 table behind for good.
    """
    jax = require("jax", "xray")
    # Where older versions have it.
    owner = jax if hasattr(jax, "enable_x64") else require("jax.experimental", "xray")
    with owner.enable_x64(True), jax.default_device(jax_device()):
        yield
