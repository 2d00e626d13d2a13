from dataclasses import replace
from xml.etree import ElementTree as tree

import pytest

from gaugeblock.reports import junit_xml
from gaugeblock.validate import NotChecked, Outcome, Verdict

# What Ant's JUnit schema demands of each element: its attributes, and the order of its children. Jenkins'
# schema demands less, and allows no other children.
REQUIRED = {
    "testsuites": set(),
    "testsuite": {"name", "package", "id", "timestamp", "hostname", "tests", "failures", "errors", "time"},
    "testcase": {"name", "classname", "time"},
    "property": {"name", "value"},
    "failure": {"type"},
    "error": {"type"},
}
ALLOWED_BESIDE = {
    "testsuite": {"skipped"},
    "failure": {"message"},
    "error": {"message"},
    "skipped": {"type", "message"},
}
CHILDREN = {
    "testsuites": ["testsuite"],
    "testsuite": ["properties", "testcase", "system-out", "system-err"],
    "properties": ["property"],
    "testcase": ["skipped", "error", "failure"],
}


def suite_of(verdict: Verdict, title: str = "An audit") -> tree.Element:
    root = tree.fromstring(junit_xml(verdict, title=title))
    assert root.tag == "testsuites"
    return root[0]


def test_it_has_the_structure_of_ants_and_jenkins_schema(audit):
    root = tree.fromstring(junit_xml(audit.verdict, title="An audit"))
    for element in root.iter():
        assert set(element.attrib) >= REQUIRED.get(element.tag, set()), element.tag
        allowed = REQUIRED.get(element.tag, set()) | ALLOWED_BESIDE.get(element.tag, set())
        assert set(element.attrib) <= allowed, element.tag
        order = CHILDREN.get(element.tag, [])
        places = [order.index(child.tag) for child in element]
        assert places == sorted(places)
    suite = root[0]
    cases = suite.findall("testcase")
    assert all(len(case) <= 1 for case in cases)
    assert int(suite.get("tests", "")) == len(cases)
    for attribute, kind in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        assert int(suite.get(attribute, "")) == len(suite.findall(f"testcase/{kind}"))
    assert suite.get("timestamp") == "2026-01-02T03:04:05"


def test_one_case_per_gate_and_per_check_not_made(audit):
    names = [case.get("name") for case in suite_of(audit.verdict).findall("testcase")]
    gates = [gate.id for gate in audit.verdict.gates]
    rest = [item.id for item in audit.verdict.not_checked if item.id not in gates]
    assert names == gates + rest


def test_each_outcome_has_its_own_kind(failing, undecided):
    for verdict in (failing.verdict, undecided.verdict):
        cases = {case.get("name"): case for case in suite_of(verdict).findall("testcase")}
        for gate in verdict.gates:
            case = cases[gate.id]
            if gate.outcome is Outcome.PASS:
                assert len(case) == 0
                continue
            kind = "failure" if gate.outcome is Outcome.FAIL else "error" if gate.required else "skipped"
            assert [child.tag for child in case] == [kind]
            assert gate.message in case[0].get("message", "")
            if kind != "skipped":
                assert case[0].get("type") == gate.outcome.value
    kinds = {gate.outcome for gate in (*failing.verdict.gates, *undecided.verdict.gates)}
    assert kinds == set(Outcome), "the audits of this test must show every outcome"


def test_the_numbers_are_properties_of_the_suite(passing):
    values = {p.get("name"): p.get("value") for p in suite_of(passing.verdict).findall("properties/property")}
    gate = next(gate for gate in passing.verdict.gates if gate.id == "sbc.bias[alpha]")
    assert float(values["sbc.bias[alpha].statistic"]) == pytest.approx(gate.statistic, rel=1e-5)
    assert float(values["sbc.bias[alpha].interval.low"]) == pytest.approx(gate.interval[0], rel=1e-5)
    assert float(values["sbc.bias[alpha].interval.high"]) == pytest.approx(gate.interval[1], rel=1e-5)
    assert "nan" not in " ".join(value or "" for value in values.values()).lower()


@pytest.mark.parametrize("outcome", [Outcome.INCONCLUSIVE, Outcome.FAIL])
def test_the_file_is_never_green_when_the_verdict_is_not(passing, outcome):
    verdict = replace(passing.verdict, outcome=outcome, not_checked=(NotChecked("tarp.values", "no seed"),))
    suite = suite_of(verdict)
    assert [e.get("type") for e in suite.findall("testcase/error")] == [outcome.value]
    assert suite.get("errors") == "1"


def test_an_optional_undecided_gate_is_skipped_with_its_message(passing):
    gate = replace(
        passing.verdict.gates[0], outcome=Outcome.INCONCLUSIVE, required=False, message="who knows"
    )
    suite = suite_of(replace(passing.verdict, gates=(gate,), not_checked=()))
    (skipped,) = suite.findall("testcase/skipped")
    assert "who knows" in skipped.get("message", "")
    assert not suite.findall("testcase/error")


def test_characters_that_xml_cannot_hold_do_not_break_it(passing):
    gate = replace(
        passing.verdict.gates[0], outcome=Outcome.FAIL, message="bell \x07, null \x00, half \ud800"
    )
    suite = suite_of(replace(passing.verdict, gates=(gate,), not_checked=()), title="\x1b[31m<&\"'")
    assert suite.get("name") == "\ufffd[31m<&\"'"
    (failure,) = suite.findall("testcase/failure")
    assert failure.get("message") == "bell \ufffd, null \ufffd, half \ufffd"


def test_without_a_start_in_provenance_the_time_stamp_is_fixed(passing):
    suite = suite_of(replace(passing.verdict, provenance={}))
    assert suite.get("timestamp") == "1970-01-01T00:00:00"
