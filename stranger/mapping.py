"""A stranger's parameters and the simulator's: another order, other names, other units, another scale.

    [estimator.parameters]
    "tbabs_1.nh" = "NH"                                            # the stranger's name for it
    "powerlaw_1.alpha" = 0                                         # or its column, counted from 0
    "powerlaw_1.norm" = { name = "norm", transform = "log10" }     # the stranger draws its log10
    "blackbodyrad_1.kT" = { index = 3, unit = 0.001 }              # the stranger draws eV, the simulator keV

For each parameter the simulator's value is ``offset + unit * inverse_transform(stranger's value)``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from collections.abc import Mapping as Table_
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.tables import Table, checked

WHERE = "estimator.parameters"
LOG_10 = math.log(10)


@dataclass(frozen=True)
class Transform:
    """How a stranger may hold a number: `forward` to its scale, `inverse` back.

    `log_slope` is the natural log of d forward / d number, at a value on the stranger's scale.
    """

    forward: Callable[[Array], Array]
    inverse: Callable[[Array], Array]
    log_slope: Callable[[Array], Array]


TRANSFORMS: dict[str, Transform] = {
    "none": Transform(lambda y: y, lambda s: s, np.zeros_like),
    "log10": Transform(np.log10, lambda s: 10.0**s, lambda s: -LOG_10 * s - math.log(LOG_10)),
    "log": Transform(np.log, np.exp, lambda s: -s),
    "logit": Transform(special.logit, special.expit, lambda s: np.logaddexp(0, s) + np.logaddexp(0, -s)),
    # The other way round: the simulator's parameter is a logarithm, and the stranger draws the number itself.
    "exp10": Transform(lambda y: 10.0**y, np.log10, lambda s: np.log(s) + math.log(LOG_10)),
    "exp": Transform(np.exp, np.log, np.log),
}


class Entry(Table):
    """Where one parameter is among the stranger's, and on what scale."""

    name: Annotated[str, Field(min_length=1)] | None = None
    index: Annotated[int, Field(ge=0, strict=True)] | None = None
    transform: Literal["none", "log10", "log", "logit", "exp10", "exp"] = "none"
    unit: Annotated[float, Field(allow_inf_nan=False)] = 1.0
    offset: Annotated[float, Field(allow_inf_nan=False)] = 0.0


@dataclass(frozen=True, kw_only=True)
class Mapping:
    """For each of the simulator's parameters its column among the stranger's, and its scale there.

    `columns`, `transforms`, `units` and `offsets` are in the simulator's order; `width` is how many columns
    the stranger has, as far as known: one it has beyond the simulator's is left out of the draws, and then it
    has no density in the simulator's parameters.
    """

    columns: tuple[int, ...]
    transforms: tuple[str, ...]
    units: tuple[float, ...]
    offsets: tuple[float, ...]
    width: int

    @classmethod
    def of(
        cls, table: Table_[str, Any] | None, names: Sequence[str], *, stranger: Sequence[str] | None = None
    ) -> Mapping:
        """From the TOML table (none: as it is), the simulator's `names`, and what the stranger calls its own.

        A parameter that the table leaves out is in its own place: names alone move nothing.

        Raises
        ------
        InputError
            For a parameter or a name that does not exist, an index out of range, two parameters from one
            column, or an impossible unit.

        >>> mapping = Mapping.of({"a": 1, "b": {"index": 0, "transform": "log10"}}, ["a", "b"])
        >>> mapping.to_simulator([[2.0, 7.0]]).tolist()
        [[7.0, 100.0]]
        """
        entries = _entries(table or {}, names)
        columns = tuple(_column(place, name, entries[name], stranger) for place, name in enumerate(names))
        for place, column in enumerate(columns):
            first = columns.index(column)
            if first != place:
                raise InputError(
                    f"{WHERE}: {names[first]} and {names[place]} both come from the stranger's "
                    f"{_called(column, stranger)}; give each a column of its own"
                )
        said = [entries[name] for name in names]
        return cls(
            columns=columns,
            transforms=tuple(entry.transform for entry in said),
            units=tuple(entry.unit for entry in said),
            offsets=tuple(entry.offset for entry in said),
            width=max(columns, default=-1) + 1 if stranger is None else len(stranger),
        )

    @property
    def whole(self) -> bool:
        """Whether each of the stranger's columns is used, so that its density is one of the simulator's."""
        return len(self.columns) == self.width

    def to_simulator(self, draws: ArrayLike) -> Array:
        """The stranger's values ``(..., column)`` as the simulator's parameters ``(..., parameter)``.

        What overflows becomes infinite, what has no logarithm NaN: such draws are counted, not hidden.

        Raises
        ------
        InputError
            If there are fewer columns than the mapping needs.
        """
        theirs = self._known(draws)
        mapped = np.empty((*theirs.shape[:-1], len(self.columns)))
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for place, column in enumerate(self.columns):
                inverse = TRANSFORMS[self.transforms[place]].inverse
                mapped[..., place] = self.offsets[place] + self.units[place] * inverse(theirs[..., column])
        return mapped

    def from_simulator(self, theta: ArrayLike) -> Array:
        """The simulator's parameters ``(..., parameter)`` on the stranger's scale and in its order.

        NaN where a transform is not defined there: the stranger's density is zero at such a theta.

        Raises
        ------
        InputError
            If the stranger has columns that the mapping leaves out, or `theta` has another number of them.
        """
        ours = np.asarray(theta, dtype=float)
        if not self.whole:
            raise InputError(
                f"{WHERE}: {self.width - len(self.columns)} of the stranger's {self.width} columns are left "
                "out, so it has no density in the simulator's parameters"
            )
        if ours.shape[-1:] != (len(self.columns),):
            raise InputError(f"theta of shape {ours.shape}; its last axis must be {len(self.columns)} long")
        mapped = np.empty(ours.shape)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for place, column in enumerate(self.columns):
                number = (ours[..., place] - self.offsets[place]) / self.units[place]
                value = TRANSFORMS[self.transforms[place]].forward(number)
                mapped[..., column] = np.where(np.isfinite(value), value, np.nan)
        return mapped

    def log_jacobian(self, draws: ArrayLike) -> Array:
        """log |d stranger / d simulator| at the stranger's values ``(..., column)``, shape ``(...)``.

        Added to the stranger's log density it gives that of the simulator's parameters.
        """
        theirs = self._known(draws)
        total = np.full(theirs.shape[:-1], -sum(math.log(abs(unit)) for unit in self.units))
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            for place, column in enumerate(self.columns):
                total = total + TRANSFORMS[self.transforms[place]].log_slope(theirs[..., column])
        return total

    def to_json(self) -> dict[str, list[Any]]:
        """Plain data, for provenance."""
        return {key: list(getattr(self, key)) for key in ("columns", "transforms", "units", "offsets")}

    def _known(self, draws: ArrayLike) -> Array:
        theirs = np.asarray(draws, dtype=float)
        needed = max(self.columns, default=-1) + 1
        if theirs.ndim == 0 or theirs.shape[-1] < needed:
            raise InputError(
                f"{WHERE}: needs the stranger's column {needed - 1}, and its draws have shape "
                f"{theirs.shape}; columns are counted from 0"
            )
        return theirs


def _entries(table: Table_[str, Any], names: Sequence[str]) -> dict[str, Entry]:
    """One entry for each of the simulator's parameters, as the table says or as it is."""
    unknown = [name for name in table if name not in names]
    if unknown:
        raise InputError(f"{WHERE}: {unknown[0]!r} is no parameter; the simulator has {', '.join(names)}")
    entries = dict.fromkeys(names, Entry())
    for name, value in table.items():
        where = f"{WHERE}.{name}"
        if isinstance(value, str):
            value = {"name": value}
        elif isinstance(value, int) and not isinstance(value, bool):
            value = {"index": value}
        elif not isinstance(value, Table_):
            raise InputError(f"{where}: {value!r} must be a name, a column counted from 0, or a table")
        entry = checked(Entry, value, where=where)
        if entry.name is not None and entry.index is not None:
            raise InputError(f"{where}: name and index are both given; one of them says which column")
        if entry.unit == 0:
            raise InputError(f"{where}: unit = 0 leaves nothing of the parameter; give a factor")
        entries[name] = entry
    return entries


def _column(place: int, name: str, entry: Entry, stranger: Sequence[str] | None) -> int:
    """Which of the stranger's columns the parameter is."""
    where = f"{WHERE}.{name}"
    if entry.index is not None:
        if stranger is not None and entry.index >= len(stranger):
            raise InputError(
                f"{where}: index {entry.index} is out of range; the stranger's columns are 0 to "
                f"{len(stranger) - 1}"
            )
        return entry.index
    if entry.name is not None:
        if stranger is None:
            raise InputError(f"{where}: the stranger does not name its parameters; give an index instead")
        if entry.name not in stranger:
            raise InputError(
                f"{where}: the stranger has no parameter {entry.name!r}; it has {', '.join(stranger)}"
            )
        return list(stranger).index(entry.name)
    if stranger is not None and place >= len(stranger):
        raise InputError(f"{where}: the stranger has {len(stranger)} parameters only; say which it is")
    return place


def _called(column: int, stranger: Sequence[str] | None) -> str:
    return f"column {column}" if stranger is None else f"parameter {stranger[column]!r}"
