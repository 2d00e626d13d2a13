"""Verify: derive an audit's findings, verdict and reports again from its trials, and say what differs.

An edit of any derived file shows, and so does one of trials.nc whose digest in verdict.json was not edited
too. Whoever edits trials.nc can make everything else anew; a signature tells, or a digest kept elsewhere.
"""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import xarray as xr

from gaugeblock.auditing.baseline import compared, kept_baseline
from gaugeblock.auditing.commitment import commitment_differences
from gaugeblock.auditing.compare import (
    NEAR,
    dataset_differences,
    plain_differences,
    shortened,
    text_differences,
)
from gaugeblock.auditing.config import PolicyLike, as_policy
from gaugeblock.auditing.diagnosing import derived_diagnosis
from gaugeblock.auditing.explain import explained
from gaugeblock.auditing.identity import versions
from gaugeblock.auditing.looks import stored_looks
from gaugeblock.auditing.provenance import FORMAT, digests, finished_audit, title
from gaugeblock.auditing.rerun import rerun
from gaugeblock.auditing.statement import statement_differences, vouched
from gaugeblock.auditing.watch import watched
from gaugeblock.core.digest import file_digest
from gaugeblock.core.envelope import public_key
from gaugeblock.core.errors import InputError
from gaugeblock.core.progress import Progress
from gaugeblock.reports import rendered
from gaugeblock.validate import (
    Finding,
    NotChecked,
    Policy,
    Verdict,
    check_validators,
    judge,
    make_policy,
    read_trials,
    run_validators,
    write_findings,
)
from gaugeblock.validate.looks import Looks
from gaugeblock.validate.policy import SHIPPED
from gaugeblock.validate.storage import read_groups
from gaugeblock.validate.trials import main_trials


@dataclass(frozen=True)
class Verification:
    """What differs, one line each; what to know about the comparison; the digest of the trials.

    `outcome` is what trials, policy and seed give; `policy` says in words which one that is.
    """

    differences: tuple[str, ...]
    notes: tuple[str, ...]
    trials_sha256: str
    outcome: str
    policy: str


def verify(
    folder: Path,
    *,
    trials: Path | None = None,
    policy: PolicyLike | None = None,
    trials_sha256: str | None = None,
    estimator_sha256: str | None = None,
    tolerance: float | None = None,
    commitment: Path | None = None,
    text: Path | None = None,
    signer: Path | None = None,
    statement: Path | None = None,
    share: float | None = None,
    allow_modules: Iterable[str] = (),
    progress: Progress | None = None,
) -> Verification:
    """Compare every derived file of an audit with what its trials, policy and seed give.

    `trials` is the Trials file, where it is not in the folder; `policy` the one that the audit should have
    been judged by, whatever its folder says; `trials_sha256` and `estimator_sha256` digests as they were kept
    elsewhere; `commitment` and `text` the files that its seed should be made of; `signer` the public key of
    who should have signed the audit, in a `statement` that may lie elsewhere; `share` that of the draws to
    be asked for again, beside all truths and data (`rerun`, which says what `allow_modules` is); `tolerance`
    the relative difference of numbers to accept: by default none, or where the libraries' versions are not
    those of the audit, 1e-6.

    Raises
    ------
    InputError
        If the trials, verdict.json or a key cannot be read, verdict.json names a policy or validator that is
        none, or the audit is of gaugeblock 0.1.0.
    MissingExtraError
        Without cryptography, where a signer is given.
    """
    source = trials or folder / "trials.nc"
    if not source.exists():
        raise InputError(f"{source}: no such file; give the audit's Trials with --trials FILE.nc")
    owner = None if signer is None else public_key(signer)
    if owner is None and statement is not None:
        raise InputError(f"--statement {statement}: say whose it should be: --signer PUBLIC.pem")
    audited = finished_audit(folder)
    record = audited["provenance"]
    if record.get("format", 1) != FORMAT:
        raise InputError(
            f"{folder}: an audit of gaugeblock 0.1.0, whose random numbers this version cannot draw again; "
            "verify it with gaugeblock 0.1.0, or audit anew"
        )
    found = file_digest(source)
    tree = read_trials(source)
    near, notes = _nearness(record, tolerance)
    looks = stored_looks(audited)
    findings, not_checked, verdict = _derived(
        tree, record, kept_baseline(audited), looks, audited.get("diagnosis")
    )
    contents = rendered(verdict, findings, tree, title=title(record))
    lines = list(_digests(record, found, trials_sha256))
    lines += _expected(record, policy, estimator_sha256)
    told = (*_recorded(record, tree), *commitment_differences(record, commitment=commitment, text=text))
    lines += [f"verdict.json: provenance: {line}" for line in told]
    stored = folder / "findings.nc"
    if looks.trials and looks.trials[-1] != main_trials(tree).sizes["trial"]:
        lines.append(
            f"verdict.json: looks: the last is at {looks.trials[-1]} trials, which is not how many there are"
        )
    # Where the trials were given from elsewhere (gate --out), so may be the findings beside them.
    if stored.exists() or trials is None:
        lines += _prefixed(stored, _finding_differences(stored, findings, not_checked, near))
    for name, content in contents.items():
        lines += _prefixed(folder / name, _file_differences(folder / name, content, near))
    if owner is not None:
        told = tuple(statement_differences(folder, owner, statement=statement, trials=trials))
        lines += shortened(list(told))
        notes = notes if told else (*notes, vouched(owner))
    if share is not None:
        again = rerun(tree, record, share, near=near, allow_modules=allow_modules, progress=progress)
        lines += again.differences
        notes = (*notes, again.said)
    used = make_policy(_table(record, "policy"), source="verdict.json: provenance.policy")
    return Verification(tuple(lines), notes, found, verdict.outcome.value, policy_in_words(used))


def policy_in_words(policy: Policy) -> str:
    """Which policy that is: a shipped one, or how it differs from the default.

    >>> policy_in_words(make_policy({"tolerance": {"bias": 9.0}}, source="mine"))
    "a policy of the audit's own, which differs from the default: tolerance.bias is 9.0, by default 0.1"
    """
    content = policy.model_dump(mode="json")
    for name in SHIPPED:
        if content == as_policy(name).model_dump(mode="json"):
            return f"the {name} policy"
    changed = plain_differences(content, as_policy("default").model_dump(mode="json"), near=0.0)
    said = "; ".join(line.replace("should be", "by default") for line in shortened(list(changed)))
    return f"a policy of the audit's own, which differs from the default: {said}"


def _expected(record: Mapping[str, Any], policy: PolicyLike | None, estimator: str | None) -> Iterator[str]:
    """Whether policy and estimator are those that somebody asks for."""
    if policy is not None:
        wanted = as_policy(policy).model_dump(mode="json")
        for line in plain_differences(_table(record, "policy"), wanted, near=0.0):
            yield f"verdict.json: provenance: policy: {line} in the policy that was asked for"
    stated = _table(record, "sha256").get("estimator")
    kept = None if estimator is None else _digest(estimator, "--estimator-sha256")
    if kept not in (None, stated):
        yield f"verdict.json: sha256.estimator is {stated}, not the {kept} that was kept elsewhere"


def _nearness(record: Mapping[str, Any], tolerance: float | None) -> tuple[float, tuple[str, ...]]:
    """How near numbers must be, and what to say about it."""
    there, here = _table(record, "versions"), versions()
    if there == here:
        near = tolerance or 0.0
        return near, ((f"numbers are compared to {near:g}",) if near else ())
    near = NEAR if tolerance is None else tolerance
    other = [
        f"{name} {there.get(name, 'absent')} there, {here.get(name, 'absent')} here"
        for name in dict.fromkeys([*here, *there])
        if there.get(name) != here.get(name)
    ]
    return near, (f"versions differ ({'; '.join(other)}), so numbers are compared to {near:g} only",)


def _derived(
    tree: xr.DataTree,
    record: Mapping[str, Any],
    earlier: Mapping[str, Any] | None,
    looks: Looks,
    diagnosis: Mapping[str, Any] | None,
) -> tuple[tuple[Finding, ...], tuple[NotChecked, ...], Verdict]:
    """Findings and verdict, from the trials and what the record says of policy, seeds and validators."""
    where = "verdict.json: provenance"
    rules = record.get("policy")
    if not isinstance(rules, Mapping):
        raise InputError(f"{where}.policy is no table; this is not the folder of an audit")
    policy = make_policy(rules, source=f"{where}.policy")
    select = record.get("validators")
    if select is None:  # an audit from before this was recorded
        select = watched(None) if _table(record, "trials").get("anytime") else None
    elif not isinstance(select, list):
        raise InputError(f"{where}.validators is {select!r}; it must be a list of names")
    check_validators(select or ())
    seed = _seed(record, "seed", 0)
    findings, not_checked = run_validators(tree, seed=seed, select=select, levels=policy.levels)
    verdict = judge(findings, not_checked, policy, seed=_seed(record, "judge_seed", seed), looks=looks)
    verdict = explained(replace(verdict, provenance=dict(record)), tree)
    verdict = derived_diagnosis(verdict, tree, diagnosis, seed=seed)
    if earlier is not None:
        verdict = replace(verdict, baseline=compared(earlier, verdict, findings))
    return findings, not_checked, verdict


def _table(record: Mapping[str, Any], name: str) -> dict[str, Any]:
    """A table of the record; an empty one where somebody put something else there."""
    value = record.get(name)
    return dict(value) if isinstance(value, Mapping) else {}


def _seed(record: Mapping[str, Any], name: str, default: int) -> int:
    value = record.get(name, default)
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise InputError(f"verdict.json: provenance.{name} is {value!r}; it must be a whole number")
    return value


def _digests(record: Mapping[str, Any], found: str, kept: str | None) -> Iterator[str]:
    """Whether the trials are those that were audited."""
    stated = _table(record, "sha256").get("trials")
    if stated != found:
        yield f"trials.nc: has sha256 {found}, verdict.json says {stated}"
    if kept is not None:
        wanted = _digest(kept, "--trials-sha256")
        if wanted != found:
            yield f"trials.nc: has sha256 {found}, not the {wanted} that was kept elsewhere"


def _digest(kept: str, option: str) -> str:
    if not re.fullmatch(r"[0-9a-fA-F]{64}", kept.strip()):
        raise InputError(f"{option} {kept}: must be 64 hexadecimal digits, as the audit printed")
    return kept.strip().lower()


def _recorded(record: Mapping[str, Any], tree: xr.DataTree) -> Iterator[str]:
    """What the record says of itself and of the trials, and does not hold."""
    stated = _table(record, "sha256")
    for name, value in digests(record).items():
        if stated.get(name) != value:
            yield f"sha256.{name} is {stated.get(name)}, should be {value}"
    plan, sizes = _table(record, "trials"), main_trials(tree).sizes
    said = {"used" if plan.get("anytime") else "number": "trial", "draws": "draw"}
    for name, axis in said.items():
        if name in plan and plan[name] != sizes[axis]:
            yield f"trials.{name} is {plan[name]}, should be {sizes[axis]}"


def _finding_differences(
    path: Path, findings: Sequence[Finding], not_checked: Sequence[NotChecked], near: float
) -> Iterator[str]:
    try:
        stored = read_groups(path, what="findings")
    except InputError as error:
        yield str(error).removeprefix(f"{path}: ")
        return
    with tempfile.TemporaryDirectory() as temporary:
        # By way of a file, so that both have been through the same conversions.
        derived = read_groups(
            write_findings(findings, not_checked, Path(temporary) / "findings.nc"), what="findings"
        )
    for name in dict.fromkeys([*derived, *stored]):
        called = str((derived if name in derived else stored)[name].attrs.get("id", name or "root"))
        if name not in stored:
            yield f"{called} is missing"
        elif name not in derived:
            yield f"{called} should not be there"
        else:
            inner = shortened(list(dataset_differences(stored[name], derived[name], near=near)))
            yield from (f"{called}: {line}" for line in inner)


def _file_differences(path: Path, derived: bytes, near: float) -> Iterator[str]:
    try:
        stored = path.read_bytes()
    except OSError as error:
        yield f"cannot be read ({error.strerror or error})"
        return
    if stored == derived:
        return
    if path.suffix == ".json":
        lines = list(plain_differences(json.loads(stored), json.loads(derived), near=near))
        yield from lines or ([] if near else ["other bytes, the same content"])
    else:
        yield from text_differences(stored, derived, near=near)


def _prefixed(path: Path, lines: Iterator[str]) -> list[str]:
    return [f"{path.name}: {line}" for line in shortened(list(lines))]
