"""The routes of docs/samples-only.md that start from a package no extra installs."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

DOCUMENTED = Path(__file__).resolve().parents[1] / "auditing" / "trials_from" / "test_documented.py"


@pytest.mark.parametrize(("heading", "package"), [("BayesFlow", "bayesflow"), ("ArviZ", "arviz_base")])
def test_a_documented_route_ends_in_trials(heading, package, peer, tmp_path):
    peer(package)
    specification = importlib.util.spec_from_file_location("documented", DOCUMENTED)
    documented = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(documented)
    documented.run_block(heading, tmp_path)
