"""Double precision for our own calls only: the host program's JAX configuration stays as it is."""

from __future__ import annotations

from typing import Any

from gaugeblock.core.errors import require


def double_precision() -> Any:
    """Context in which JAX works in float64; build, trace and call inside it.

    jaxspec reads its cross-section tables in the dtype that is active when a component is made, so
    making one outside would leave a float32 table behind for good.
    """
    jax = require("jax", "xray")
    if hasattr(jax, "enable_x64"):
        return jax.enable_x64(True)
    from jax.experimental import enable_x64

    return enable_x64(True)
