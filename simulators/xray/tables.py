"""Models that somebody computed and stored: ``atable{file}``, ``mtable{}``, ``etable{}`` (OGIP 92-009)."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import RESPONSE, opened_fits
from gaugeblock.simulators.marginals import LogUniform, Marginal, Uniform
from gaugeblock.simulators.xray.components import ADDITIVE, FACTOR, Component
from gaugeblock.simulators.xray.files import load
from gaugeblock.simulators.xray.formulas import Formula

PATTERN = re.compile(r"([aem]table)\{([^{}]+)\}")
"""Kind and file of a table in an expression."""


@dataclass(frozen=True, eq=False)
class Axis:
    """A parameter: of an interpolated one the values that the table has, ascending; none of an added one."""

    name: str
    values: Array
    logarithmic: bool
    low: float
    high: float
    initial: float
    frozen: bool


@dataclass(frozen=True, eq=False)
class Table:
    """Spectra over a grid of parameters.

    Attributes
    ----------
    axes : tuple of Axis
        First those that are interpolated, then those whose spectra are added, times the parameter.
    edges : ndarray, shape (bin + 1,)
        keV.
    spectra : ndarray, shape (1 + added, value of the first, ..., value of the last, bin + 1)
        Integrals from the lowest edge to every other: photons, or a factor or an optical depth times keV.
    redshift : bool
        Whether there is a redshift.
    outside : (below, above)
        Values beyond the lowest and the highest edge, of a factor or an optical depth.
    """

    kind: str
    axes: tuple[Axis, ...]
    edges: Array
    spectra: Array
    redshift: bool
    outside: tuple[float, float]

    @property
    def interpolated(self) -> tuple[Axis, ...]:
        """The parameters of the grid."""
        return tuple(axis for axis in self.axes if len(axis.values))

    def cumulative(self, values: Mapping[str, Any]) -> Any:
        """Integrals up to every edge at these parameters ``(bin + 1,)``, linear between the grid's spectra.

        A parameter beyond the grid has the value at its end.
        """
        import jax.numpy as jnp

        places, weights = [], []
        for axis in self.interpolated:
            scale = jnp.log if axis.logarithmic else jnp.asarray
            grid = np.log(axis.values) if axis.logarithmic else axis.values
            at = jnp.clip(scale(values[axis.name]), grid[0], grid[-1])
            i = jnp.clip(jnp.searchsorted(jnp.asarray(grid), at, side="right") - 1, 0, max(len(grid) - 2, 0))
            step = jnp.asarray(np.append(np.diff(grid), 1.0))[i]
            part = (at - jnp.asarray(grid)[i]) / step
            places.append((i, jnp.minimum(i + 1, len(grid) - 1)))
            weights.append((1.0 - part, part))
        spectra = jnp.asarray(self.spectra)
        total: Any = 0.0
        for corner in product((0, 1), repeat=len(places)):
            weight: Any = 1.0
            for k, side in enumerate(corner):
                weight = weight * weights[k][side]
            total = (
                total + weight * spectra[(slice(None), *(places[k][side] for k, side in enumerate(corner)))]
            )
        added = [values[axis.name] for axis in self.axes if not len(axis.values)]
        return sum((one * total[k] for k, one in enumerate(added, start=1)), total[0])


def is_table(component: str) -> bool:
    """Whether a component is a table, with its file in braces."""
    return PATTERN.fullmatch(component) is not None


def table_file(component: str) -> Path:
    """The file of a table."""
    found = PATTERN.fullmatch(component)
    assert found is not None
    return Path(found[2].strip())


def load_table(component: str) -> Table:
    """A table by its component, read once as long as the file stays as it is.

    Raises
    ------
    InputError
        In one line that names the file, if it is missing, no table model, or of the other kind.
    """
    file = table_file(component)
    state = file.stat() if file.is_file() else None
    key = (state.st_mtime_ns, state.st_size) if state is not None else (0, 0)
    return _loaded(component, str(file.resolve()), key)


@lru_cache(maxsize=16)
def _loaded(component: str, _path: str, _state: tuple[int, int]) -> Table:
    kind = component.partition("{")[0]
    return load("table model", table_file(component), partial(_read, kind=kind))


def _read(path: Path, *, kind: str) -> Table:
    with opened_fits(path, most=RESPONSE) as hdus:
        head = hdus[0].header
        if bool(head.get("ADDMODEL", kind == "atable")) != (kind == "atable"):
            raise InputError(
                "is a factor; use mtable or etable" if kind == "atable" else "emits; use atable instead"
            )
        rows, energies, spectra = (hdus[name] for name in ("PARAMETERS", "ENERGIES", "SPECTRA"))
        number = int(rows.header.get("NINTPARM", len(rows.data)))
        axes = tuple(_axis(row, k < number) for k, row in enumerate(rows.data))
        low, high = (np.asarray(energies.data[name], dtype=float) for name in ("ENERG_LO", "ENERG_HI"))
        shape = tuple(len(axis.values) for axis in axes[:number])
        place = _places(
            np.asarray(spectra.data["PARAMVAL"], dtype=float).reshape(len(spectra.data), -1), axes
        )
        columns = ["INTPSPEC", *(name for name in spectra.columns.names if name.upper().startswith("ADDSP"))]
        content = [np.asarray(spectra.data[name], dtype=float) for name in columns]
    if len(columns) != 1 + len(axes) - number:
        raise InputError(f"has {len(axes) - number} added parameters and {len(columns) - 1} added spectra")
    if np.any(high <= low) or np.any(np.abs(low[1:] - high[:-1]) > 1e-3 * (high - low)[:-1]):
        raise InputError("has energies that leave gaps, overlap or do not ascend; make it anew")
    if len(np.unique(place)) != int(np.prod(shape)) or len(place) != int(np.prod(shape)):
        raise InputError(f"has {len(place)} spectra for a grid of {int(np.prod(shape))}; it is not complete")
    grid = np.zeros((len(columns), int(np.prod(shape)), len(low) + 1))
    for k, one in enumerate(content):
        if one.shape != (len(place), len(low)) or not np.isfinite(one).all():
            raise InputError(f"{columns[k]} has spectra of another length than ENERGIES, or not finite")
        steps = one if kind == "atable" else one * (high - low)
        grid[k, place, 1:] = np.cumsum(steps, axis=1)
    default = 1.0 if kind == "mtable" else 0.0
    outside = (float(head.get("LOELIMIT", default)), float(head.get("HIELIMIT", default)))
    edges = np.append(low, high[-1])
    return Table(
        kind, axes, edges, grid.reshape(len(columns), *shape, -1), bool(head.get("REDSHIFT", False)), outside
    )


def _axis(row: Any, interpolated: bool) -> Axis:
    values = np.atleast_1d(np.asarray(row["VALUE"], dtype=float))[: int(row["NUMBVALS"])]
    name = re.sub(r"\W+", "_", str(row["NAME"]).strip())
    low, high = float(row["BOTTOM"]), float(row["TOP"])
    if interpolated and (not len(values) or np.any(np.diff(values) <= 0)):
        raise InputError(f"parameter {name} has no values, or some that do not ascend; make it anew")
    logarithmic = interpolated and int(row["METHOD"]) == 1
    if logarithmic and values[0] <= 0:
        raise InputError(
            f"parameter {name} is interpolated logarithmically and has values that are not positive"
        )
    if interpolated:
        low, high = max(low, float(values[0])), min(high, float(values[-1]))
    initial, frozen = float(row["INITIAL"]), float(row["DELTA"]) < 0 or not low < high
    return Axis(name, values if interpolated else np.empty(0), logarithmic, low, high, initial, frozen)


def _places(parameters: Array, axes: tuple[Axis, ...]) -> NDArray[np.int64]:
    """Where every spectrum lies in the grid, flattened."""
    place = np.zeros(len(parameters), dtype=np.int64)
    grid = [axis for axis in axes if len(axis.values)]
    if parameters.shape[1] != len(grid):
        raise InputError(f"PARAMVAL has {parameters.shape[1]} numbers for {len(grid)} parameters")
    for k, axis in enumerate(grid):
        nearest = np.abs(parameters[:, k, None] - axis.values).argmin(axis=1)
        place = place * len(axis.values) + nearest
    return np.asarray(place)


def table_entry(component: str) -> Component:
    """What there is to know of a table: its parameters in XSPEC's order; what the file froze is a number."""
    table = load_table(component)
    names = [axis.name for axis in table.axes]
    names += ["redshift"] * table.redshift + ["norm"] * (table.kind == "atable")
    fixed = {axis.name: axis.initial for axis in table.axes if axis.frozen}
    return Component(component, tuple(names), ADDITIVE if table.kind == "atable" else FACTOR, True, fixed)


def table_priors(component: str) -> Mapping[str, Marginal]:
    """Uniform over each parameter's range in the file, in the logarithm where it is interpolated so."""
    table = load_table(component)
    made: dict[str, Marginal] = {
        axis.name: (LogUniform if axis.logarithmic else Uniform)(axis.low, axis.high)
        for axis in table.axes
        if axis.low < axis.high
    }
    return made | ({"redshift": Uniform(0.0, 1.0)} if table.redshift else {})


def table_formula(component: str) -> Formula:
    """What evaluates a table: photons over a bin, or the mean of a factor."""
    table = load_table(component)

    def between(low: Any, high: Any, values: Mapping[str, Any]) -> tuple[Any, Any]:
        import jax.numpy as jnp

        scale = 1.0 + values["redshift"] if table.redshift else 1.0
        edges, cumulative = jnp.asarray(table.edges), table.cumulative(values)
        below, above = (0.0, 0.0) if table.kind == "atable" else table.outside

        def up_to(energy: Any) -> Any:
            inside = jnp.interp(energy, edges, cumulative)
            beyond = (
                jnp.maximum(energy - edges[-1], 0.0) * above - jnp.maximum(edges[0] - energy, 0.0) * below
            )
            return inside + beyond

        return up_to(high * scale) - up_to(low * scale), scale

    def integral(low: Any, high: Any, **values: Any) -> Any:
        photons, scale = between(low, high, values)
        return values["norm"] * photons / scale

    def mean(low: Any, high: Any, **values: Any) -> Any:
        import jax.numpy as jnp

        total, scale = between(low, high, values)
        average = total / ((high - low) * scale)
        return jnp.exp(-average) if table.kind == "etable" else average

    return Formula(integral=integral) if table.kind == "atable" else Formula(mean=mean)
