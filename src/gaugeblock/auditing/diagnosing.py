"""What is wrong, where a verdict is not PASS: the diagnosis beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import xarray as xr

from gaugeblock.auditing.baseline import compared, kept_baseline
from gaugeblock.auditing.explain import explained
from gaugeblock.auditing.looks import stored_looks
from gaugeblock.auditing.provenance import finished_audit
from gaugeblock.auditing.result import Audit
from gaugeblock.diagnosis import diagnose
from gaugeblock.estimators.protocol import untrusted
from gaugeblock.validate import Verdict, judge, make_policy, read_trials
from gaugeblock.validate.findings_file import read_findings


def with_diagnosis(verdict: Verdict, trials: xr.DataTree, *, seed: int, estimator: Any = None) -> Verdict:
    """The verdict with what is wrong beside it, whatever it is.

    An estimator that may be called again is; somebody else's in its sandbox is not.
    """
    sample = None if estimator is None or untrusted(estimator) else estimator.sample
    return replace(verdict, diagnosis=diagnose(trials, verdict, seed=seed, sample=sample).to_json())


def diagnose_folder(folder: Path) -> str:
    """Diagnose a finished audit from its trials, write its reports again, and say what was found.

    Raises
    ------
    InputError
        If the folder does not hold an audit of this version.
    """
    content = finished_audit(folder)
    record = content["provenance"]
    trials = read_trials(folder / "trials.nc")
    findings, not_checked = read_findings(folder / "findings.nc")
    policy = make_policy(record["policy"], source=f"{folder / 'verdict.json'}: provenance.policy")
    seed = int(record.get("seed") or 0)
    verdict = judge(
        findings, not_checked, policy, seed=int(record.get("judge_seed", seed)), looks=stored_looks(content)
    )
    verdict = explained(replace(verdict, provenance=record), trials)
    earlier = kept_baseline(content)
    if earlier is not None:
        verdict = replace(verdict, baseline=compared(earlier, verdict, findings))
    verdict = with_diagnosis(verdict, trials, seed=seed)
    Audit(trials, findings, not_checked, verdict).write_reports(folder)
    assert verdict.diagnosis is not None
    return str(verdict.diagnosis["text"])


def derived_diagnosis(
    verdict: Verdict, trials: xr.DataTree, stored: Mapping[str, Any] | None, *, seed: int
) -> Verdict:
    """The verdict with the diagnosis that an audit's record should hold.

    One for which the estimator was called again cannot be derived from trials, and stays as it was stored.
    """
    if stored is None:
        return verdict
    if stored.get("called"):
        return replace(verdict, diagnosis=dict(stored))
    return with_diagnosis(verdict, trials, seed=seed)
