"""What one validator says about Trials: a class for each way in which an interval follows from it."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, Self

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from gaugeblock.core.values import Value
from gaugeblock.validate.contributions import contributions, of_several

Sense = Literal["two-sided", "at-least", "at-most"]


@dataclass(frozen=True)
class Suggestion:
    """What may be the matter and can be mended: in words, and as lines of TOML where there are any."""

    text: str
    toml: str = ""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Finding(Value):
    """One statistic, what it is an estimate of, how well it is known, and on how many trials.

    What all kinds share; a validator makes one of the kinds below.

    Attributes
    ----------
    id
        Validator's name, then what it looked at: ``sbc.bias[tbabs_1.nh]``, ``coverage.central``.
    quantity
        Name of the tolerance a policy holds it to (``bias``, ``log_width``, ``coverage``, ``ess``, ...), or
        an empty string where it is reported but never judged.
    claim
        One line for people: what the numbers are, with units.
    null
        What holds for a perfect estimator.
    reference
        The paper, or the argument, behind the statistic.
    sense
        ``two-sided``: |estimate| must stay within the tolerance. ``at-least`` / ``at-most``: one-sided.
    components
        Names of the components, for example one per level and parameter.
    estimate, standard_error
        Shape ``(component,)``.
    population
        Which trials it was computed on; findings of one population are dependent.
    p_value
        Against the point null; NaN where there is none.
    details
        Arrays worth plotting, as a Dataset.
    caveats
        What a reader must know before leaning on the number.
    doubt
        Why it is nothing that a gate could PASS by, though one may FAIL by it; mostly empty.
    excuse
        Why it is nothing that a gate could FAIL by, though one may PASS by it; mostly empty.
    """

    kind: ClassVar[str] = ""
    arrays: ClassVar[dict[str, tuple[str, ...]]] = {
        "estimate": ("component",),
        "standard_error": ("component",),
    }
    words: ClassVar[tuple[str, ...]] = (
        *("id", "quantity", "claim", "null", "reference", "sense"),
        *("n_trials", "population", "p_value"),
    )

    id: str
    quantity: str
    claim: str
    null: str
    reference: str
    n_trials: int
    sense: Sense = "two-sided"
    components: tuple[str, ...] = ("",)
    estimate: Array
    standard_error: Array
    population: str = "trials"
    p_value: float = math.nan
    details: xr.Dataset = field(default_factory=xr.Dataset)
    caveats: tuple[str, ...] = ()
    doubt: str = ""
    excuse: str = ""

    @property
    def validator(self) -> str:
        """Name of the validator: the id up to the first dot."""
        return self.id.split(".", 1)[0]

    def of(self, kept: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> Self:
        """The same finding of some of its components, ``(component,)``."""
        rows = {
            name: getattr(self, name)[kept] for name, dims in self.arrays.items() if dims[0] == "component"
        }
        names = tuple(name for name, wanted in zip(self.components, kept, strict=True) if wanted)
        return replace(self, components=names, **rows)

    def to_dataset(self) -> xr.Dataset:
        """Everything the finding holds, as one Dataset; `finding_from` restores it."""
        details = self.details.rename({name: f"detail_{name}" for name in self.details.data_vars})
        attributes = {
            "kind": self.kind,
            **{name: getattr(self, name) for name in self.words},
            "caveats": json.dumps(self.caveats),
            "components": json.dumps(self.components),
            **{name: said for name in ("doubt", "excuse") if (said := getattr(self, name))},
        }
        data = {name: (dims, getattr(self, name)) for name, dims in self.arrays.items()}
        return xr.Dataset(data, attrs=attributes).merge(details, combine_attrs="override")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MeanFinding(Finding):
    """Components that are asymptotically normal, with what every trial contributed.

    `influence` ``(component, trial)``: contributions of mean zero whose average is the sampling error of the
    estimate. It is what makes simultaneous intervals possible. Of very many trials those of several in a row
    are kept together (see `contributions`).
    """

    kind: ClassVar[str] = "mean"
    arrays: ClassVar[dict[str, tuple[str, ...]]] = {
        **Finding.arrays,
        "influence": ("component", "influence_trial"),
    }

    influence: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "influence", of_several(self.influence))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class QuantileFinding(Finding):
    """Quantiles of the trials' `values` ``(component, trial)``: intervals that no distribution can spoil.

    `quantile` ``(component,)`` says which. The estimate is an order statistic (see `quantiles`).
    """

    kind: ClassVar[str] = "quantile"
    arrays: ClassVar[dict[str, tuple[str, ...]]] = {
        **Finding.arrays,
        "quantile": ("component",),
        "values": ("component", "value_trial"),
    }

    values: Array
    quantile: Array

    @property
    def influence(self) -> Array:
        """Contributions of mean zero to the share of values up to the estimate, as of a mean."""
        below = self.values <= self.estimate[:, None]
        share = below.mean(axis=1, keepdims=True)
        return contributions(below.shape[1], lambda rows: np.asarray(below[:, rows] - share))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class RootFinding(MeanFinding):
    """Where a rising mean over trials crosses 0: bounds are where it is still, or already, off by its error.

    `curve` ``(component, place)`` is the mean at each `place` ``(place,)``; `influence`, here, is of the mean
    at the estimate.
    """

    kind: ClassVar[str] = "root"
    arrays: ClassVar[dict[str, tuple[str, ...]]] = {
        **MeanFinding.arrays,
        "curve": ("component", "place"),
        "place": ("place",),
    }

    curve: Array
    place: Array


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class CountFinding(Finding):
    """Exact counts of what must not happen at all."""

    kind: ClassVar[str] = "count"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PValueFinding(Finding):
    """A p-value, and what it was computed from: reported, never judged."""

    kind: ClassVar[str] = "test"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SequenceFinding(Finding):
    """Bounded scores trial by trial, so that one may stop watching at any time.

    `score` ``(component, trial)``; `expected`, of an exact estimator, has as many columns or one; `draws` is
    the number in each pool, where it matters, or infinite.
    """

    kind: ClassVar[str] = "sequence"
    arrays: ClassVar[dict[str, tuple[str, ...]]] = {
        **Finding.arrays,
        "score": ("component", "sequence_trial"),
        "expected": ("component", "expected_trial"),
    }
    words: ClassVar[tuple[str, ...]] = (*Finding.words, "draws")

    score: np.ndarray[Any, np.dtype[Any]]
    expected: Array
    draws: float = math.inf


KINDS = {
    each.kind: each
    for each in (MeanFinding, QuantileFinding, RootFinding, CountFinding, PValueFinding, SequenceFinding)
}


def finding_from(dataset: xr.Dataset) -> Finding:
    """The finding that `to_dataset` made this of.

    Raises
    ------
    KeyError, ValueError
        If the dataset is none.
    """
    attributes = dataset.attrs
    made = KINDS[attributes["kind"]]
    named = {str(name): str(name).removeprefix("detail_") for name in dataset.data_vars}
    details = dataset[[name for name in named if name.startswith("detail_")]]
    details = details.rename({name: named[name] for name in map(str, details.data_vars)})
    details.attrs = {}
    held: dict[str, Any] = {name: attributes[name] for name in made.words}
    # NetCDF has no Python numbers.
    held |= {name: float(held[name]) for name in ("p_value", "draws") if name in held}
    held |= {name: np.asarray(dataset[name].values) for name in made.arrays}
    return made(
        **held | {"n_trials": int(held["n_trials"])},
        components=tuple(json.loads(attributes["components"])),
        details=details,
        caveats=tuple(json.loads(attributes["caveats"])),
        doubt=str(attributes.get("doubt", "")),
        excuse=str(attributes.get("excuse", "")),
    )


@dataclass(frozen=True)
class NotChecked:
    """A check that could not be made, and why; `without_data`: the trials hold no x that it could look at."""

    id: str
    why: str
    without_data: bool = False
