"""The route of docs/samples-only.md that starts from a package no extra installs."""

from __future__ import annotations

import importlib.util
from pathlib import Path

DOCUMENTED = Path(__file__).resolve().parents[1] / "auditing" / "trials_from" / "test_documented.py"


def test_a_documented_route_ends_in_trials(peer, tmp_path):
    peer("arviz_base")
    specification = importlib.util.spec_from_file_location("documented", DOCUMENTED)
    documented = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(documented)
    documented.run_block("ArviZ", tmp_path)
