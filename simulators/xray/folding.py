"""From a model with its effects and a response to one compiled forward model."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.precision import double_precision
from gaugeblock.simulators.xray.effects.assembly import Assembly, Bound, Source
from gaugeblock.simulators.xray.expression import Node, of_jaxspec, valued
from gaugeblock.simulators.xray.expression import Source as TreeSource
from gaugeblock.simulators.xray.forward import ForwardModel
from gaugeblock.simulators.xray.integration import exact_flux
from gaugeblock.simulators.xray.rate import Folding, Rate
from gaugeblock.simulators.xray.recorded.fold import recorded_folding
from gaugeblock.simulators.xray.response import Response
from gaugeblock.simulators.xray.sparse import response_product
from gaugeblock.simulators.xray.trapezoid import trapezoid_flux


def forward(assembly: Assembly, response: Response, *, integration: str = "jaxspec") -> ForwardModel:
    """A model and its effects, to be compiled for a response; `integration` as in `XraySpectrum`.

    Everything that is fixed is worked into constants here, so a fixed effect costs nothing per spectrum.
    """
    import jax

    names = assembly.prior.names
    # Whoever asks first may be tracing: without this the constants would belong to that trace alone.
    with double_precision(), jax.core.eval_context():
        folding = _folding(assembly, response.sized)
        low, high = _photon_energies(assembly, response)[:, folding.live]
        flux = photon_flux(assembly.tree, names, low, high, integration)
        source = _factors(assembly.factors, names, low, high)
        area = _factors(assembly.areas, names, *response.energies.T[:, folding.live])

        def photons(theta: Any) -> Any:
            factor = math.prod(_value(s, theta, names) for s in assembly.photon_gain if isinstance(s, str))
            return area(source(flux(theta, factor), theta, factor), theta, 1)

    return ForwardModel(assembly.prior, len(response.channels), Rate(photons, folding), response.exposure)


def _value(source: Source, theta: Any, names: Sequence[str]) -> Any:
    return theta[names.index(source)] if isinstance(source, str) else source


def photon_flux(
    tree: Node, names: Sequence[str], low: Array, high: Array, integration: str
) -> Callable[[Any, Any], Any]:
    """Pure JAX function ``(theta, factor on the edges)`` to photons/cm2/s in each bin.

    What jaxspec does not compute is integrated exactly, whatever `integration` says.
    """

    def value(source: TreeSource, theta: Any) -> Any:
        return valued(source, lambda name: theta[names.index(name)])

    by_jaxspec = integration == "jaxspec" and of_jaxspec(tree)
    between = (trapezoid_flux if by_jaxspec else exact_flux)(tree, low, high)
    return lambda theta, factor: between(
        lambda leaf: {name: value(source, theta) for name, source in leaf.bindings}, factor
    )


def _photon_energies(assembly: Assembly, response: Response) -> NDArray[np.float64]:
    """Lower and upper edges of the input bins, shape ``(2, bin)``, under fixed published gains."""
    return response.energies.T * math.prod(s for s in assembly.photon_gain if not isinstance(s, str))


def _factors(
    factors: Sequence[Bound], names: Sequence[str], low: Array, high: Array
) -> Callable[[Any, Any, Any], Any]:
    """Pure JAX function ``(photon flux, theta, factor on the edges)`` to the flux times all factors."""
    import jax.numpy as jnp

    free = [bound for bound in factors if bound.free]
    fixed = [bound for bound in factors if not bound.free]

    def times(bounds: Sequence[Bound], theta: Any, low: Any, high: Any) -> Any:
        return math.prod(bound.what(low, high, **bound.values(theta, names)) for bound in bounds)

    constant = np.asarray(times(fixed, None, low, high))

    def multiply(flux: Any, theta: Any, factor: Any) -> Any:
        if isinstance(factor, int):
            flux = flux * jnp.asarray(constant) if fixed else flux
            return flux * times(free, theta, low, high) if free else flux
        return flux * times(factors, theta, low * factor, high * factor) if factors else flux

    return multiply


def _folding(assembly: Assembly, response: Response) -> Folding:
    """From photon flux to counts per second in each channel.

    Input bins that reach no channel, more than a quarter for EPIC-pn, are never evaluated.
    """
    if assembly.recorded:
        return recorded_folding(response, assembly.recorded, assembly.prior)
    transfer, live = response_product(response)
    return Folding(lambda flux, _: transfer(flux), live)
