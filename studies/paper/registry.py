"""All published claims by id, from the tables in `claims/`."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Any

from gaugeblock.core.errors import InputError
from studies.paper.auc_error import auc_error, null_auc_error
from studies.paper.claim import SINGLE, Claim, Counted, Kind, claim_of
from studies.paper.rules import Interval, Rule, Within

TABLES = (
    *("introduction", "setup", "table-1", "detection", "calibration", "table-2", "importance", "table-3"),
    *("table-4", "evidence", "gain", "cross-check", "conformal", "amplitude"),
)
"""Files of claims in the order of the paper; the grid of detectors comes last."""

DETECTORS = ("D1", "D2", "D3")
CLEAN, SUSPICIOUS = 200, 100
"""Spectra behind an AUC of the grid."""

NULL_REACH = 0.08
"""How far a cell of the gain may lie from 1/2."""

TWO_REPLICATIONS = 2.0 * 2.0**0.5
"""Two independent measurements lie within so many standard errors of one in 95 of 100 cases."""

GRIDS = {
    "pn": ("Detection grid, EPIC-pn", "detection"),
    "nicer": ("Detection grid, NICER", "detection_nicer"),
}


RECOMPUTING = "published"
"""The experiment that computes claims again from published numbers alone."""


@cache
def claims() -> Mapping[str, Claim]:
    """Every claim by its id, in the order of the paper."""
    found: dict[str, Claim] = {}
    for name in TABLES:
        table = _read(name)
        section = table["section"]
        found |= {key: claim_of(key, section, table[key]) for key in table if key != "section"}
    found |= {claim.id: claim for claim in _grid(_read("grid"))}
    classes = _read("classes")
    return {key: _classed(claim, classes) for key, claim in found.items()}


def _classed(claim: Claim, classes: Mapping[str, Any]) -> Claim:
    """A claim with what its verdict is worth."""
    if claim.by == RECOMPUTING or claim.id in classes["recomputed"]:
        counted = Counted.RECOMPUTED
    elif repeats(claim.id):
        counted = Counted.REPEATED
    else:
        counted = Counted.JUDGED if claim.rules else Counted.REPORTED
    own = {word: claim.id in classes[word] for word in ("chosen", "deterministic")}
    networks = classes["network"].items() if claim.kind is Kind.FLOW else ()
    network = next((name for name, patterns in networks if _among(claim.id, patterns)), "")
    paired = _among(claim.id, classes["paired"]) or _is_of_kept_spectra(claim.id)
    return replace(claim, counted=counted, paired=paired, network=network, **own)


def _among(name: str, patterns: Iterable[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def _is_of_kept_spectra(name: str) -> bool:
    """Whether a claim is a cell of the grid whose spectra come out of the study's seeds again."""
    from studies.paper.grid_populations import is_kept

    if not name.startswith("grid.pn."):
        return False
    level, family, *strength, _ = name.split(".")[2:]
    return is_kept(level, family, float(".".join(strength)))


def repeats(name: str) -> str:
    """Whose measurement a claim repeats; nothing where it has its own."""
    patterns = _read("classes")["repeated"].items()
    return next((of for pattern, of in patterns if fnmatchcase(name, pattern)), "")


def find(names: tuple[str, ...]) -> dict[str, Claim]:
    """The claims that are named, by id or by the experiment that measures them; all without names.

    Raises
    ------
    InputError
        For a name that is neither.

    >>> list(find(("gm.prior",)))
    ['gm.prior']
    """
    every = claims()
    experiments = {claim.by for claim in every.values()}
    for name in names:
        if name not in every and name not in experiments:
            raise InputError(
                f"{name!r} is neither a claim nor an experiment; python -m studies.paper --list names them"
            )
    return {key: claim for key, claim in every.items() if not names or key in names or claim.by in names}


@cache
def _read(name: str) -> dict[str, Any]:
    return tomllib.loads((Path(__file__).parent / "claims" / f"{name}.toml").read_text(encoding="utf-8"))


def _grid(table: Mapping[str, Any]) -> Iterator[Claim]:
    """The cells of the grid: AUCs whose tolerance follows from their standard error.

    A cell of the gain, B4, has to lie where the null does; any other within what two independent
    measurements differ by.
    """
    for response, levels in table.items():
        section, experiment = GRIDS[response]
        for level, families in levels.items():
            for family, rows in families.items():
                for row in rows:
                    for detector, value in zip(DETECTORS, row["auc"], strict=True):
                        strength = repr(row["strength"]).removesuffix(".0")
                        yield Claim(
                            id=f"grid.{response}.{level}.{family}.{strength}.{detector}",
                            section=section,
                            says=f"AUC of {detector}, {family} at {strength}, {level}",
                            kind=Kind.FLOW,
                            value=value,
                            parts={SINGLE[0]: value},
                            by=experiment,
                            transfer=response == "nicer",
                            **_tolerated(value, null=family == "B4"),
                        )


def _tolerated(value: float, *, null: bool) -> dict[str, Any]:
    """Error, rule and known value of a cell."""
    if null:
        rule: Rule = Interval(SINGLE, 0.5 - NULL_REACH, 0.5 + NULL_REACH)
        error, known = null_auc_error(CLEAN, SUSPICIOUS), {SINGLE[0]: 0.5}
    else:
        error, known = auc_error(value, CLEAN, SUSPICIOUS), {}
        rule = Within(SINGLE, round(TWO_REPLICATIONS * error, 3))
    return {"error": {SINGLE[0]: error}, "rules": (rule,), "known": known}
