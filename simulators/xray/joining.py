"""Joins spectra of one source: what their parameters are called together, and the constants between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gaugeblock.core.errors import InputError
from gaugeblock.simulators.marginals import Marginal, Uniform
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray.cross_calibration import CrossCalibrated
from gaugeblock.simulators.xray.joint import JointSpectra, Part
from gaugeblock.simulators.xray.with_background import WithBackground

CROSS_CALIBRATION = Uniform(0.8, 1.25)
"""Prior of the constant between two instruments."""


def joint_spectra(
    simulators: Sequence[Any], names: Sequence[str], *, cross_calibration: Marginal = CROSS_CALIBRATION
) -> JointSpectra:
    """Join spectra of one source; the data are then concatenated in the same order.

    Parameters
    ----------
    simulators : sequence of XraySpectrum or WithBackground
        Of the same model, with the same prior of the source and the same effects, all of them fixed.
    names : sequence of str
        What to call the instruments.
    cross_calibration : Marginal
        Prior of the constants that the second and all further instruments have.

    Raises
    ------
    InputError
        If there is no simulator, names are not distinct, or models, priors or effects differ.
    """
    if not simulators or len(names) != len(simulators) or len(set(names)) != len(names):
        raise InputError(
            f"instruments: {len(simulators)} spectra need as many distinct names, got {', '.join(names)}"
        )
    first = _source(simulators[0])
    marginals: dict[str, Marginal] = {}
    parts = []
    for k, (name, simulator) in enumerate(zip(names, simulators, strict=True), start=1):
        source = _source(simulator)
        if source.model != first.model or source.prior != first.prior or source.effects != first.effects:
            raise InputError(f"instruments {names[0]} and {name}: need the same model, prior and effects")
        if any(effect.free for effect in source.effects):
            raise InputError(f"instrument {name}: add effects with free parameters after joining")
        made = simulator if k == 1 else _calibrated(simulator, cross_calibration)
        called = tuple(_called(parameter, k) for parameter in made.prior.names)
        marginals |= dict(zip(called, made.prior.marginals.values(), strict=True))
        parts.append(Part(name, made, called))
    return JointSpectra(tuple(parts), Prior(marginals), tuple(first.effects))


def _source(simulator: Any) -> Any:
    return simulator.source if isinstance(simulator, WithBackground) else simulator


def _calibrated(simulator: Any, factor: Marginal) -> Any:
    if isinstance(simulator, WithBackground):
        return WithBackground(CrossCalibrated(simulator.source, factor), simulator.background)
    return CrossCalibrated(simulator, factor)


def _called(parameter: str, k: int) -> str:
    """What the joint theta calls a parameter of the k-th instrument: what is its own carries its number."""
    for kind in ("background", "cross_calibration"):
        if parameter.startswith(f"{kind}_1."):
            return f"{kind}_{k}." + parameter.partition(".")[2]
    return parameter
