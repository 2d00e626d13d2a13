"""Priors for a model that nobody gave any: wide, proper, with norms that suit the counts."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.core.errors import InputError
from gaugeblock.simulators.marginals import LogUniform, Marginal, Uniform
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray.components import COMPONENTS
from gaugeblock.simulators.xray.expression import Leaf, Node, leaves, parameter_names, parse
from gaugeblock.simulators.xray.places import ENERGIES
from gaugeblock.simulators.xray.response import Response
from gaugeblock.simulators.xray.tables import is_table, table_priors

_COLUMN = LogUniform(1e-3, 50.0)
_INDEX = Uniform(-1.0, 5.0)

_TEMPERATURE = LogUniform(0.05, 10.0)
_REDSHIFT = Uniform(0.0, 1.0)
_LINE: Mapping[str, Marginal] = {"El": Uniform(0.3, 10.0), "sigma": LogUniform(1e-3, 1.0)}
_EDGE: Mapping[str, Marginal] = {"Ec": Uniform(0.3, 10.0), "tau": LogUniform(0.01, 10.0)}
_CUTOFF: Mapping[str, Marginal] = {"Ec": LogUniform(0.1, 100.0), "Ef": LogUniform(1.0, 500.0)}
_FRACTION = Uniform(0.0, 1.0)

SHAPES: Mapping[str, Mapping[str, Marginal]] = {
    "Powerlaw": {"alpha": _INDEX},
    "Zpowerlw": {"alpha": _INDEX, "redshift": _REDSHIFT},
    "Bknpower": {"alpha1": _INDEX, "BreakE": LogUniform(0.1, 100.0), "alpha2": _INDEX},
    "Logpar": {"alpha": _INDEX, "beta": Uniform(-2.0, 2.0), "pivotE": LogUniform(0.1, 10.0)},
    "Blackbody": {"kT": _TEMPERATURE},
    "Zbbody": {"kT": _TEMPERATURE, "redshift": _REDSHIFT},
    "Blackbodyrad": {"kT": _TEMPERATURE},
    "Diskbb": {"Tin": _TEMPERATURE},
    "Bremss": {"kT": LogUniform(0.1, 100.0)},
    "Zbremss": {"kT": LogUniform(0.1, 100.0), "redshift": _REDSHIFT},
    "Cutoffpl": {"alpha": _INDEX, "beta": LogUniform(1.0, 500.0)},
    "Gauss": _LINE,
    "Zgauss": {**_LINE, "redshift": _REDSHIFT},
    "Lorentz": {"E_l": Uniform(0.3, 10.0), "sigma": LogUniform(1e-3, 1.0)},
    "Band": {"alpha1": Uniform(-2.0, 2.0), "alpha2": Uniform(-5.0, -2.0), "Ec": LogUniform(1.0, 1000.0)},
    "MultiplicativeConstant": {"norm": LogUniform(0.1, 10.0)},
    "Expfac": {"A": LogUniform(0.01, 10.0), "f": LogUniform(0.01, 10.0), "E_c": LogUniform(0.1, 10.0)},
    "Expabs": {"Ec": LogUniform(0.01, 10.0)},
    "Highecut": _CUTOFF,
    "Zhighect": {**_CUTOFF, "redshift": _REDSHIFT},
    "Edge": _EDGE,
    "Zedge": {**_EDGE, "redshift": _REDSHIFT},
    "Gabs": {**_LINE, "strength": LogUniform(1e-3, 10.0)},
    "Cyclabs": {
        "depth0": LogUniform(0.01, 10.0),
        "E0": LogUniform(1.0, 100.0),
        "width0": LogUniform(0.1, 30.0),
        "depth2": LogUniform(0.01, 10.0),
        "width2": LogUniform(0.1, 30.0),
    },
    "Phabs": {"nh": _COLUMN},
    "Zphabs": {"nh": _COLUMN, "redshift": _REDSHIFT},
    "Pcfabs": {"nh": _COLUMN, "f": _FRACTION},
    "Zpcfabs": {"nh": _COLUMN, "f": _FRACTION, "redshift": _REDSHIFT},
    "Tbabs": {"nh": _COLUMN},
    "zTbabs": {"nh": _COLUMN, "z": _REDSHIFT},
    "Tbpcf": {"nh": _COLUMN, "f": _FRACTION},
    "Wabs": {"nh": _COLUMN},
    "Zwabs": {"nh": _COLUMN, "redshift": _REDSHIFT},
    "Cflux": {"Emin": LogUniform(0.1, 10.0), "Emax": LogUniform(1.0, 100.0)},
    "Zashift": {"redshift": _REDSHIFT},
}
"""Prior of every parameter but norms and fluxes of what emits, by what computes it; see docs/xray.md."""

FAINTEST, BRIGHTEST = 1e-3, 10.0
"""A norm reaches from this part of what all the counts need to that multiple of it."""

_DRAWS = 512


def default_prior(
    model: str,
    response: Response,
    counts: ArrayLike,
    exposure: ArrayLike | None = None,
    *,
    given: Mapping[str, Marginal] | None = None,
) -> Prior:
    """Priors of every parameter of a model, in the model's order.

    Shapes are as in `SHAPES`. The norm of a component that emits is log-uniform: for 512 draws of everything
    else, the norm at which this component alone would make all the counts is computed, and the prior reaches
    from a thousandth of what the lowest tenth of draws needs to ten times what the highest tenth needs, and
    over six decades at least.

    Parameters
    ----------
    model : str
        Model expression.
    response : Response
    counts : array, shape (channel,) or (source, channel)
        Counts of the source, background taken off; of many sources the faintest and the brightest count.
    exposure : float or array, shape (source,), optional
        Seconds, where not the response's.
    given : mapping of str to Marginal, optional
        Priors that replace the default ones, by the parameter's name.

    Raises
    ------
    InputError
        If there are no counts, or a prior is given for a parameter that the model does not have.
    """
    tree, known = parse(model), dict(given or {})
    shapes = _shapes(tree, response)
    names = list(parameter_names(tree))
    unknown = [name for name in known if name not in names]
    if unknown:
        raise InputError(
            f"model {model!r}: prior for {', '.join(unknown)}, which it does not have; it has "
            f"{', '.join(names)}"
        )
    missing = [name for name in names if name not in shapes and name not in known]
    norms = _norms(model, response, missing, {**shapes, **known}, names, counts, exposure) if missing else {}
    made = {**shapes, **norms, **known}
    return Prior({name: made[name] for name in names})


def _shapes(tree: Node, response: Response) -> dict[str, Marginal]:
    low, high = response.band
    return {
        source: Uniform(low, high) if (leaf.component, parameter) in ENERGIES else table[parameter]
        # Of tied parameters the first decides.
        for leaf, table in reversed([(leaf, _table(leaf)) for leaf in leaves(tree)])
        for parameter, source in leaf.bindings
        if parameter in table and isinstance(source, str)
    }


def _table(leaf: Leaf) -> Mapping[str, Marginal]:
    return table_priors(leaf.component) if is_table(leaf.component) else SHAPES[leaf.component]


def _norms(
    model: str,
    response: Response,
    missing: list[str],
    shapes: Mapping[str, Marginal],
    names: list[str],
    counts: ArrayLike,
    exposure: ArrayLike | None,
) -> dict[str, Marginal]:
    from gaugeblock.simulators.xray.simulator import XraySpectrum

    totals = np.atleast_2d(np.asarray(counts, dtype=float)).sum(axis=1)
    rates = totals / np.asarray(response.exposure if exposure is None else exposure, dtype=float)
    rates = rates[np.isfinite(rates) & (rates > 0)]
    if not len(rates):
        raise InputError(f"priors: {response.name} holds no counts to scale the norms of {model!r} by")
    fluxes = [name for name in names if name.endswith(".lg10Flux")]
    unknown = {name: Uniform(-99.0, 99.0) if name in fluxes else LogUniform(1e-9, 1e9) for name in names}
    trial = Prior({name: shapes.get(name, unknown[name]) for name in names})
    simulator = XraySpectrum(model, response.with_exposure(1.0), trial)
    theta = trial.sample(_DRAWS, np.random.default_rng(0))
    norms: dict[str, Marginal] = {}
    emitting = [names.index(name) for name in names if _is_norm(name)]
    for name in missing:
        theta[:, emitting] = 0.0
        theta[:, [names.index(flux) for flux in fluxes]] = -99.0
        # Enough of it to lie far above the floor in every channel; the fold is linear in a norm.
        theta[:, names.index(name)] = 12.0 if name in fluxes else 1e12
        unit = simulator.expected(theta).sum(axis=1) / 1e12
        needed = np.log(1.0 / np.maximum(unit[np.isfinite(unit)], 1e-30))
        lowest, highest = np.quantile(needed, [0.1, 0.9])
        low = FAINTEST * rates.min() * np.exp(lowest)
        high = BRIGHTEST * rates.max() * np.exp(highest)
        middle, half = np.sqrt(low * high), max(0.5 * np.log10(high / low), 3.0)
        ends = float(middle * 10.0**-half), float(middle * 10.0**half)
        norms[name] = Uniform(*np.log10(ends).tolist()) if name in fluxes else LogUniform(*ends)
    return norms


def _is_norm(name: str) -> bool:
    component, parameter = name.rsplit(".", 1)
    label = component.rsplit("_", 1)[0]
    emitting = {"atable", *(entry.component.lower() for entry in COMPONENTS.values() if entry.additive)}
    return parameter == "norm" and label in emitting
