"""An earlier audit to compare with, read from its folder."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

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
    path = folder / "verdict.json"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        gates = [(str(gate["id"]), str(gate["verdict"])) for gate in content["gates"]]
        outcome, digests = str(content["verdict"]), dict(content["provenance"].get("sha256") or {})
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        raise InputError(
            f"--baseline {folder}: {path.name} cannot be read; give the folder of a finished audit"
        ) from None
    try:
        findings, _ = read_findings(folder / "findings.nc")
    except InputError as error:
        raise InputError(f"--baseline {folder}: {error}") from None
    return summary(outcome, gates, findings, digests)


def kept_baseline(folder: Path) -> Mapping[str, Any] | None:
    """What a finished audit keeps of the one that it was compared with, if it was: taken as it stands.

    Raises
    ------
    InputError
        If verdict.json cannot be read, or what it keeps is none.
    """
    path = folder / "verdict.json"
    try:
        baseline = json.loads(path.read_text(encoding="utf-8")).get("baseline")
    except (OSError, ValueError, AttributeError):
        raise InputError(f"{path}: cannot be read; give the folder of a finished audit") from None
    if baseline is None:
        return None
    earlier = baseline.get("earlier") if isinstance(baseline, Mapping) else None
    if not isinstance(earlier, Mapping):
        raise InputError(f"{path.name}: baseline is no comparison with an earlier audit")
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
