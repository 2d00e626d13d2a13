"""Where an audit comes from: what is recorded of simulator, estimator and files, and what it is called."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError, one_line
from gaugeblock.core.foreign import read_json

# Of the folders that audits write; 1 was gaugeblock 0.1.0's, which drew other random numbers.
FORMAT = 2
DIGESTED = ("simulator", "estimator", "policy")
# Of how many trials there are further draws, and likelihoods.
PARTS = ("importance_number", "joint_number")
# What may be otherwise at the next look at an audit: more trials begin with those that there are, and what is
# said of their data decides none of them.
ENLARGED = ("number", "used", "summaries", *PARTS)


def named(choice: object) -> dict[str, Any]:
    """How a simulator or an estimator was asked for: by name and options, or what kind of object it was."""
    if isinstance(choice, str | os.PathLike):
        return {"name": os.fspath(choice)}
    if isinstance(choice, Mapping):
        return {"name": choice["name"], "options": {k: v for k, v in choice.items() if k != "name"}}
    return {"name": getattr(choice, "__name__", type(choice).__name__)}


def title(provenance: Mapping[str, Any]) -> str:
    """What the audit is called: its estimator on its simulator, or the file that the draws came from.

    Once it is called something, it stays so: the order of options, which decides the words, is not kept.
    """
    if isinstance(provenance.get("title"), str):
        return str(provenance["title"])
    estimator, simulator = provenance.get("estimator"), provenance.get("simulator")
    if isinstance(estimator, Mapping) and isinstance(simulator, Mapping):
        return f"{_subject(estimator)} on {_subject(simulator)}"
    trials = provenance.get("trials")
    file = trials.get("file") if isinstance(trials, Mapping) else None
    return f"Draws from {Path(str(file)).name}" if file else "Audit"


def _subject(choice: Mapping[str, Any]) -> str:
    """Name and those options that are words, or the file alone: "xray (epic-pn, medium)", "npe (trained)"."""
    options = dict(choice.get("options") or {})
    words = [value for value in options.values() if isinstance(value, str)]
    if isinstance(options.get("path"), str):
        words = [one_line(Path(options["path"]).name)]
    return f"{choice.get('name', '?')} ({', '.join(words)})" if words else str(choice.get("name", "?"))


def intrinsic(record: Mapping[str, Any]) -> dict[str, Any]:
    """What a thing is, without how it was asked for: the same model has one digest wherever it lies."""
    return {key: value for key, value in record.items() if key not in ("name", "options")}


def settings(trials: Mapping[str, Any]) -> dict[str, Any]:
    """What of an audit's trials decides which truths and draws are made, its seed among it.

    Another one makes another audit of the same estimator: enlarged, an audit keeps all of it.

    >>> settings({"number": 4000, "block": 200, "seed": 1, "joint_number": 1000})
    {'block': 200, 'seed': 1}
    """
    return {key: value for key, value in trials.items() if key not in ENLARGED}


def sizes(trials: Mapping[str, Any]) -> dict[str, Any]:
    """What of an audit's trials makes one look at it: how many, of how many the rest is, which summaries.

    >>> sizes({"number": 4000, "block": 200, "seed": 1, "joint_number": 1000})
    {'trials': 4000, 'joint_number': 1000}
    """
    parts = {name: int(trials[name]) for name in PARTS if name in trials}
    said = {"summaries": digest(trials["summaries"])} if "summaries" in trials else {}
    return {"trials": int(trials.get("used", trials["number"])), **parts, **said}


def digests(record: Mapping[str, Any]) -> dict[str, str]:
    """SHA-256 of what a record says of simulator, estimator and policy, where it does."""
    return {name: digest(intrinsic(record[name])) for name in DIGESTED if name in record}


def finished_audit(folder: Path) -> dict[str, Any]:
    """What verdict.json of the finished audit in a folder holds: its `provenance`, at least.

    Raises
    ------
    InputError
        If there is none.
    """
    path = folder / "verdict.json"
    try:
        content = read_json(path)
        return {**content, "provenance": dict(content["provenance"])}
    except (ValueError, KeyError, TypeError):
        raise InputError(
            f"{path} cannot be read; give the folder of a finished audit, or run `gaugeblock audit` first"
        ) from None
