"""What docs/peers.md says was measured is what the tests of peers run on."""

from __future__ import annotations

import re
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
STATED = re.search(
    r"Measured on (.+?)\. Each row", (ROOT / "docs" / "peers.md").read_text().replace("\n", " ")
)


def pins(name):
    return dict(re.findall(r"^\s*([a-z-]+)==([\d.]+)$", (ROOT / name).read_text(), re.MULTILINE))


@pytest.mark.parametrize("peer", ["sbi", "tarp", "nestcheck", "bayesflow", "arviz-stats"])
def test_releases_are_those_that_are_pinned(peer):
    assert f"{peer} {pins('constraints.txt')[peer]}" in STATED.group(1)


@pytest.mark.parametrize("peer", ["arviz-plots", "arviz-stats"])
def test_releases_for_python_312_are_those_that_are_pinned(peer):
    assert f"{peer} {pins('tox.ini')[peer]}" in STATED.group(1)


@pytest.mark.parametrize("peer", ["tarp", "nestcheck", "bayesflow"])
def test_releases_are_those_that_are_installed(peer):
    try:
        installed = metadata.version(peer)
    except metadata.PackageNotFoundError:
        pytest.skip(f"needs {peer}: tox -e tests -- tests/peers")
    assert installed == pins("constraints.txt")[peer]
