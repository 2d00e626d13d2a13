"""What one validator says about Trials."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray

Kind = Literal["mean", "quantile", "count", "test", "sequence"]
Sense = Literal["two-sided", "at-least", "at-most"]


@dataclass(frozen=True)
class Suggestion:
    """What may be the matter and can be mended: in words, and as lines of TOML where there are any."""

    text: str
    toml: str = ""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One statistic, what it is an estimate of, how well it is known, and on how many trials.

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
    kind
        How an interval follows from what is stored. ``mean``: every component is asymptotically normal
        with per-trial `influence`. ``quantile``: the `quantile`-th quantile of the per-trial `values`, with
        a distribution-free interval. ``count``: an exact count. ``test``: a p-value alone.
    sense
        ``two-sided``: |estimate| must stay within the tolerance. ``at-least`` / ``at-most``: one-sided.
    components
        Names of the components, for example one per level and parameter.
    estimate, standard_error
        Shape ``(component,)``.
    influence
        ``(component, trial)``: per-trial contributions of mean zero whose average is the sampling error of
        the estimate; None unless `kind` is ``mean``. It is what makes simultaneous intervals possible.
    values
        ``(trial,)`` for kind ``quantile``.
    population
        Which trials it was computed on; findings of one population are dependent.
    p_value
        Against the point null, where there is one.
    details
        Arrays worth plotting, as a Dataset.
    caveats
        What a reader must know before leaning on the number.
    suggestions
        What may be the matter, where the statistic can tell; no verdict rests on it.
    """

    id: str
    quantity: str
    claim: str
    null: str
    reference: str
    kind: Kind
    n_trials: int
    sense: Sense = "two-sided"
    components: tuple[str, ...] = ("",)
    estimate: NDArray[np.float64]
    standard_error: NDArray[np.float64]
    influence: NDArray[np.float64] | None = None
    values: NDArray[np.float64] | None = None
    quantile: float = 0.5
    population: str = "trials"
    p_value: float | None = None
    details: xr.Dataset = field(default_factory=xr.Dataset)
    caveats: tuple[str, ...] = ()
    suggestions: tuple[Suggestion, ...] = ()

    @property
    def validator(self) -> str:
        """Name of the validator: the id up to the first dot."""
        return self.id.split(".", 1)[0]

    def to_dataset(self) -> xr.Dataset:
        """Everything the finding holds, as one Dataset; `from_dataset` restores it."""
        data: dict[str, Any] = {
            "estimate": ("component", self.estimate),
            "standard_error": ("component", self.standard_error),
        }
        if self.influence is not None:
            data["influence"] = (("component", "influence_trial"), self.influence)
        if self.values is not None:
            data["values"] = ("value_trial", self.values)
        details = self.details.rename({name: f"detail_{name}" for name in self.details.data_vars})
        attributes = {
            "id": self.id,
            "quantity": self.quantity,
            "claim": self.claim,
            "null": self.null,
            "reference": self.reference,
            "kind": self.kind,
            "sense": self.sense,
            "n_trials": self.n_trials,
            "quantile": self.quantile,
            "population": self.population,
            "p_value": np.nan if self.p_value is None else float(self.p_value),
            "caveats": json.dumps(self.caveats),
            "components": json.dumps(self.components),
            "suggestions": json.dumps([[item.text, item.toml] for item in self.suggestions]),
        }
        return xr.Dataset(data, attrs=attributes).merge(details, combine_attrs="override")

    @classmethod
    def from_dataset(cls, dataset: xr.Dataset) -> Finding:
        """Inverse of `to_dataset`."""
        attributes = dataset.attrs
        names = [str(name) for name in dataset.data_vars if str(name).startswith("detail_")]
        details = dataset[names].rename({name: name.removeprefix("detail_") for name in names})
        details.attrs = {}
        p_value = float(attributes["p_value"])
        return cls(
            id=str(attributes["id"]),
            quantity=str(attributes["quantity"]),
            claim=str(attributes["claim"]),
            null=str(attributes["null"]),
            reference=str(attributes["reference"]),
            kind=attributes["kind"],
            sense=attributes["sense"],
            n_trials=int(attributes["n_trials"]),
            components=tuple(json.loads(attributes["components"])),
            estimate=np.asarray(dataset["estimate"].values, dtype=float),
            standard_error=np.asarray(dataset["standard_error"].values, dtype=float),
            influence=np.asarray(dataset["influence"].values) if "influence" in dataset else None,
            values=np.asarray(dataset["values"].values) if "values" in dataset else None,
            quantile=float(attributes["quantile"]),
            population=str(attributes["population"]),
            p_value=None if np.isnan(p_value) else p_value,
            details=details,
            caveats=tuple(json.loads(attributes["caveats"])),
            suggestions=tuple(Suggestion(*item) for item in json.loads(attributes.get("suggestions", "[]"))),
        )


@dataclass(frozen=True)
class NotChecked:
    """A check that could not be made, and why."""

    id: str
    why: str
