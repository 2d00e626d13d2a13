"""From trials to a verdict, written down; and another verdict on findings that are there."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import xarray as xr

from gaugeblock.auditing.baseline import compared, kept_baseline
from gaugeblock.auditing.config import PolicyLike, as_policy
from gaugeblock.auditing.diagnosing import derived_diagnosis, with_diagnosis
from gaugeblock.auditing.explain import explained
from gaugeblock.auditing.identity import versions
from gaugeblock.auditing.looks import stored_looks
from gaugeblock.auditing.provenance import FORMAT, digests, finished_audit, title
from gaugeblock.auditing.result import Audit, write_arrays
from gaugeblock.auditing.trusted import with_densities
from gaugeblock.core.atomic import made_folder
from gaugeblock.core.digest import digest
from gaugeblock.core.progress import Progress
from gaugeblock.diagnosis.diagnosis import Asked
from gaugeblock.reports.machine import plain as plain_data
from gaugeblock.validate import Outcome, Policy, run_validators
from gaugeblock.validate import judge as judged
from gaugeblock.validate.findings_file import read_findings
from gaugeblock.validate.looks import Looks
from gaugeblock.validate.trials import read_trials
from gaugeblock.validate.validators import default_validators


def judge(
    audited: Audit | str | os.PathLike[str],
    policy: PolicyLike = "default",
    *,
    out: str | os.PathLike[str] | None = None,
    seed: int | None = None,
    command: str = "",
) -> Audit:
    """Judge the findings of an audit, or of one in a folder, under another policy; nothing is sampled.

    `seed` is of the bootstrap behind the simultaneous intervals; without it, the earlier audit's. What that
    one was compared with, this one is compared with too. Reports are written into `out`, if there is one.

    Raises
    ------
    InputError
        If the folder does not hold an audit, or the policy cannot be used.
    """
    rules = as_policy(policy)
    if isinstance(audited, Audit):
        trials, findings, not_checked = audited.trials, audited.findings, audited.not_checked
        earlier, kept = dict(audited.verdict.provenance), audited.verdict.baseline
        baseline: Mapping[str, Any] | None = None if kept is None else kept["earlier"]
        looks, known = audited.verdict.looks, audited.verdict.diagnosis
    else:
        folder = Path(audited)
        trials = read_trials(folder / "trials.nc")
        findings, not_checked = read_findings(folder / "findings.nc")
        content = finished_audit(folder)
        earlier, baseline = content["provenance"], kept_baseline(content)
        looks, known = stored_looks(content), content.get("diagnosis")
    chosen = int(earlier.get("seed") or 0) if seed is None else seed
    verdict = judged(findings, not_checked, rules, seed=chosen, looks=looks)
    plain_rules = rules.model_dump(mode="json")
    record = {
        **earlier,
        "command": command,
        "judge_seed": chosen,
        "policy": plain_rules,
        "sha256": {**dict(earlier.get("sha256") or {}), "policy": digest(plain_rules)},
    }
    verdict = explained(replace(verdict, provenance=record), trials)
    if isinstance(audited, Audit) and known is not None and Asked.of(audited.verdict) == Asked.of(verdict):
        # The same trials are asked the same.
        verdict = explained(replace(verdict, diagnosis=known), trials)
    elif known is not None or verdict.outcome is not Outcome.PASS:
        verdict = derived_diagnosis(verdict, trials, known or {}, seed=int(earlier.get("seed") or 0))
    if baseline is not None:
        verdict = replace(verdict, baseline=compared(baseline, verdict, findings))
    result = Audit(trials, findings, not_checked, verdict)
    if out is not None:
        result.write_reports(made_folder(out))
    return result


def judged_and_kept(
    trials: xr.DataTree,
    policy: Policy,
    *,
    seed: int,
    validators: tuple[str, ...] | None,
    provenance: Mapping[str, Any],
    out: Path | None,
    earlier: Mapping[str, Any] | None,
    looks: Looks,
    progress: Progress,
    resources: Mapping[str, Any] = MappingProxyType({}),
    estimator: Any = None,
) -> Audit:
    """What policy and validators say of trials, written to `out` where there is one."""
    progress("validators", 0, 1)
    findings, not_checked = run_validators(trials, seed=seed, select=validators, levels=policy.levels)
    progress("validators", 1, 1)
    verdict = judged(findings, not_checked, policy, seed=seed, looks=looks)
    record = plain_data(
        {
            "ledger": None,
            **provenance,
            "trust": with_densities(provenance.get("trust"), findings),
            "title": title(provenance),
            "format": FORMAT,
            "policy": policy.model_dump(mode="json"),
            "validators": default_validators() if validators is None else list(validators),
            "versions": versions(),
        }
    )
    record["sha256"] = digests(record)
    if out is not None:
        record["sha256"]["trials"] = write_arrays(trials, findings, not_checked, out)
    verdict = explained(replace(verdict, provenance=record), trials)
    if earlier is not None:
        verdict = replace(verdict, baseline=compared(earlier, verdict, findings))
    if verdict.outcome is not Outcome.PASS:
        progress("what is wrong", 0, 1)
        verdict = with_diagnosis(verdict, trials, seed=seed, estimator=estimator)
        progress("what is wrong", 1, 1)
    result = Audit(trials, findings, not_checked, verdict, resources)
    if out is not None:
        result.write_reports(out)
    return result
