"""junit.xml: what a CI server reads; it fits both Ant's and Jenkins' schema.

One test case per gate: FAIL is a failure, INCONCLUSIVE an error of type INCONCLUSIVE, what could not be
checked is skipped. The numbers are properties of the suite (neither schema allows them on a test case).
"""

from __future__ import annotations

import re
from xml.etree import ElementTree as tree

from gaugeblock.reports.reason import reason
from gaugeblock.validate import Gate, NotChecked, Outcome, Verdict

# What XML 1.0 cannot hold, not even escaped.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

# Ant's schema demands a time stamp; a fixed one keeps the bytes the same when the audit says nothing of time.
_NO_TIME = "1970-01-01T00:00:00"


def junit_xml(verdict: Verdict, *, title: str) -> str:
    """The verdict as JUnit XML text."""
    started = re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d", str(verdict.provenance.get("started", "")))
    root = tree.Element("testsuites")
    suite = _child(
        root,
        "testsuite",
        name=title,
        package="gaugeblock",
        id="0",
        timestamp=started.group() if started else _NO_TIME,
        hostname="localhost",
        time="0",
    )
    properties = _child(suite, "properties")
    _child(properties, "property", name="verdict", value=verdict.outcome.value)
    for gate in verdict.gates:
        for name, value in _figures(gate).items():
            _child(properties, "property", name=f"{gate.id}.{name}", value=value)
    cases = [_gate_case(suite, gate) for gate in verdict.gates]
    judged = {gate.id for gate in verdict.gates}
    cases += [_skipped_case(suite, item) for item in verdict.not_checked if item.id not in judged]
    if verdict.outcome is not Outcome.PASS and not any(
        case.find(k) is not None for case in cases for k in _RED
    ):
        # A required check that could not be made must not look green to a server that reads this file alone.
        case = _child(suite, "testcase", classname="gaugeblock", name="verdict", time="0")
        _child(case, "error", type=verdict.outcome.value, message=reason(verdict))
        cases.append(case)
    suite.set("tests", str(len(cases)))
    for attribute, element in (("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
        suite.set(attribute, str(sum(case.find(element) is not None for case in cases)))
    _child(suite, "system-out").text = f"{verdict.outcome.value}: {_legal(reason(verdict))}"
    _child(suite, "system-err")
    tree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tree.tostring(root, encoding="unicode") + "\n"


_RED = ("failure", "error")


def _gate_case(suite: tree.Element, gate: Gate) -> tree.Element:
    case = _child(suite, "testcase", classname=_class(gate.id), name=gate.id, time="0")
    lines = [gate.message] + [f"{name}: {value}" for name, value in _figures(gate).items()]
    text = _legal("\n".join(lines))
    if gate.outcome is Outcome.PASS:
        return case
    if not gate.required and gate.outcome is Outcome.INCONCLUSIVE:
        # It does not decide the verdict: neither red nor silently green.
        skipped = _child(case, "skipped", message=f"{gate.outcome.value}, but not required: {gate.message}")
        skipped.text = text
        return case
    kind = "failure" if gate.outcome is Outcome.FAIL else "error"
    _child(case, kind, type=gate.outcome.value, message=gate.message).text = text
    return case


def _skipped_case(suite: tree.Element, item: NotChecked) -> tree.Element:
    case = _child(suite, "testcase", classname=_class(item.id), name=item.id, time="0")
    _child(case, "skipped", type="NOT_CHECKED", message=item.why)
    return case


def _class(identifier: str) -> str:
    return "gaugeblock." + identifier.split(".", 1)[0].partition("[")[0]


def _figures(gate: Gate) -> dict[str, str]:
    """What the gate's verdict rests on, as text; what is not known is left out."""
    figures = {
        "statistic": gate.statistic,
        "interval.low": gate.interval[0],
        "interval.high": gate.interval[1],
        "tolerance": gate.tolerance,
        "p_value": gate.p_value,
        "smallest_detectable": gate.smallest_detectable,
        "trials": gate.n_trials,
    }
    return {name: f"{value:.6g}" for name, value in figures.items() if value is not None and value == value}


def _child(parent: tree.Element, element: str, /, **attributes: str) -> tree.Element:
    return tree.SubElement(parent, element, {key: _legal(value) for key, value in attributes.items()})


def _legal(text: str) -> str:
    return _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)
