"""model_card.md: a model card with the measured calibration filled in, for hubs of models and their readers.

Markdown with YAML in front, `model-index` in it as hubs read it: one metric per gate that was computed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

from gaugeblock.reports.markdown import code, text
from gaugeblock.reports.reason import reason
from gaugeblock.reports.words import count, decimals_of, interval, number, parameter_of, question, short
from gaugeblock.validate import Gate, Verdict

METRICS = 500
_NAMES = {
    "sbc.bias": "bias in half-widths of 68% intervals",
    "sbc.log_width": "natural log of estimated over true posterior width",
    "coverage.central": "largest gap of central credible intervals' coverage",
    "importance.ess": "median effective sample size after reweighting to the exact posterior, per draw",
}


def model_card(verdict: Verdict, *, title: str) -> str:
    """The card as text; the same verdict gives the same bytes."""
    front = ["---", *_front(verdict, title), "---"]
    return "\n".join([*front, "", *_body(verdict, title)]) + "\n"


def _front(verdict: Verdict, title: str) -> Iterator[str]:
    record = verdict.provenance
    simulator = _table(record.get("simulator"))
    called = str(simulator.get("name") or simulator.get("class") or "simulator")
    library = _table(_table(record.get("estimator")).get("claims")).get("library")
    if isinstance(library, str) and library:
        yield f"library_name: {quoted(library)}"
    yield "tags:"
    yield from (f"- {tag}" for tag in ("simulation-based-inference", "posterior-estimation", "calibration"))
    yield "model-index:"
    yield f"- name: {quoted(title)}"
    yield "  results:"
    yield "  - task:"
    yield "      type: posterior-estimation"
    yield "      name: Posterior estimation"
    yield "    dataset:"
    yield f"      type: {quoted(called)}"
    yield f"      name: {quoted(f'simulations of {called}')}"
    yield "    metrics:"
    yield "    - type: audit.verdict"
    yield "      name: Verdict of the audit"
    yield f"      value: {verdict.outcome.value}"
    for gate in [gate for gate in verdict.gates if math.isfinite(gate.statistic)][:METRICS]:
        yield f"    - type: {quoted(gate.id)}"
        yield f"      name: {quoted(_called(gate))}"
        yield f"      value: {_plain(gate.statistic)}"
        yield "      args:"
        yield f"        interval: [{', '.join(map(_plain, gate.interval))}]"
        yield f"        tolerance: {_plain(gate.tolerance)}"
        yield f"        verdict: {gate.outcome.value}"
        yield f"        trials: {gate.n_trials}"


def _body(verdict: Verdict, title: str) -> Iterator[str]:
    record = verdict.provenance
    plan, digests = _table(record.get("trials")), _table(record.get("sha256"))
    yield f"# {text(title)}"
    yield ""
    yield f"**Calibration: {verdict.outcome.value}.** {text(reason(verdict))}"
    yield ""
    yield "## How it was measured"
    yield ""
    said = plan.get("used", plan.get("number"))
    trials = said if isinstance(said, int) else max((gate.n_trials for gate in verdict.gates), default=0)
    drawn = f" of {plan['draws']:,} draws" if isinstance(plan.get("draws"), int) else ""
    yield (
        f"On {count(trials, 'simulated trial')}{drawn}: truths from the simulator's prior, data from the "
        "simulator, posterior draws from this estimator. Intervals hold simultaneously over all gates, at "
        "the error budget of the policy; a gate passes only where its estimate is within tolerance with "
        "95% confidence."
    )
    yield ""
    yield "## What was measured"
    yield ""
    yield "| | quantity | estimate | interval | tolerance | verdict |"
    yield "|---|---|---:|---|---:|---|"
    for gate in verdict.gates[:METRICS]:
        decimals = decimals_of(gate)
        cells = (
            f"`{code(gate.id)}`",
            text(_called(gate)),
            number(gate.statistic, decimals),
            interval(gate.interval, decimals),
            short(gate.tolerance),
            gate.outcome.value + ("" if gate.required else ", not required"),
        )
        yield f"| {' | '.join(cells)} |"
    if verdict.not_checked:
        yield ""
        yield f"Not checked: {', '.join(f'`{code(item.id)}`' for item in verdict.not_checked[:METRICS])}."
    yield ""
    yield "## Limits"
    yield ""
    yield (
        "This holds for data drawn from this simulator and prior. It says nothing about data that the "
        "simulator does not describe, nor about what the estimator's file may do when it is loaded."
    )
    yield ""
    yield "## Where this comes from"
    yield ""
    yield f"- seed {text(str(record.get('seed')))}"
    for name, value in sorted(digests.items()):
        yield f"- sha256 of {text(str(name))}: `{code(str(value))}`"
    for name, value in sorted(_table(_table(record.get("estimator")).get("sha256")).items()):
        yield f"- sha256 of the estimator's {text(str(name))}: `{code(str(value))}`"
    versions = _table(record.get("versions"))
    if versions:
        yield f"- {text(', '.join(f'{name} {value}' for name, value in sorted(versions.items())))}"


def _called(gate: Gate) -> str:
    """What the metric is, and of which parameter."""
    stem = gate.id.partition("[")[0]
    what, parameter = _NAMES.get(stem) or question(gate, None), parameter_of(gate.id)
    return f"{what}: {parameter}" if parameter else what


def quoted(said: str) -> str:
    r"""A string of YAML, whatever is in it.

    >>> print(quoted('a "b"\n\x1b'))
    "a \"b\"\n\u001b"
    """
    shown = json.dumps(said.encode("utf-8", "replace").decode(), ensure_ascii=False)
    return "".join(
        c if c.isprintable() else f"\\U{ord(c):08x}" if ord(c) > 0xFFFF else f"\\u{ord(c):04x}" for c in shown
    )


def _plain(value: float) -> str:
    """A number of YAML; null for what is none."""
    return json.dumps(float(f"{value:.6g}")) if math.isfinite(value) else "null"


def _table(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}
