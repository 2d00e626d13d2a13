"""What there is to reproduce, and what came of it, in a few lines for a terminal."""

from __future__ import annotations

from studies.paper import words
from studies.paper.experiments import EXPERIMENTS, load
from studies.paper.judge import Verdict
from studies.paper.registry import claims
from studies.paper.run import Reproduction, selected

SHOWN = 12
"""Differences that are shown; the page has them all."""


def listing(names: tuple[str, ...] = ()) -> str:
    """Every experiment with its claims, or those that are named.

    Raises
    ------
    InputError
        For a name that is neither a claim nor an experiment.
    """
    chosen, experiments = selected(names)
    says = {name: load(name).says for name in EXPERIMENTS}
    lines = []
    for name, text in says.items():
        members = [claim for claim in chosen.values() if claim.by == name]
        if members:
            lines.append(f"{name}: {text}; {len(members)} claims")
            lines += [f"  {claim.id}  {claim.says}: {words.published(claim)}" for claim in members]
    lines += [f"{name}: {load(name).says}; past the claims" for name in experiments if name not in says]
    return "\n".join(lines)


def headline(result: Reproduction) -> str:
    """How many claims came to which verdict, and those that differ."""
    if not result.judgements:
        return f"no claim is measured by {', '.join(result.tables)}: its numbers are in reproduction.nc"
    counts = ", ".join(
        f"{sum(item.verdict is verdict for item in result.judgements)} {verdict.value}" for verdict in Verdict
    )
    every = "" if len(result.judgements) == len(claims()) else f" of {len(claims())}"
    lines = [f"{len(result.judgements)}{every} claims: {counts}"]
    differing = [item for item in result.judgements if item.verdict is Verdict.DIFFERS]
    lines += [
        f"  differs  {item.claim.id}: published {words.published(item.claim)}, ours {words.ours(item)}; "
        f"{item.reason}"
        for item in differing[:SHOWN]
    ]
    if len(differing) > SHOWN:
        lines.append(f"  and {len(differing) - SHOWN} more")
    return "\n".join(lines)
