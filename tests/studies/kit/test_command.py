"""What a study's cases are drawn from, and what is kept beside its tables."""

from __future__ import annotations

import argparse
import subprocess

import pytest
from studies.kit.command import seeded
from studies.kit.commit import ROOT, seed_of


@pytest.mark.parametrize(("given", "kept"), [(None, None), (5, "5"), (0, "0")])
def test_cases_are_drawn_from_the_commit_unless_a_seed_is_given(given, kept):
    chosen = argparse.Namespace(commit="HEAD", generator_seed=given, seed=3)
    head = subprocess.check_output(["git", "rev-parse", "HEAD"], cwd=ROOT, text=True).strip()
    seed, attributes = seeded("gain-sweep", chosen, "python -m studies gain-sweep")
    assert seed == (seed_of("gain-sweep", head) if given is None else given)
    assert attributes["generator_seed"] == (kept or str(seed))
    assert (attributes["commit"], attributes["seed"]) == (head, 3)
    assert attributes["command"] == "python -m studies gain-sweep"
    assert "numpy" in attributes["versions"]
