"""What is wrong, where a verdict is not PASS: the diagnosis beside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import xarray as xr

from gaugeblock.auditing.explain import explained
from gaugeblock.auditing.stored import stored_audit
from gaugeblock.diagnosis import diagnose
from gaugeblock.estimators.protocol import untrusted
from gaugeblock.validate import Verdict


def with_diagnosis(verdict: Verdict, trials: xr.DataTree, *, seed: int, estimator: Any = None) -> Verdict:
    """The verdict with what is wrong beside it, whatever it is.

    An estimator that may be called again is; somebody else's in its sandbox is not.
    """
    known = estimator is not None and not untrusted(estimator)
    sample = getattr(estimator, "sample_briefly", estimator.sample) if known else None
    found = diagnose(trials, verdict, seed=seed, sample=sample)
    return explained(replace(verdict, diagnosis=found.to_json()), trials)


def diagnose_folder(folder: Path) -> str:
    """Diagnose a finished audit from its trials, write its reports again, and say what was found.

    Raises
    ------
    InputError
        If the folder does not hold an audit of this version.
    """
    found = stored_audit(folder)
    seed = int(found.verdict.provenance.get("seed") or 0)
    verdict = with_diagnosis(found.verdict, found.trials, seed=seed)
    replace(found, verdict=verdict).write_reports(folder)
    assert verdict.diagnosis is not None
    return str(verdict.diagnosis["text"])


def derived_diagnosis(
    verdict: Verdict, trials: xr.DataTree, stored: Mapping[str, Any] | None, *, seed: int
) -> Verdict:
    """The verdict with the diagnosis that an audit's record should hold.

    One for which the estimator was called again, or faults of a user's were looked for, cannot be derived
    from trials, and stays as it was stored.
    """
    if stored is None:
        return verdict
    if stored.get("called") or stored.get("faults"):
        return explained(replace(verdict, diagnosis=dict(stored)), trials)
    return with_diagnosis(verdict, trials, seed=seed)
