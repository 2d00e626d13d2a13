"""What an audit found, to look at: in a terminal or a notebook, as a table, as pictures, as files."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from gaugeblock.auditing.looks import enter_saved
from gaugeblock.auditing.provenance import title
from gaugeblock.auditing.trials_from import to_arviz
from gaugeblock.core.atomic import discard_unfinished, made_folder, write_atomically
from gaugeblock.core.digest import file_digest
from gaugeblock.core.errors import InputError, one_line
from gaugeblock.core.values import Value
from gaugeblock.reports.html import card_html, facts
from gaugeblock.reports.terminal import verdict_lines
from gaugeblock.reports.write import write_reports
from gaugeblock.validate import Finding, Gate, NotChecked, Outcome, Verdict, write_findings, write_trials
from gaugeblock.validate.verdict import Control

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from gaugeblock.diagnosis import Diagnosis, Fault

RESOURCES = "resources.json"
# Gates, and letters of one line, in what a terminal shows.
SHOWN, LONGEST = 8, 160
COLUMNS = (
    *("verdict", "component", "statistic", "low", "high", "pass_low", "pass_high", "tolerance"),
    *("p_value", "p_adjusted", "n_trials", "smallest_detectable", "trials_to_settle", "required", "message"),
)
NUMBERS = ("p_value", "p_adjusted", "smallest_detectable", "trials_to_settle")


class UnknownGateError(InputError, KeyError):
    """No gate has this id; the message lists those that are nearly it."""

    # KeyError's own would show the message in quotes.
    __str__ = Exception.__str__


class Gates(Mapping[str, Gate]):
    """Gates by id, in the verdict's order; iterating gives ids, as with a dict."""

    def __init__(self, verdict: Verdict):
        self._gates = {gate.id: gate for gate in verdict.gates}

    def __getitem__(self, identifier: str) -> Gate:
        if identifier not in self._gates:
            raise UnknownGateError(f"no gate {identifier!r}; {_near(identifier, list(self._gates))}")
        return self._gates[identifier]

    def __iter__(self) -> Iterator[str]:
        return iter(self._gates)

    def __len__(self) -> int:
        return len(self._gates)

    def __repr__(self) -> str:
        shown = [
            f"  {gate.outcome:<12} {one_line(gate.id, most=60)}"
            for gate in list(self._gates.values())[:SHOWN]
        ]
        return "\n".join([f"<{len(self)} gates>", *shown, *["  ..."] * (len(self) > SHOWN)])


@dataclass(frozen=True, repr=False, eq=False)
class Audit(Value):
    """Everything an audit found: the trials, the findings, what could not be checked, and the verdict.

    ``result["sbc.bias[a]"]`` is one gate. `resources` are what an estimator of somebody else's used, where
    that was watched.
    """

    trials: xr.DataTree
    findings: tuple[Finding, ...]
    not_checked: tuple[NotChecked, ...]
    verdict: Verdict
    resources: Mapping[str, Any] = field(default_factory=dict)

    @property
    def outcome(self) -> Outcome:
        """ "PASS", "FAIL" or "INCONCLUSIVE": an enum of strings."""
        return self.verdict.outcome

    @property
    def passed(self) -> bool:
        """Whether the outcome is PASS."""
        return self.outcome is Outcome.PASS

    @property
    def gates(self) -> Gates:
        """Gates by id, in order: a mapping."""
        return Gates(self.verdict)

    @property
    def controls(self) -> tuple[Control, ...]:
        """The smallest faults that this audit would have caught, measured on its own draws."""
        return self.verdict.controls

    def __getitem__(self, identifier: str) -> Gate:
        return self.gates[identifier]

    def __contains__(self, identifier: object) -> bool:
        return identifier in self.gates

    def __iter__(self) -> Iterator[str]:
        return iter(self.gates)

    def __len__(self) -> int:
        return len(self.verdict.gates)

    def __bool__(self) -> bool:
        # Neither "has gates" nor "passed" is what everybody would read into it.
        raise InputError(
            'an audit is neither true nor false: ask for result.passed, or result.outcome == "FAIL"'
        )

    def to_frame(self, *, findings: bool = False) -> pd.DataFrame:
        """One row a gate, by its id: verdict, numbers and message; NaN where a number is not known.

        With `findings`, one row a component of everything that was measured, judged or not: estimate,
        standard error, p-value, and what they are of.
        """
        import pandas as pd

        if findings:
            return pd.DataFrame(
                [
                    {
                        "id": finding.id, "component": name, "estimate": estimate, "standard_error": error,
                        "p_value": finding.p_value, "n_trials": finding.n_trials,
                        "quantity": finding.quantity, "judged": finding.id in self.gates,
                        "claim": finding.claim, "null": finding.null,
                    }
                    for finding in self.findings
                    for name, estimate, error in zip(
                        finding.components, finding.estimate, finding.standard_error, strict=True
                    )
                ]
            ).set_index("id")  # fmt: skip
        gates = self.verdict.gates
        index = pd.Index([gate.id for gate in gates], name="id", dtype=object)
        rows = [
            {
                **vars(gate), "verdict": str(gate.outcome),
                "low": gate.interval[0], "high": gate.interval[1],
                "pass_low": gate.pass_interval[0], "pass_high": gate.pass_interval[1],
            }
            for gate in gates
        ]  # fmt: skip
        frame = pd.DataFrame(rows, index=index, columns=list(COLUMNS))
        return frame.astype(dict.fromkeys(NUMBERS, float))

    def to_arviz(self, *, trial: int | None = None) -> xr.DataTree:
        """The trials in ArviZ's groups, on which its own functions work; see `trials_from.to_arviz`."""
        return to_arviz(self.trials, trial=trial)

    def plot(self, identifier: str, *, ax: Axes | None = None, trial: int | None = None) -> Axes:
        """The picture behind a gate, or behind a finding that no gate judges, drawn on `ax` or on new axes.

        Of the trials themselves: ``recovery[a]``, ``contraction[a]`` (against z-score), and ``pairs[a, b]``
        of one `trial`.

        Raises
        ------
        InputError
            If there is nothing of this id, or nothing of it to draw.
        MissingExtraError
            Without matplotlib.
        """
        from gaugeblock.reports.axes import draw, draw_points
        from gaugeblock.reports.trial_pictures import trial_picture, trial_picture_ids

        of_trials = trial_picture_ids(self.trials)
        if identifier in of_trials:
            return draw_points(trial_picture(identifier, self.trials, trial=trial), ax=ax)
        finding = next((item for item in self.findings if item.id == identifier), None)
        gate = self.gates.get(identifier)
        if gate is None and finding is None:
            known = dict.fromkeys([*self.gates, *(item.id for item in self.findings), *of_trials])
            raise UnknownGateError(
                f"nothing was measured as {identifier!r}; {_near(identifier, list(known))}"
            )
        return draw(finding, gate, ax=ax)

    def diagnose(self, estimator: Any = None, *, faults: Mapping[str, Fault] | None = None) -> Diagnosis:
        """What is wrong with the estimator: a symptom, its size, what may cause it, and the cure.

        With the `estimator`, an object with ``sample(x, n, rng)``, it is called again: faults in what it is
        called with (another unit, order or zero of the data) show only then. `faults` are your own, by id,
        beside the library's: ``{"my_fault": Fault(fit, causes)}`` of `gaugeblock.diagnosis`.
        """
        from gaugeblock.diagnosis import diagnose

        seed = int(self.verdict.provenance.get("seed") or 0)
        sample = None if estimator is None else estimator.sample
        return diagnose(self.trials, self.verdict, seed=seed, sample=sample, faults=faults)

    def save(self, folder: str | Path) -> Path:
        """Write trials, findings and all reports into a folder, made where missing: what `verify` reads.

        The folder counts it as a look, where this audit is enlarged in it.

        Raises
        ------
        InputError
            If the folder cannot be made or written to.
        """
        made = made_folder(folder)
        trials = write_arrays(self.trials, self.findings, self.not_checked, made)
        record = dict(self.verdict.provenance)
        record["sha256"] = {**dict(record.get("sha256") or {}), "trials": trials}
        replace(self, verdict=replace(self.verdict, provenance=record)).write_reports(made)
        enter_saved(made, self.trials, record, self.verdict.looks)
        return made

    def write_reports(self, folder: Path) -> None:
        """Write the reports alone, beside trials and findings that are in the folder already."""
        if self.resources:
            used = json.dumps(dict(self.resources), indent=2, sort_keys=True)
            write_atomically(folder / RESOURCES, used + "\n")
            discard_unfinished(folder, (RESOURCES,))
        called = title(self.verdict.provenance)
        write_reports(self.verdict, self.findings, self.trials, folder, title=called)

    def __repr__(self) -> str:
        first, *lines = verdict_lines(self.verdict, shown=SHOWN, most=LONGEST)
        looked_at = ", ".join(facts(self.trials))
        unchecked = f", {len(self.not_checked)} not checked" if self.not_checked else ""
        return "\n  ".join([f"<Audit {first}{unchecked}; {looked_at}>", *lines])

    def _repr_html_(self) -> str:
        return card_html(self.verdict, self.findings, self.trials, title=title(self.verdict.provenance))


def write_arrays(
    trials: xr.DataTree, findings: Sequence[Finding], not_checked: Sequence[NotChecked], folder: Path
) -> str:
    """Write trials.nc and findings.nc into a folder that exists; the digest of the former is returned."""
    # An old verdict must not stand beside new trials, should this process die between the files.
    (folder / "verdict.json").unlink(missing_ok=True)
    write_trials(trials, folder / "trials.nc")
    write_findings(findings, not_checked, folder / "findings.nc")
    discard_unfinished(folder, ("trials.nc", "findings.nc"))
    return file_digest(folder / "trials.nc")


def _near(identifier: str, known: list[str]) -> str:
    """Ids that are nearly this one, or the first ones there are."""
    near = difflib.get_close_matches(str(identifier), known, n=5, cutoff=0.5)
    near += [name for name in known if str(identifier) and str(identifier) in name and name not in near]
    if near:
        return f"did you mean {', '.join(near[:5])}?"
    return f"there are {', '.join(known[:8])}{' and more' * (len(known) > 8)}" if known else "there is none"
