"""The registry of validators, and one call that runs them over Trials."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import xarray as xr

from gaugeblock.errors import InputError
from gaugeblock.validate.coverage import coverage
from gaugeblock.validate.finding import Finding, NotChecked
from gaugeblock.validate.finite import finite
from gaugeblock.validate.importance import importance
from gaugeblock.validate.prepared import Prepared
from gaugeblock.validate.sbc import sbc

Validator = Callable[[Prepared], list[Finding | NotChecked]]

# Name (the part of every finding's id before the first dot) -> validator. A validator returns a NotChecked
# for each finding that the trials do not allow.
VALIDATORS: Mapping[str, Validator] = {
    "draws": finite,
    "sbc": sbc,
    "coverage": coverage,
    "importance": importance,
}


def run_validators(
    tree: xr.DataTree | xr.Dataset, *, seed: int, select: Iterable[str] | None = None
) -> tuple[tuple[Finding, ...], tuple[NotChecked, ...]]:
    """Findings of every validator (or those in `select`), and exactly what could not be checked and why.

    The same trials and seed give the same bits, in whatever order or chunks the trials were made.

    Raises
    ------
    InputError
        If `select` names a validator that does not exist.
    """
    chosen = list(VALIDATORS) if select is None else list(select)
    check_validators(chosen)
    prepared = Prepared(xr.DataTree(tree) if isinstance(tree, xr.Dataset) else tree, seed)
    said = [item for name in VALIDATORS if name in chosen for item in VALIDATORS[name](prepared)]
    return (
        tuple(item for item in said if isinstance(item, Finding)),
        tuple(item for item in said if isinstance(item, NotChecked)),
    )


def check_validators(names: Iterable[str]) -> None:
    """Raise InputError for a name that no validator has."""
    unknown = [name for name in names if name not in VALIDATORS]
    if unknown:
        raise InputError(f"unknown validator {', '.join(unknown)}; there are {', '.join(VALIDATORS)}")
