"""A ledger: one file in which every audit of a project is entered before its first trial is drawn.

Whoever trains until an audit passes has looked as often as there were trainings. The ledger counts them, of
one simulator under one policy; tells truths that were used before; and draws the seeds of release audits,
which no training was chosen by. Whatever decides which trials are made stands in it: other ones are another
audit. It is written whole, by one process at a time, and never where it is damaged.
"""

from __future__ import annotations

import fcntl
import json
import secrets
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gaugeblock.auditing.identity import lasting
from gaugeblock.auditing.kept_seed import BITS
from gaugeblock.auditing.provenance import digests, settings, sizes, title
from gaugeblock.core.atomic import write_atomically
from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import RECORD, read_bytes
from gaugeblock.reports.machine import plain
from gaugeblock.validate.policy import Policy

FORMAT = 2
KEYS = {
    **{"title": str, "simulator": str, "policy": str, "estimator": str},
    **{"seed": int, "trials": dict, "release": bool, "looks": list},
}
# Seconds: an audit holds the lock only while it reads and writes this small file.
PATIENCE = 30.0

Line = dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Entry:
    """An audit as its ledger knows it: its seed, this look's `sizes`, for provenance what came before it."""

    path: Path
    line: Mapping[str, Any]
    at: Mapping[str, int]
    record: Mapping[str, Any]

    @property
    def looked_at(self) -> list[dict[str, int]]:
        """Sizes at each look at this audit so far, this one's among them."""
        return _sizes(self.line["looks"])

    @property
    def seed(self) -> int:
        """The seed to draw the trials with."""
        return int(self.line["seed"])

    def ended(self, outcome: str) -> None:
        """Enter what came of it.

        Raises
        ------
        InputError
            If the ledger is damaged, lacks this audit, or cannot be written.
        """
        with _locked(self.path):
            lines = _read(self.path)
            mine = next((line for line in lines if _same(line, self.line)), None)
            if mine is None:
                raise InputError(f"{self.path}: the audit that just ended is no longer in the ledger")
            look = {**self.at, "outcome": outcome}
            mine["looks"] = [one for one in mine["looks"] if one != {**look, "outcome": None}]
            if look not in mine["looks"]:
                mine["looks"].append(look)
            _write(self.path, lines)


def check_ledger(path: Path) -> None:
    """Read the ledger, where there is one, before anything else is done.

    Raises
    ------
    InputError
        If it is damaged, or its folder is not there.
    """
    _read(path)
    if not path.parent.is_dir():
        raise InputError(f"{path}: the folder of the ledger is not there; make it first")


def entered(
    path: Path,
    provenance: Mapping[str, Any],
    policy: Policy,
    *,
    release: bool,
) -> Entry:
    """Enter an audit that is about to begin; the same estimator on the same trials is the same audit again.

    `provenance` says what simulator and estimator are, and how the `trials` are made. A `release` gets a seed
    of the operating system's entropy that the ledger has not seen, once for an estimator on a simulator:
    interrupted, enlarged or judged by another policy, it goes on with the truths that it has.

    Raises
    ------
    InputError
        If the ledger is damaged, locked, or cannot be written; or an estimator is to be released that cannot
        be told from another, or whose release audit was begun on other trials.
    """
    record = plain({**provenance, "policy": policy.model_dump(mode="json")})
    made = settings(record["trials"])
    own: Line = {"title": title(record), **digests(record), "release": release}
    own |= {"seed": made.pop("seed"), "trials": made}
    at = sizes(record["trials"])
    if not lasting(record["estimator"]):
        if release:
            raise InputError(
                "the estimator's state cannot be told from another's, so nobody could say that it was the "
                "final one; give a file, a model folder or an object that can be pickled"
            )
        # Another one every time: two networks must not be counted as one.
        own["estimator"] += f"-{secrets.token_hex(8)}"
    with _locked(path):
        lines = _read(path)
        kin = [line for line in lines if line["simulator"] == own["simulator"]]
        if release:
            own["seed"] = _release_seed(path, own, kin, lines)
        mine = next((line for line in lines if _same(line, own)), None)
        if mine is None:
            mine = {**own, "looks": []}
            lines.append(mine)
        if at not in _sizes(mine["looks"]):
            mine["looks"].append({**at, "outcome": None})
        _write(path, lines)
    return Entry(path=path, line=mine, at=at, record=_record(mine, lines))


def _release_seed(path: Path, own: Line, kin: list[Line], lines: list[Line]) -> int:
    """The seed of this estimator's release audit: the one that was drawn already, or a new one."""
    for line in kin:
        if line["release"] and line["estimator"] == own["estimator"]:
            _refuse_others(path, line["trials"], own["trials"])
            return int(line["seed"])
    seen = {line["seed"] for line in lines}
    while (seed := secrets.randbits(BITS)) in seen:
        pass
    return seed


def _refuse_others(path: Path, begun: Mapping[str, Any], asked: Mapping[str, Any]) -> None:
    """Trials made otherwise would be fresh truths for an estimator that was released already."""
    other = [
        f"{name} {begun.get(name, 'not set')} there, {asked.get(name, 'not set')} here"
        for name in {**begun, **asked}
        if begun.get(name) != asked.get(name)
    ]
    if other:
        raise InputError(
            f"{path}: the release audit of this estimator was begun on trials made otherwise "
            f"({', '.join(other)}); go on with those, other ones would be another chance to pass"
        )


def _record(mine: Line, lines: list[Line]) -> dict[str, Any]:
    """What came before an audit, for provenance: it stays as it is, however many come after."""
    kin = [line for line in lines if line["simulator"] == mine["simulator"]]
    earlier = kin[: kin.index(mine)]
    before = [line for line in earlier if line["policy"] == mine["policy"]]
    others = [line for line in earlier if line["policy"] != mine["policy"]]
    # Of the truths, whatever the policy was: until this estimator first met them.
    judged = []
    for line in kin:
        if _truths(line) == _truths(mine):
            if line["estimator"] == mine["estimator"]:
                break
            judged.append(line["estimator"])
    return {
        "earlier": len(before),
        "estimators": len({line["estimator"] for line in before}),
        "release": mine["release"],
        "releases": sum(line["release"] for line in before),
        "same_truths": len(set(judged)),
        "policy": mine["policy"],
        "other_policies": len(others),
        "same_truths_other_policies": sum(_truths(line) == _truths(mine) for line in others),
    }


def _sizes(looks: list[Line]) -> list[dict[str, int]]:
    return [{name: value for name, value in look.items() if name != "outcome"} for look in looks]


def _truths(line: Line) -> tuple[int, Any]:
    """What decides the truths, of one simulator: draws, however many, are of the same ones."""
    return line["seed"], line["trials"].get("block")


def _same(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    return all(one[name] == other[name] for name in set(KEYS) - {"title", "looks"})


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Alone with the ledger, by a lock on a file beside it: the ledger itself is replaced when written."""
    beside = path.with_name(f".{path.name}.lock")
    try:
        with beside.open("a") as handle:
            until = time.monotonic() + PATIENCE
            while True:
                try:
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                except BlockingIOError:
                    if time.monotonic() > until:
                        raise InputError(
                            f"{path}: the ledger is locked by another audit, {beside} for {PATIENCE:.0f} s; "
                            "run the same command again when that has ended"
                        ) from None
                    time.sleep(0.05)
            yield
    except OSError as error:
        raise InputError(f"{path}: the ledger cannot be locked ({error.strerror or error})") from None


def _write(path: Path, lines: list[Line]) -> None:
    content = {"format": FORMAT, "audits": lines}
    write_atomically(path, json.dumps(content, indent=2, ensure_ascii=False) + "\n")


def _read(path: Path) -> list[Line]:
    """The audits in order; none where there is no file yet."""
    content: Any = None
    try:
        text = read_bytes(path, most=RECORD) if path.exists() else None
        content = {"format": FORMAT, "audits": []} if text is None else json.loads(text)
    except (json.JSONDecodeError, UnicodeDecodeError, RecursionError):
        pass
    if not _intact(content):
        raise InputError(
            f"{path}: the ledger is damaged, or no ledger; restore it from a copy: audits that are "
            "forgotten would not be counted"
        )
    return list(content["audits"])


def _intact(content: Any) -> bool:
    if not isinstance(content, dict) or set(content) != {"format", "audits"} or content["format"] != FORMAT:
        return False
    lines = content["audits"]
    return isinstance(lines, list) and all(
        isinstance(line, dict)
        and {name: type(value) for name, value in line.items()} == KEYS
        and all(isinstance(look, dict) and {"trials", "outcome"} <= set(look) for look in line["looks"])
        for line in lines
    )
