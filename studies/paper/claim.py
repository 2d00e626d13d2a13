"""One published number: what it says, what must hold of ours, and which experiment measures it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from gaugeblock.core.errors import InputError
from studies.paper.auc_error import auc_error
from studies.paper.rules import Rule, rule_of

SINGLE = ("value",)


class Kind(Enum):
    """What a claim depends on; the value is how it is said."""

    EXACT = "exact"
    """Published rows, which are at hand."""
    SIMULATOR = "simulator"
    """The simulator alone: no trained flow."""
    FLOW = "flow"
    """A trained flow: another training gives another number."""
    ARITHMETIC = "arithmetic"
    """Other published numbers."""
    SETUP = "setup"
    """A fact of the configuration."""
    ARTEFACT = "artefact"
    """Something else than what it was taken for."""


class Counted(Enum):
    """What a verdict on a claim is worth; the value is how it is said."""

    JUDGED = "judged"
    """A measurement of its own."""
    REPORTED = "reported"
    """Nothing was said that must hold: our number stands beside the published one."""
    REPEATED = "repeated"
    """Another claim's measurement, in other words."""
    RECOMPUTED = "recomputed"
    """From published numbers, or a setting that we copy: it cannot come out otherwise."""


@dataclass(frozen=True, kw_only=True)
class Claim:
    """One published number or a few that belong together.

    `value` is as published: a number, a list whose `parts` have names, a table, or words. `parts` are the
    numbers in it by name, `error` their published or sampling standard errors where there are any. All
    `rules` must hold of what `by`, an experiment, measures. `known` are parts whose true value is known, as
    1/2 is of an AUC where there is nothing to see. `transfer`: measured with another response than the
    published one, which is not distributed. `counted` is what its verdict is worth. `chosen`: our spectra
    were picked by the outcome that is claimed. `deterministic`: our number is no estimate, it has no error.
    `paired`: our spectra are the study's own, so that their noise is in both numbers alike. `network` says
    whose network the rules speak of, where ours is another.
    """

    id: str
    section: str
    says: str
    kind: Kind
    value: Any
    parts: Mapping[str, float]
    error: Mapping[str, float]
    rules: tuple[Rule, ...]
    by: str
    known: Mapping[str, float] = field(default_factory=dict)
    transfer: bool = False
    note: str = ""
    counted: Counted = Counted.JUDGED
    chosen: bool = False
    deterministic: bool = False
    paired: bool = False
    network: str = ""

    @property
    def needs(self) -> tuple[str, ...]:
        """Parts that a measurement must have: those published and those the rules look at."""
        looked_at = (part for rule in self.rules for part in rule.of)
        return tuple(dict.fromkeys((*self.parts, *looked_at)))


def claim_of(name: str, section: str, table: Mapping[str, Any]) -> Claim:
    """A claim from its table.

    Raises
    ------
    InputError
        For a table that is no claim.
    """
    where = f"claim {name}"
    unknown = set(table) - {"says", "kind", "value", "parts", "error", "rules", "by", "transfer", "note"}
    missing = {"says", "kind", "value", "rules", "by"} - set(table)
    if unknown or missing:
        raise InputError(f"{where}: lacks or does not know {', '.join(sorted(unknown | missing))}")
    parts = _parts(where, table["value"], tuple(table.get("parts", ())))
    over = tuple(table.get("parts", ())) or tuple(parts) or SINGLE
    return Claim(
        id=name,
        section=section,
        says=table["says"],
        kind=Kind(table["kind"]),
        value=table["value"],
        parts=parts,
        error=_errors(where, table.get("error"), parts),
        rules=tuple(rule_of(rule, over, where) for rule in table["rules"]),
        by=table["by"],
        transfer=table.get("transfer", False),
        note=table.get("note", ""),
    )


def _parts(where: str, value: Any, names: tuple[str, ...]) -> dict[str, float]:
    if isinstance(value, str):
        return {}
    if isinstance(value, bool | int | float):
        return {SINGLE[0]: float(value)}
    if isinstance(value, Mapping):
        chosen = names or tuple(value)
        return {name: float(value[name]) for name in chosen}
    flat = [float(x) for entry in value for x in (entry if isinstance(entry, list) else [entry])]
    if len(flat) != len(names):
        raise InputError(f"{where}: {len(flat)} numbers and {len(names)} names of parts")
    return dict(zip(names, flat, strict=True))


def _errors(where: str, given: Any, parts: Mapping[str, float]) -> dict[str, float]:
    if given is None:
        return {}
    if isinstance(given, bool | int | float):
        return dict.fromkeys(parts, float(given))
    if set(given) == {"auc"}:
        clean, suspicious = given["auc"]
        return {name: auc_error(value, clean, suspicious) for name, value in parts.items()}
    if not set(given) <= set(parts):
        raise InputError(f"{where}: errors of {', '.join(given)}, which are no parts of it")
    return {name: float(error) for name, error in given.items() if np.isfinite(error)}
