"""An X-ray simulator from plain options, as a configuration file or the command line gives them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gaugeblock.core.errors import InputError
from gaugeblock.core.tables import read_toml
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.marginals import Marginal
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray.expression import with_sources
from gaugeblock.simulators.xray.files import FilePath
from gaugeblock.simulators.xray.published import MODEL, PRIORS
from gaugeblock.simulators.xray.reference import epic_pn, level_exposure, nicer
from gaugeblock.simulators.xray.response import Response
from gaugeblock.simulators.xray.simulator import XraySpectrum
from gaugeblock.simulators.xray.xcm import read_xcm

Description = Mapping[str, Any]
Priors = str | FilePath | Description | Prior | None


def build(
    *,
    response: str | None = None,
    level: str | None = None,
    model: str = MODEL,
    priors: str | FilePath | Description | Prior = "reference",
    exposure: float | None = None,
    pha: FilePath | None = None,
    rmf: FilePath | None = None,
    arf: FilePath | None = None,
    band: Sequence[float] | None = None,
    effects: Sequence[Effect | Description] = (),
    integration: str = "jaxspec",
) -> XraySpectrum:
    """An X-ray simulator from options; without any, the reference case.

    Parameters
    ----------
    response, level : str, optional
        A built-in response (``epic-pn``, ``nicer``) and count level (``faint``, ``medium``, ``bright``).
    model : str
        XSPEC-style expression, or a file that XSPEC saved (``.xcm``).
    priors : name, path or table
        ``reference``, ``published_linear_norm``, a TOML file, or a table: parameter name to
        ``{distribution, low, high}`` or ``{distribution, mean, sd}``, a number, or a tie to another.
    exposure : float, optional
        Seconds, in place of the level's or the spectrum's.
    pha, rmf, arf : path, optional
        OGIP files in place of a built-in response; the spectrum gives its grouping, quality and exposure.
    band : two floats, optional
        Energies in keV; needs `rmf`.
    effects : list of tables
        ``{name = "emission_line", energy = 6.4, sigma = 0.05, norm = {distribution = ...}}``: numbers are
        fixed, tables are priors of free parameters.
    integration : {"jaxspec", "exact"}
        How photons are integrated over input bins; ``exact`` for small gains and bright spectra.

    Raises
    ------
    InputError
        In one line: for files that cannot be read, options that exclude each other, or unknown names.
    """
    if rmf is None or response == "nicer":
        if pha is not None or band is not None or (rmf is None and arf is not None):
            raise InputError("simulator xray: pha, arf and band need the rmf that they belong to")
        response = response or "epic-pn"
        seconds = level_exposure(response, level or "medium") if exposure is None else exposure
        instrument = (epic_pn() if response == "epic-pn" else nicer(rmf, arf)).with_exposure(seconds)
    elif response is not None or level is not None:
        raise InputError("simulator xray: response and level choose a built-in case; leave them out with rmf")
    elif pha is None and exposure is None:
        raise InputError("simulator xray: rmf without pha needs exposure, in seconds")
    elif band is not None and len(band) != 2:
        raise InputError(f"simulator xray: band needs two energies in keV, got {list(band)}")
    else:
        limits = None if band is None else (float(band[0]), float(band[1]))
        instrument = Response.from_ogip(rmf, arf, pha, band=limits, exposure=exposure)
    made = tuple(map(read_effect, effects))
    model, prior = settled(model, priors)
    if prior is None:
        raise InputError(
            f"simulator xray: priors needs a table with the distributions that {model!r} is free in"
        )
    return XraySpectrum(model, instrument, prior, effects=made, integration=integration)


def settled(model: str, priors: Priors) -> tuple[str, Prior | None]:
    """A model with what priors say of it in numbers and ties, and the prior of the rest.

    `model` may be a file that XSPEC saved (``.xcm``). In a table of priors a number freezes a parameter, and
    a text ties it: ``"zgauss_1.redshift" = "zpowerlw_1.redshift"``, ``"gauss_2.norm" = "0.13*gauss_1.norm"``.

    Raises
    ------
    InputError
        If a file cannot be read, a distribution is wrong, or a number or a tie belongs to no parameter.
    """
    if model.strip().lower().endswith(".xcm"):
        model = read_xcm(model.strip()).model
    if priors is None or isinstance(priors, Prior):
        return model, priors
    if not isinstance(priors, Mapping) and priors in PRIORS:
        return model, PRIORS[str(priors)]
    where = "" if isinstance(priors, Mapping) else f"priors {priors}: "
    if isinstance(priors, Mapping):
        table = _flat(priors)
    elif Path(priors).is_file():
        table = _flat(read_toml(Path(priors)))
    else:
        raise InputError(f"priors {priors}: neither one of {', '.join(PRIORS)} nor a file")
    left = {name: entry for name, entry in table.items() if isinstance(entry, Mapping)}
    try:
        model = with_sources(model, {name: entry for name, entry in table.items() if name not in left})
        return model, Prior.from_description(left) if left else None
    except InputError as error:
        raise InputError(f"{where}{error}") from None


def _flat(table: Description) -> dict[str, Any]:
    """TOML reads an unquoted ``[tbabs_1.nh]`` as a table in a table: put the dots back."""
    flat: dict[str, Any] = {}
    for name, value in table.items():
        if isinstance(value, Mapping) and "distribution" not in value:
            flat |= {f"{name}.{inner}": entry for inner, entry in _flat(value).items()}
        elif isinstance(value, Mapping | str | int | float) and not isinstance(value, bool):
            flat[name] = value
        else:
            raise InputError(
                f"prior of {name}: needs a table with a distribution, a number or a tie, got {value!r}"
            )
    return flat


def read_effect(effect: Effect | Description) -> Effect:
    """An effect from its table.

    Raises
    ------
    InputError
        If it has no name, or a parameter is neither a number nor a distribution.
    """
    if isinstance(effect, Effect):
        return effect
    if not isinstance(effect, Mapping) or not isinstance(effect.get("name"), str):
        raise InputError(f"effects: each needs a name and its parameters, got {effect!r}")
    name = effect["name"]
    parameters: dict[str, float | Marginal] = {}
    for key, value in effect.items():
        if key == "name":
            continue
        if isinstance(value, Mapping):
            parameters[key] = Prior.from_description({key: value}).marginals[key]
        elif isinstance(value, int | float) and not isinstance(value, bool):
            parameters[key] = float(value)
        else:
            raise InputError(f"effect {name}: {key} must be a number or a distribution, got {value!r}")
    return Effect(name, parameters)
