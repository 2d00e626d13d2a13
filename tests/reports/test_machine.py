import json

import numpy as np

from gaugeblock.reports import verdict_json
from gaugeblock.reports.machine import plain

GATE_KEYS = {
    "id", "verdict", "statistic", "interval", "tolerance", "p_value", "p_adjusted", "n_trials",
    "smallest_detectable", "message",
}  # fmt: skip


def refuse(constant: str) -> None:
    raise AssertionError(f"{constant} is not JSON")


def test_it_is_strict_json_with_the_contract_s_keys(audit):
    content = json.loads(verdict_json(audit.verdict, audit.findings), parse_constant=refuse)
    assert content["verdict"] == audit.verdict.outcome.value
    assert set(content) == {
        *("verdict", "gates", "not_checked", "provenance", "reported"),
        *("suggestions", "baseline", "diagnosis", "controls", "looks", "schema_version"),
    }
    keys = {"kind", "parameter", "size", "unit", "caught", "text", "power", "tolerance", "rungs"}
    assert all(set(control) == keys for control in content["controls"])
    assert [gate["id"] for gate in content["gates"]] == [gate.id for gate in audit.verdict.gates]
    assert all(set(gate) >= GATE_KEYS and len(gate["interval"]) == 2 for gate in content["gates"])
    assert all(set(item) == {"id", "why"} for item in content["not_checked"])
    assert content["provenance"]["not a number"] is None


def test_a_check_that_could_not_be_made_is_null_not_nan(undecided):
    content = json.loads(verdict_json(undecided.verdict, undecided.findings), parse_constant=refuse)
    missing = next(gate for gate in content["gates"] if gate["id"] == "importance.ess")
    assert missing["statistic"] is None
    assert missing["interval"] == [None, None]


def test_reported_lists_exactly_the_findings_that_no_gate_judges(passing):
    content = json.loads(verdict_json(passing.verdict, passing.findings))
    reported = {item["id"]: item for item in content["reported"]}
    judged = {gate.id for gate in passing.verdict.gates}
    of_controls = {finding.id for finding in passing.findings if finding.validator == "controls"}
    assert of_controls
    assert set(reported) == {finding.id for finding in passing.findings} - judged - of_controls
    uniform = next(finding for finding in passing.findings if finding.id == "sbc.uniform[alpha]")
    assert reported["sbc.uniform[alpha]"]["p_value"] == uniform.p_value
    assert reported["sbc.uniform[alpha]"]["estimate"] == uniform.estimate.tolist()
    assert reported["sbc.uniform[alpha]"]["claim"] == uniform.claim


def test_numbers_survive_the_round_trip_exactly(passing):
    content = json.loads(verdict_json(passing.verdict, passing.findings))
    statistics = [gate["statistic"] for gate in content["gates"]]
    assert statistics == [gate.statistic for gate in passing.verdict.gates]


def test_plain_knows_what_people_put_into_provenance(tmp_path):
    value = {"path": tmp_path, "array": np.array([1.0, np.inf]), "flag": np.True_, "set": {2, 1}, 3: ("a",)}
    assert plain(value) == {
        "path": str(tmp_path), "array": [1.0, None], "flag": True, "set": [1, 2], "3": ["a"],
    }  # fmt: skip
