"""The study of the informed gate, with a few small audits."""

from __future__ import annotations

from studies.informed.__main__ import main, rates
from studies.informed.problems import BLIND, EXACT

from gaugeblock.validate import read_policy


def test_blind_fails_and_exact_does_not():
    """z of an exact posterior beyond 4 is a false alarm of 0.003%."""
    size = {"audits": 2, "trials": 500, "draws": 30, "seed": 1, "policy": read_policy("default")}
    assert rates(BLIND["best channel ignored"], **size).fail == 1
    exact = rates(EXACT["unidentified"], **size)
    assert exact.fail == 0
    assert abs(exact.z) < 4


def test_a_line_for_each_problem_that_is_named(capsys):
    assert main(["40 nuisance", "--audits", "1", "--trials", "60", "--draws", "10"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 1
    assert said[0].startswith("exact  40 nuisance channels")
