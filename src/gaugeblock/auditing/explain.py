"""A stranger that names its parameters in another order than the simulator's: what to write, by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import xarray as xr

from gaugeblock.diagnosis.arrangement import arrangement, toml_key
from gaugeblock.validate import Suggestion, Verdict
from gaugeblock.validate.trials import main_trials


def suggested_by_name(estimator: object, names: Sequence[str]) -> tuple[Suggestion, ...]:
    """From what provenance says of the estimator: its claims and the mapping in use; mostly nothing.

    >>> record = {"claims": {"parameters": ["b", "a"]}, "mapping": {"columns": [0, 1]}}
    >>> print(suggested_by_name(record, ["a", "b"])[0].toml)
    [estimator.parameters]
    "a" = { index = 1 }
    "b" = { index = 0 }
    """
    record: Mapping[str, Any] = estimator if isinstance(estimator, Mapping) else {}
    claims, mapping = (record.get(key) or {} for key in ("claims", "mapping"))
    theirs = claims.get("parameters") if isinstance(claims, Mapping) else None
    columns = mapping.get("columns") if isinstance(mapping, Mapping) else None
    if not isinstance(theirs, list) or columns != list(range(len(names))):
        return ()
    called = [str(name).casefold() for name in theirs]
    ours = [name.casefold() for name in names]
    if called == ours or sorted(called) != sorted(ours) or len(set(ours)) != len(ours):
        return ()
    text = (
        f"The estimator names its parameters {', '.join(map(str, theirs))}, in another order than the "
        f"simulator's {', '.join(names)}; if it draws them in the order of its names, say so."
    )
    moved = [
        f"{toml_key(name)} = {{ index = {called.index(low)} }}" for name, low in zip(names, ours, strict=True)
    ]
    return (Suggestion(text, "\n".join(["[estimator.parameters]", *moved])),)


def explained(verdict: Verdict, trials: xr.DataTree) -> Verdict:
    """The verdict with what to write: what names alone suggest, and what its diagnosis says."""
    names = [str(name) for name in main_trials(trials)["parameter"].values]
    by_name = suggested_by_name(verdict.provenance.get("estimator"), names)
    return replace(verdict, suggestions=(*by_name, *arrangement(verdict.diagnosis or {}, names)))
