"""What a ledger says of the audits before this one, in a sentence or two."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gaugeblock.reports.words import count

UNKNOWN = "Earlier looks unknown: no ledger."


ELSEWHERE = "Earlier looks unknown, but for those at this audit: no ledger."


def of_the_ledger(provenance: Mapping[str, Any], *, unknown: str = UNKNOWN) -> str:
    """How many audits came before this one, and whether its truths were used before, as provenance says it.

    Without a ledger it is `unknown`.

    >>> of_the_ledger({"ledger": {"earlier": 6, "estimators": 5, "same_truths": 0}})
    'The 7th audit of this simulator under this policy: 6 earlier ones, of 5 estimators.'
    >>> of_the_ledger({"ledger": None}), of_the_ledger({})
    ('Earlier looks unknown: no ledger.', '')
    """
    if "ledger" not in provenance:  # of no audit, or of one from before there were ledgers
        return ""
    record = provenance["ledger"]
    if not isinstance(record, Mapping):
        return unknown
    earlier, estimators, truths, releases, others = (
        value if isinstance(value := record.get(name), int) else 0
        for name in ("earlier", "estimators", "same_truths", "releases", "other_policies")
    )
    kept = provenance.get("sha256")
    # `gaugeblock gate` judges under another policy than the one that the ledger counted.
    other = isinstance(kept, Mapping) and kept.get("policy") != record.get("policy", kept.get("policy"))
    before = (
        f"{earlier:,} earlier {'one' if earlier == 1 else 'ones'}, of {count(estimators, 'estimator')}"
        if earlier
        else "none is in the ledger before it"
    )
    under = "the policy it was audited under, which is another" if other else "this policy"
    said = [f"The {_ordinal(earlier + 1)} audit of this simulator under {under}: {before}."]
    if others:
        said.append(f"Under other policies it had {count(others, 'earlier audit')}, not among these.")
    if truths:
        said.append(
            f"The same truths judged {count(truths, 'estimator')} before: a PASS is optimistic "
            "(docs/audit.md, Retraining until PASS)."
        )
    elif record.get("release"):
        said.append("Release audit: truths unused until the estimator was final.")
    if releases:
        said.append(f"{count(releases, 'release audit')} came before it: each is another chance to pass.")
    return " ".join(said)


def _ordinal(number: int) -> str:
    """In digits.

    >>> [_ordinal(number) for number in (1, 2, 3, 4, 11, 12, 21, 102, 113)]
    ['1st', '2nd', '3rd', '4th', '11th', '12th', '21st', '102nd', '113th']
    """
    last = {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number:,}{'th' if number % 100 in (11, 12, 13) else last}"
