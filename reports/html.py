"""report.html: one page that a person reads, with nothing to load from anywhere."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import xarray as xr

from gaugeblock.reports.answers import answers
from gaugeblock.reports.baseline import comparison
from gaugeblock.reports.contents import contained, contents
from gaugeblock.reports.controls import controls_sections
from gaugeblock.reports.figures import sections
from gaugeblock.reports.machine import plain
from gaugeblock.reports.mended import before_and_after
from gaugeblock.reports.page import render
from gaugeblock.reports.reason import reason
from gaugeblock.reports.rows import GateGroup, gate_groups, reported_groups, with_outcome
from gaugeblock.reports.words import count
from gaugeblock.reports.worst import in_worst_regions, largest_errors, lowest_shares, trial_errors
from gaugeblock.validate import Finding, Outcome, Verdict
from gaugeblock.validate.trials import importance_trials, main_trials

_HEADLINES = {
    Outcome.PASS: "The estimator is calibrated within the tolerances.",
    Outcome.FAIL: "The estimator is out of tolerance.",
    Outcome.INCONCLUSIVE: "The audit could not decide.",
}


# More parameters than these are not picked one by one.
PICKED = 40


def report_html(verdict: Verdict, findings: Sequence[Finding], trials: xr.DataTree, *, title: str) -> str:
    """The whole page as text; what the findings and trials do not hold leaves no trace on it."""
    main, importance = main_trials(trials), importance_trials(trials)
    errors = trial_errors(trials)
    share = next((finding for finding in findings if finding.id == "importance.ess"), None)
    weighed_on = main if importance is None else importance
    worst = [
        largest_errors(errors) if errors is not None else None,
        lowest_shares(share, weighed_on),
        *(in_worst_regions(errors, findings) if errors is not None else []),
    ]
    tables = [table for table in worst if table is not None]
    anchors = {f"#{table.anchor}" for table in tables}
    made = [*controls_sections(verdict), *sections(verdict, findings, errors)]
    groups = gate_groups(verdict, findings, drawn=True)
    parameters = [str(name) for name in main["parameter"].values]
    return render(
        "report.html",
        **_card(verdict, findings, trials, title, groups),
        failing=with_outcome(groups, Outcome.FAIL),
        undecided=with_outcome(groups, Outcome.INCONCLUSIVE),
        passing=with_outcome(groups, Outcome.PASS),
        suggestions=verdict.suggestions,
        baseline=[] if verdict.baseline is None else comparison(verdict.baseline),
        contents=contents(verdict.provenance.get("listing")),
        contained=contained(verdict.provenance.get("confinement")),
        not_checked=by_reason(verdict),
        reported=reported_groups(verdict, findings),
        sections=made,
        parameters=parameters if 1 < len(parameters) <= PICKED else [],
        anchors=anchors,
        worst=tables,
        picture=before_and_after(verdict, trials),
        provenance=_in_order(plain(verdict.provenance)),
    )


def card_html(verdict: Verdict, findings: Sequence[Finding], trials: xr.DataTree, *, title: str) -> str:
    """The top of the page, verdict and gates, for the output of a notebook's cell."""
    groups = gate_groups(verdict, findings)
    return render("notebook.html", picture=None, **_card(verdict, findings, trials, title, groups))


def _card(
    verdict: Verdict,
    findings: Sequence[Finding],
    trials: xr.DataTree,
    title: str,
    groups: Sequence[GateGroup],
) -> dict[str, Any]:
    return {
        "title": title,
        "outcome": verdict.outcome.value,
        "headline": _HEADLINES[verdict.outcome],
        "reason": reason(verdict),
        "answers": answers(verdict, findings),
        "facts": facts(trials),
        "groups": groups,
        "tally": tally(verdict),
    }


def by_reason(verdict: Verdict) -> list[tuple[str, list[str]]]:
    """What was not checked, by why: many checks lack the same."""
    found: dict[str, list[str]] = {}
    for item in verdict.not_checked:
        found.setdefault(item.why, []).append(item.id)
    return list(found.items())


# What a person looks for first; verdict.json, from which the page can be made again, keeps no order.
_FIRST = ("title", "command", "seed", "simulator", "estimator", "trials", "observation", "policy")


def _in_order(provenance: dict[str, Any]) -> dict[str, Any]:
    first = {name: provenance[name] for name in _FIRST if name in provenance}
    return {name: _sorted(value) for name, value in (first | _sorted(provenance)).items()}


def _sorted(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _sorted(value[name]) for name in sorted(value)}
    return [_sorted(item) for item in value] if isinstance(value, list) else value


def facts(trials: xr.DataTree) -> list[str]:
    """How much was looked at: trials, draws, parameters."""
    main, importance = main_trials(trials), importance_trials(trials)
    said = [
        count(main.sizes["trial"], "trial"),
        f"{count(main.sizes['draw'], 'draw')} each",
        count(main.sizes["parameter"], "parameter"),
    ]
    if importance is not None:
        said.append(
            f"importance on {count(importance.sizes['trial'], 'trial')} of {importance.sizes['draw']:,} draws"
        )
    return said


def tally(verdict: Verdict) -> str:
    """How many gates said what: `14 passed, 2 failed`."""
    amounts = {outcome: sum(gate.outcome is outcome for gate in verdict.gates) for outcome in Outcome}
    words = {Outcome.PASS: "passed", Outcome.FAIL: "failed", Outcome.INCONCLUSIVE: "undecided"}
    said = [f"{amount:,} {words[outcome]}" for outcome, amount in amounts.items() if amount]
    if verdict.not_checked:
        said.append(f"{len(verdict.not_checked):,} not checked")
    return ", ".join(said)
