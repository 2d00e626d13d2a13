"""An audit's findings as one tree, in memory and on disk."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path

import xarray as xr

from gaugeblock.core.errors import InputError
from gaugeblock.validate.finding import Finding, NotChecked
from gaugeblock.validate.storage import SCHEMA_VERSION, read_groups, schema_version, write_groups


def _groups(findings: Sequence[Finding], not_checked: Sequence[NotChecked]) -> dict[str, xr.Dataset]:
    # Ids hold dots and brackets, which group names should not: groups are numbered, attributes hold the ids.
    attributes = {
        "schema_version": SCHEMA_VERSION,
        "not_checked": json.dumps([[item.id, item.why] for item in not_checked]),
        "findings": json.dumps([finding.id for finding in findings]),
    }
    root = {"": xr.Dataset(attrs=attributes)}
    return root | {f"finding_{number:04d}": finding.to_dataset() for number, finding in enumerate(findings)}


def findings_tree(findings: Sequence[Finding], not_checked: Sequence[NotChecked]) -> xr.DataTree:
    """All findings as one DataTree: a child per finding, its id among the attributes."""
    groups = _groups(findings, not_checked)
    return xr.DataTree.from_dict({f"/{name}": dataset for name, dataset in groups.items()})


def write_findings(
    findings: Sequence[Finding], not_checked: Sequence[NotChecked], path: str | os.PathLike[str]
) -> Path:
    """Write findings as NetCDF, atomically; `read_findings` restores them exactly.

    Raises
    ------
    InputError
        If the path cannot be written.
    """
    return write_groups(_groups(findings, not_checked), path)


def read_findings(path: str | os.PathLike[str]) -> tuple[tuple[Finding, ...], tuple[NotChecked, ...]]:
    """Findings and what was not checked, from a file that `write_findings` wrote.

    Raises
    ------
    InputError
        If the file is missing, damaged, of a newer schema, or holds no findings.
    """
    groups = read_groups(path, what="findings")
    root = groups[""]
    schema_version(root, source=str(path))
    try:
        not_checked = tuple(NotChecked(name, why) for name, why in json.loads(root.attrs["not_checked"]))
        names = sorted(name for name in groups if name.startswith("finding_"))
        findings = tuple(Finding.from_dataset(groups[name]) for name in names)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: holds no findings of gaugeblock ({type(error).__name__}: {error})"
        ) from None
    return findings, not_checked
