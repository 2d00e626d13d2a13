"""Watching trials come in, to stop as soon as the gates of the anytime mode are settled."""

from __future__ import annotations

from collections.abc import Iterable

import xarray as xr

from gaugeblock.validate.anytime.sequence import extended
from gaugeblock.validate.anytime.stakes import decide, gather
from gaugeblock.validate.finding import CountFinding, Finding, SequenceFinding
from gaugeblock.validate.policy import Policy
from gaugeblock.validate.validators import default_validators, run_validators
from gaugeblock.validate.verdict import Outcome, combine

# What may stop an audit: a draw that is no number, and the bets.
WATCHED = ("draws", "anytime")
# Bets are reckoned again once there are so many times more trials, and those of challengers, which learn from
# all trials together, once there are so many; their error rates hold at every look.
SPACING, TOGETHER = 1.05, 1.2


def watched(select: Iterable[str] | None) -> tuple[str, ...]:
    """Validators to run in the anytime mode: those in `select`, or all default ones, and what is watched."""
    return tuple(dict.fromkeys([*(default_validators() if select is None else select), *WATCHED]))


class Watch:
    """Sees blocks of trials in their order, and says when nothing that is left could matter.

    That is when one gate of the anytime mode FAILs, all of them PASS, or some draw is no finite number. The
    same blocks, policy and seed give the same answers.
    """

    def __init__(self, policy: Policy, seed: int):
        self.policy, self.seed = policy, seed
        self._sequences: dict[str, SequenceFinding] = {}
        self._next = 0.0

    def see(self, block: xr.Dataset) -> bool:
        """Whether, with this block, it seems settled; `confirm` makes it certain."""
        findings = self._findings(block, part=True)
        for finding in findings:
            if isinstance(finding, SequenceFinding):
                earlier = self._sequences.get(finding.id)
                self._sequences[finding.id] = finding if earlier is None else extended(earlier, finding)
        if _not_finite(findings):
            return True
        seen = next((finding.n_trials for finding in self._sequences.values()), 0)
        if seen < self._next:
            return False
        self._next = SPACING * seen
        return self._settled(self._sequences.values())

    def confirm(self, trials: xr.Dataset) -> bool:
        """Whether all trials so far settle it together.

        Markov chains are thinned by what all of them say, and challengers learn from all of them.
        """
        findings = self._findings(trials)
        settled = self._settled(f for f in findings if isinstance(f, SequenceFinding))
        self._next = TOGETHER * trials.sizes["trial"]
        return _not_finite(findings) or settled

    def _findings(self, trials: xr.Dataset, *, part: bool = False) -> tuple[Finding, ...]:
        return run_validators(trials, seed=self.seed, select=WATCHED, levels=self.policy.levels, part=part)[0]

    def _settled(self, sequences: Iterable[SequenceFinding]) -> bool:
        decided = decide(gather(list(sequences), self.policy), self.policy.error_budget)
        return combine(decided) is not Outcome.INCONCLUSIVE


def _not_finite(findings: Iterable[Finding]) -> bool:
    return any(isinstance(finding, CountFinding) and finding.estimate.any() for finding in findings)
