"""The model card: what a reader of YAML finds in it; whatever a stranger put there is only text."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from gaugeblock.reports import rendered, write_reports
from gaugeblock.reports.card import model_card, quoted

yaml = pytest.importorskip("yaml")

RECORD = {
    "seed": 5,
    "simulator": {"name": "xray", "options": {"level": "medium"}},
    "estimator": {"name": "stranger", "claims": {"library": "sbi"}, "sha256": {"model": "cd" * 32}},
    "trials": {"number": 3000, "draws": 100},
    "sha256": {"trials": "ab" * 32},
    "versions": {"numpy": "2.2"},
}


def parts(card: str) -> tuple[dict, str]:
    _, front, body = card.split("---\n", 2)
    return yaml.safe_load(front), body


def test_every_computed_gate_is_a_metric_with_its_interval(audit):
    verdict = replace(audit.verdict, provenance=RECORD)
    front, body = parts(model_card(verdict, title="A stranger on xray"))
    (entry,) = front["model-index"]
    (result,) = entry["results"]
    assert front["library_name"] == "sbi"
    assert entry["name"] == "A stranger on xray"
    assert result["dataset"] == {"type": "xray", "name": "simulations of xray"}
    metrics = {item["type"]: item for item in result["metrics"]}
    assert metrics["audit.verdict"]["value"] == verdict.outcome.value
    computed = {gate.id: gate for gate in verdict.gates if gate.statistic == gate.statistic}
    assert set(metrics) == {"audit.verdict", *computed}
    for name, gate in computed.items():
        assert metrics[name]["value"] == pytest.approx(gate.statistic, rel=1e-5)
        assert metrics[name]["args"]["verdict"] == gate.outcome.value
        assert metrics[name]["args"]["trials"] == gate.n_trials
        for bound, stated in zip(gate.interval, metrics[name]["args"]["interval"], strict=True):
            assert stated == (pytest.approx(bound, rel=1e-5) if abs(bound) < float("inf") else None)
    assert f"**Calibration: {verdict.outcome.value}.**" in body
    assert "ab" * 32 in body
    assert "cd" * 32 in body
    assert "On 3,000 simulated trials of 100 draws: " in body


def test_bias_width_coverage_and_efficiency_are_named(passing):
    front, _ = parts(model_card(replace(passing.verdict, provenance=RECORD), title="t"))
    names = {item["type"]: item["name"] for item in front["model-index"][0]["results"][0]["metrics"]}
    assert names["sbc.bias[alpha]"] == "bias in half-widths of 68% intervals: alpha"
    assert names["sbc.log_width[beta]"].endswith("posterior width: beta")
    assert {"coverage.central", "importance.ess"} <= set(names)


def test_hostile_names_stay_text(failing):
    evil = "x\n---\nlibrary_name: evil\n\x1b[31m<script>\ud800"
    record = {**RECORD, "simulator": {"name": evil}, "estimator": {"claims": {"library": evil}}}
    front, body = parts(model_card(replace(failing.verdict, provenance=record), title=evil))
    assert front["library_name"].startswith("x\n---\nlibrary_name: evil")
    # Within backticks nothing is HTML.
    assert "<script>" in body
    assert "<script>" not in re.sub(r"`[^`]*`", "", body.replace("\\`", ""))


def test_what_is_quoted_is_what_yaml_reads():
    for said in ("plain", 'a "b" \\', "tab\t\x00\x7f\x85\u2028é", "emoji 🙂 \U000e0001", "no: - [x]", ""):
        assert yaml.safe_load(quoted(said)) == said


def test_only_an_estimator_has_a_card(passing, tmp_path: Path):
    assert "model_card.md" not in rendered(passing.verdict, passing.findings, passing.trials)
    verdict = replace(passing.verdict, provenance=RECORD)
    write_reports(verdict, passing.findings, passing.trials, tmp_path)
    assert (tmp_path / "model_card.md").read_text().startswith("---\nlibrary_name")
