"""Looks at an audit, as its folder and a ledger know them: what was judged before, and which trials are kept.

The record is `looks.json` beside the verdict: the trials at each look, by a key of all that makes two audits
one: simulator, estimator, policy and how trials are made; of draws in hand, which say nothing of these, the
first ten trials. Judging the same trials as before is the same look again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.auditing.identity import lasting, versions
from gaugeblock.auditing.provenance import FORMAT, digests, finished_audit, intrinsic, settings, sizes
from gaugeblock.core.atomic import discard_unfinished, write_atomically
from gaugeblock.core.digest import digest, file_digest
from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import read_json
from gaugeblock.core.processors import processor
from gaugeblock.reports.machine import plain
from gaugeblock.validate.looks import Looks
from gaugeblock.validate.policy import Policy, make_policy
from gaugeblock.validate.storage import block_length
from gaugeblock.validate.trials import GROUPS, group_trials, main_trials, read_trials

RECORD = "looks.json"
KEPT = {"looks": list, "truths": str, "policy": str, "anew": bool, "other_policies": int}
# Trials that make draws in hand known again: an audit has no fewer.
FIRST = 10


@dataclass(frozen=True, kw_only=True)
class Look:
    """One look: digests of what is looked at, of its truths and its policy, and at which trials.

    `audit` is of estimator, simulator and how trials are made, or of the first draws.
    """

    audit: str
    truths: str
    policy: str
    at: Mapping[str, Any]

    @property
    def key(self) -> str:
        """Of the audit whose looks are counted together."""
        return digest([self.audit, self.policy])


def audit_look(record: Mapping[str, Any], policy: Policy, *, seed: int | None) -> Look:
    """A look at an audit of a simulator; a `seed` that nobody chose is None."""
    same = _same(record)
    made = same["trials"]
    return Look(
        audit=digest(plain({**same, "trials": {**made, "seed": seed}})),
        truths=digest(plain([same["simulator"], made["seed"], made["block"]])),
        policy=_of_policy(policy),
        at=sizes(record["trials"]),
    )


def draws_look(tree: xr.DataTree, policy: Policy, *, seed: int) -> Look:
    """A look at draws in hand: whatever begins with the same truths and draws is the same audit.

    The same look again it is only of the same arrays with the same `seed` of the statistics: trials that were
    exchanged behind the first ones are looked at anew.
    """
    main = main_trials(tree)
    first = main.isel(trial=slice(FIRST))
    groups = [main, *filter(None, (group_trials(tree, name) for name in GROUPS))]
    return Look(
        audit=_arrays_digest(first[["theta_true", "draws"]]),
        truths=_arrays_digest(first[["theta_true"]]),
        policy=_of_policy(policy),
        at={"trials": main.sizes["trial"], "sha256": digest([seed, *map(_arrays_digest, groups)])},
    )


def _of_policy(policy: Policy) -> str:
    return digests({"policy": plain(policy.model_dump(mode="json"))})["policy"]


def _arrays_digest(trials: xr.Dataset) -> str:
    """SHA-256 of all arrays of Trials, as the numbers that they are, in whatever precision they are kept."""
    found, number = hashlib.sha256(), trials.sizes["trial"]
    for name in sorted(map(str, trials.data_vars)):
        array = trials[name]
        found.update(f"{name} {array.shape}".encode())
        length = block_length(array.size // number) if "trial" in array.dims else number
        for start in range(0, number, length):
            part = array.isel(trial=slice(start, start + length), missing_dims="ignore").values
            numeric = np.issubdtype(part.dtype, np.number)
            found.update(part.astype(float).tobytes() if numeric else digest(part.tolist()).encode())
    return found.hexdigest()


def _same(record: Mapping[str, Any]) -> dict[str, Any]:
    """What of a record stays as it is when an audit is enlarged."""
    return {
        "simulator": intrinsic(record["simulator"]),
        "estimator": intrinsic(record["estimator"]),
        "trials": settings(record["trials"]),
    }


def look_at(
    folder: Path | None, look: Look, *, known: Iterable[Mapping[str, int]] = (), other_policies: int = 0
) -> Looks:
    """This look, after those in the folder, which records it, and those of `known` sizes elsewhere.

    `other_policies` is how often these truths were judged under another policy, as far as is known elsewhere.

    Raises
    ------
    InputError
        If the record is damaged, or cannot be written.
    """
    audits = {} if folder is None else _read(folder / RECORD)
    found = audits.get(look.key) or {
        "looks": [],
        "truths": look.truths,
        "policy": look.policy,
        "anew": bool(audits),
        "other_policies": sum(
            one["truths"] == look.truths and one["policy"] != look.policy for one in audits.values()
        ),
    }
    looks: list[Mapping[str, Any]] = []
    for one in (*known, *found["looks"], look.at):
        if one not in looks:
            looks.append(one)
    if folder is not None and looks != found["looks"]:
        content = {**audits, look.key: {**found, "looks": looks}}
        write_atomically(folder / RECORD, json.dumps(content, indent=2, sort_keys=True) + "\n")
        discard_unfinished(folder, (RECORD,))
    return Looks(
        trials=tuple(one["trials"] for one in looks[: looks.index(look.at) + 1]),
        anew=found["anew"],
        other_policies=max(found["other_policies"], other_policies),
    )


def enter_saved(folder: Path, tree: xr.DataTree, record: Mapping[str, Any], looks: Looks) -> None:
    """Enter an audit that was judged without this folder, so that the next look in it counts that one.

    `record` is its provenance.

    Raises
    ------
    InputError
        If the record of looks is damaged, or cannot be written.
    """
    policy = make_policy(record["policy"], source="the audit's policy")
    if "block" in record["trials"]:
        look = audit_look(record, policy, seed=record["seed"])
    else:
        look = draws_look(tree, policy, seed=record["seed"])
    there = _read(folder / RECORD).get(look.key, {"looks": []})
    if look.at not in there["looks"]:
        look_at(folder, look, known=[{"trials": number} for number in looks.trials[:-1]])


def stored_looks(verdict: Mapping[str, Any]) -> Looks:
    """Looks as verdict.json states them; one that was written before they were counted is the first."""
    stated = verdict.get("looks")
    try:
        table = dict(stated or {})
        table.pop("number", None)
        trials = tuple(int(number) for number in table.get("trials", ()))
        return Looks(**{**table, "trials": trials, "other_policies": int(table.get("other_policies", 0))})
    except (TypeError, ValueError):
        raise InputError(f"verdict.json: looks is {stated!r}; it must be as the audit wrote it") from None


def earlier_trials(folder: Path, record: Mapping[str, Any], *flows: str) -> xr.DataTree | None:
    """The finished trials in a folder that begin an audit of this record, or None where they do not.

    They have to be those that the verdict beside them was found from, made by the same versions on the same
    processor; `flows` are the estimator's devices.
    """
    try:
        audited = finished_audit(folder)["provenance"]
        same = _same(audited) == _same(plain(record)) and lasting(_same(audited))
        same = same and audited.get("processors") == [processor(*flows)]
        if not same or audited.get("format") != FORMAT or audited.get("versions") != versions():
            return None
        path = folder / "trials.nc"
        kept = file_digest(path) == audited["sha256"]["trials"]
        return read_trials(path) if kept else None
    except (InputError, KeyError, TypeError, AttributeError, OSError):
        return None


def _read(path: Path) -> dict[str, Any]:
    try:
        audits = read_json(path) if path.exists() else {}
        for found in audits.values():
            if {name: type(value) for name, value in found.items()} != KEPT:
                raise ValueError
            if not all(type(look["trials"]) is int for look in found["looks"]):
                raise ValueError
        return dict(audits)
    except (ValueError, AttributeError, TypeError, KeyError):
        raise InputError(
            f"{path} is damaged, so that earlier looks at this audit cannot be counted; "
            "give another folder with --out, and fresh trials with --seed"
        ) from None
