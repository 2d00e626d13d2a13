"""From a model with its effects and a response to one compiled forward model."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray.effects import Assembly, Source
from gaugeblock.simulators.xray.expression import Node, build
from gaugeblock.simulators.xray.forward import ForwardModel
from gaugeblock.simulators.xray.gain import shifted_transfer, shifting_fold
from gaugeblock.simulators.xray.precision import double_precision
from gaugeblock.simulators.xray.response import Response


def forward(assembly: Assembly, response: Response) -> ForwardModel:
    """Compile a model and its effects for a response.

    Everything that is fixed is worked into constants here, so a fixed effect costs nothing per spectrum.
    """
    import jax.numpy as jnp

    names = assembly.prior.names
    with double_precision():
        flux = _photon_flux(assembly.tree, names)
        fold, live = _fold(assembly, response)
        low, high = _photon_energies(assembly, response)[:, live]

        def rate(theta: Any) -> Any:
            factor = math.prod(_value(s, theta, names) for s in assembly.photon_gain if isinstance(s, str))
            edges = (low, high) if isinstance(factor, int) else (low * factor, high * factor)
            return fold(flux(theta, *map(jnp.asarray, edges)), theta)

    return ForwardModel(names, len(response.channels), rate, response.exposure)


def _value(source: Source, theta: Any, names: Sequence[str]) -> Any:
    return theta[names.index(source)] if isinstance(source, str) else source


def _photon_flux(tree: Node, names: Sequence[str]) -> Callable[[Any, Any, Any], Any]:
    """Pure JAX function ``(theta, lower, upper edges)`` to photons/cm2/s in each bin."""
    model, sources = build(tree)

    def flux(theta: Any, low: Any, high: Any) -> Any:
        values = {path: _value(source, theta, names) for path, source in sources}
        return model.photon_flux(low, high, params=values)

    return flux


def _photon_energies(assembly: Assembly, response: Response) -> NDArray[np.float64]:
    """Lower and upper edges of the input bins, shape ``(2, bin)``, under fixed published gains."""
    return response.energies.T * math.prod(s for s in assembly.photon_gain if not isinstance(s, str))


def _fold(assembly: Assembly, response: Response) -> tuple[Callable[[Any, Any], Any], NDArray[np.bool_]]:
    """Pure JAX function ``(photon flux, theta)`` to counts per second in each channel.

    The flux is that of the input bins that reach any channel at all, which are the second result: the rest,
    more than a quarter for EPIC-pn, are never evaluated.
    """
    import jax.numpy as jnp

    gains, names = assembly.gains, assembly.prior.names
    if any(isinstance(source, str) for gain in gains for source in gain):
        shifting, live = shifting_fold(response, *_range(gains, assembly.prior))
        return (
            lambda flux, theta: shifting(
                flux, *compose([(_value(s, theta, names), _value(o, theta, names)) for s, o in gains])
            ),
            live,
        )
    dense = shifted_transfer(response, *compose(gains)) if gains else response.with_exposure(1.0).transfer
    live = np.asarray(dense.any(axis=0))
    transfer = jnp.asarray(dense[:, live])
    return (lambda flux, _: transfer @ flux), live


def compose(gains: Sequence[tuple[Any, Any]]) -> tuple[Any, Any]:
    """One (slope, offset) for several that act one after the other.

    >>> compose([(1.02, 0.0), (1.0, 0.01)])
    (1.02, 0.01)
    """
    slope, offset = 1.0, 0.0
    for s, o in gains:
        slope, offset = s * slope, s * offset + o
    return slope, offset


def _range(
    gains: Sequence[tuple[Source, Source]], prior: Prior
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Smallest and largest (slope, offset) under the prior, by interval arithmetic; slopes are positive."""
    slopes, offsets = (1.0, 1.0), (0.0, 0.0)
    for s, o in gains:
        s_range = prior.marginals[s].support if isinstance(s, str) else (s, s)
        o_range = prior.marginals[o].support if isinstance(o, str) else (o, o)
        products = [a * b for a in s_range for b in offsets]
        slopes = (s_range[0] * slopes[0], s_range[1] * slopes[1])
        offsets = (min(products) + o_range[0], max(products) + o_range[1])
    return slopes, offsets
