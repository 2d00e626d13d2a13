"""Why the verdict is what it is, in a sentence or two."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from gaugeblock.reports.ledger import ELSEWHERE, UNKNOWN, of_the_ledger
from gaugeblock.reports.words import count, listed
from gaugeblock.validate import Gate, Outcome, Verdict

# The gate that asks whether the data are used.
DATA = "informed.rank"


def reason(verdict: Verdict) -> str:
    """A few sentences that say why the verdict is what it is."""
    data = of_the_data(verdict) if verdict.outcome is Outcome.PASS else ""
    trust = of_trust(verdict.provenance)
    return " ".join(filter(None, [f"{_why(verdict)}{_stopped(verdict)}", data, *before(verdict), trust]))


def of_the_data(verdict: Verdict) -> str:
    """Whether the estimator uses its data: what the gate that asks says, or that nothing could ask.

    Calibration alone is no answer: the prior is calibrated. Empty where the gate did not PASS or was not run.
    """
    if any(item.without_data for item in verdict.not_checked):
        head = "Calibrated; whether" if verdict.outcome is Outcome.PASS else "Whether"
        return f"{head} it uses the data could not be checked: the trials hold none."
    said = [gate.message for gate in verdict.gates if gate.id == DATA and gate.outcome is Outcome.PASS]
    return f"On the data: {said[0]}." if said else ""


def before(verdict: Verdict) -> list[str]:
    """What was looked at before: at this audit, and at others, as far as a ledger knows of them."""
    unknown = ELSEWHERE if verdict.looks.number > 1 else UNKNOWN
    said = [of_looks(verdict), of_the_ledger(verdict.provenance, unknown=unknown)]
    return [sentence for sentence in said if sentence]


def of_looks(verdict: Verdict) -> str:
    """How often this audit was judged before, with fewer trials or other ones; empty for the first look."""
    looks, said = verdict.looks, []
    if looks.number > 1:
        before = listed([f"{trials:,}" for trials in looks.trials[:-1]], most=8)
        said.append(f"Look {looks.number} at this audit, after {before} trials: all share the error rates.")
    if looks.anew:
        trials = verdict.provenance.get("trials")
        simulated = isinstance(trials, Mapping) and "block" in trials
        other = (
            "at another estimator, policy, seed or plan of trials"
            if simulated
            else "at draws that do not begin as these do, or under another policy,"
        )
        said.append(f"Looks in its folder {other} are not counted.")
    if looks.other_policies:
        under = "another policy" if looks.other_policies == 1 else "other policies"
        said.append(f"{count(looks.other_policies, 'earlier audit')} of these truths under {under}.")
    return " ".join(said)


def of_trust(provenance: Mapping[str, Any]) -> str:
    """What lowers the worth of the verdict: trust that was given, a seed that was known, mere claims."""
    record = provenance.get("trust")
    said = record.get("caveats") if isinstance(record, Mapping) else None
    return " ".join(map(str, said)) if isinstance(said, list) else ""


def _stopped(verdict: Verdict) -> str:
    """That the trials were watched, and when that ended, where the provenance says so."""
    trials = verdict.provenance.get("trials")
    if not isinstance(trials, Mapping) or not trials.get("anytime"):
        return ""
    used, most = int(trials.get("used", 0)), int(trials.get("number", 0))
    ended = f"stopped after {used:,} of at most {most:,}" if used < most else f"none was left after {most:,}"
    return f" Trials were watched as they came in, and {ended}; the error rates hold at any of them."


def _why(verdict: Verdict) -> str:
    if verdict.outcome is Outcome.FAIL:
        failed = [gate.id for gate in verdict.gates if gate.outcome is Outcome.FAIL]
        return (
            f"{len(failed):,} of {count(len(verdict.gates), 'gate')} failed by more than chance explains: "
            f"{listed(failed, most=4)}."
        )
    required = [gate for gate in verdict.gates if gate.required]
    if verdict.outcome is Outcome.PASS:
        optional = [gate.id for gate in verdict.gates if gate.outcome is not Outcome.PASS]
        who = "The one required gate" if len(required) == 1 else f"All {len(required):,} required gates"
        sentence = f"{who} passed: inside the tolerance with 95% confidence."
        return sentence + (f" Not required, and not decided: {listed(optional, most=4)}." if optional else "")
    unsettled = [gate for gate in required if gate.outcome is Outcome.INCONCLUSIVE]
    missing = [gate.id for gate in unsettled if not is_computed(gate)]
    unsettled = [gate for gate in unsettled if is_computed(gate)]
    said = []
    if missing or not unsettled:
        names = listed(missing or [item.id for item in verdict.not_checked], most=4)
        said.append(f"What the policy requires could not all be checked{': ' + names if names else ''}.")
    if unsettled:
        said.append(
            f"{len(unsettled):,} of {count(len(required), 'required gate')} could not be decided: "
            f"{listed([gate.id for gate in unsettled], most=4)}."
        )
        said.append(settled_by(unsettled))
    return " ".join(part for part in said if part)


def settled_by(unsettled: Sequence[Gate]) -> str:
    """How many trials settle all that is open, as far as that can be foretold."""
    wanted = [gate.trials_to_settle for gate in unsettled]
    known = [round_up(trials) for trials in wanted if trials is not None]
    if not known or len(known) < len(wanted):
        return ""
    ranges = [gate.trials_to_settle_range for gate in unsettled]
    lows = [found[0] for found in ranges if found is not None and found[0] is not None]
    most = max(known)
    said = count(most, "trial")
    if len(lows) == len(known) and max(lows) < most:
        return f"{max(lows):,} to {said} would settle it, in eight of ten cases; enlarge it in its folder."
    return f"About {said} would settle it, if the estimates hold."


def is_computed(gate: Gate) -> bool:
    """Whether there is an estimate behind the gate; a required check that could not be made has none."""
    return math.isfinite(gate.statistic)


def round_up(amount: int) -> int:
    """Up to two significant digits: nobody plans 1,637 trials.

    >>> round_up(1637), round_up(95), round_up(4000)
    (1700, 95, 4000)
    """
    step: int = 10 ** max(len(str(amount)) - 2, 0)
    return -(-amount // step) * step
