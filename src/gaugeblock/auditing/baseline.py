"""An earlier audit to compare with, read from its folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gaugeblock.auditing.provenance import finished_audit
from gaugeblock.core.errors import InputError
from gaugeblock.reports.baseline import against, summary
from gaugeblock.validate import Finding, Verdict, read_findings


def read_baseline(folder: Path) -> dict[str, Any]:
    """What an audit in a folder said, as plain data that `compared` takes.

    Raises
    ------
    InputError
        If the folder holds no finished audit.
    """
    try:
        content = finished_audit(folder)
        gates = [(str(gate["id"]), str(gate["verdict"])) for gate in content["gates"]]
        digests = dict(content["provenance"].get("sha256") or {})
        findings, _ = read_findings(folder / "findings.nc")
        return summary(str(content["verdict"]), gates, findings, digests)
    except InputError as error:
        raise InputError(f"--baseline {folder}: {error}") from None
    except (ValueError, KeyError, TypeError):
        raise InputError(f"--baseline {folder}: verdict.json is not that of a finished audit") from None


def kept_baseline(content: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """What verdict.json keeps of the audit that it was compared with, if it was: taken as it stands.

    Raises
    ------
    InputError
        If what it keeps is none.
    """
    baseline = content.get("baseline")
    if baseline is None:
        return None
    earlier = baseline.get("earlier") if isinstance(baseline, Mapping) else None
    if not isinstance(earlier, Mapping):
        raise InputError("verdict.json: baseline is no comparison with an earlier audit")
    return earlier


def compared(earlier: Mapping[str, Any], verdict: Verdict, findings: Sequence[Finding]) -> dict[str, Any]:
    """The comparison for verdict.json.

    Raises
    ------
    InputError
        If what is kept of the earlier audit is not what `read_baseline` gives.
    """
    try:
        return against(earlier, verdict, findings)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(f"the baseline cannot be compared with ({type(error).__name__}: {error})") from None
