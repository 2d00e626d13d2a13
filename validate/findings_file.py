"""An audit's findings on disk: a group for each, by its id."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import quote

import xarray as xr

from gaugeblock.core.errors import InputError
from gaugeblock.validate.finding import Finding, NotChecked, finding_from
from gaugeblock.validate.storage import SCHEMA_VERSION, read_groups, schema_version, write_groups

# NetCDF's names have at most 256 bytes.
LONGEST = 200


def group_name(identifier: str) -> str:
    """What the group of a finding is called: its id, with what no name of NetCDF may hold escaped.

    >>> group_name("sbc.bias[a]"), group_name("sbc.bias[a/b]")
    ('sbc.bias[a]', 'sbc.bias[a%2Fb]')
    """
    name = quote(identifier, safe="[]@=,:+")
    tail = hashlib.sha256(name.encode()).hexdigest()[:16]
    return name if len(name) <= LONGEST else f"{name[:LONGEST]}~{tail}"


def write_findings(
    findings: Sequence[Finding], not_checked: Sequence[NotChecked], path: str | os.PathLike[str]
) -> Path:
    """Write findings as NetCDF, atomically; `read_findings` restores them exactly.

    Raises
    ------
    InputError
        If the path cannot be written.
    """
    attributes = {
        "schema_version": SCHEMA_VERSION,
        "not_checked": json.dumps([[item.id, item.why, item.without_data] for item in not_checked]),
        "findings": json.dumps([finding.id for finding in findings]),
    }
    groups = {group_name(finding.id): finding.to_dataset() for finding in findings}
    return write_groups({"": xr.Dataset(attrs=attributes), **groups}, path)


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
        not_checked = tuple(NotChecked(*item) for item in json.loads(root.attrs["not_checked"]))
        names = json.loads(root.attrs["findings"])
        findings = tuple(finding_from(groups[group_name(name)]) for name in names)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: holds no findings of gaugeblock ({type(error).__name__}: {error})"
        ) from None
    return findings, not_checked
