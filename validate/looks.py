"""Looks: an audit that is enlarged until it is settled spends its error rates once, not at every look.

Each look has a share of both levels, fixed beforehand: of the budget of FAIL, and of the 5% of a PASS. The
shares sum to one, so that whoever enlarges an audit as often as they like is wrong at any of its looks no
more often than the policy says, whatever made them look again (Lan & DeMets 1983, without use of the
correlation of looks, which depends on sizes that nobody knows beforehand).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

# Of the first look: 0.8 of each level costs at most 8% more trials, and most audits are looked at once.
FIRST = 0.8


def share(look: int) -> float:
    """Share of each level that a look has, the first being 1: 0.8, 0.1, 0.033, 0.017, ...

    >>> [round(share(look), 3) for look in (1, 2, 3, 8)], round(sum(map(share, range(1, 10_000))), 3)
    ([0.8, 0.1, 0.033, 0.004], 1.0)
    """
    return FIRST if look == 1 else (1 - FIRST) / (look * (look - 1))


@dataclass(frozen=True, kw_only=True)
class Looks:
    """Trials at every look of this audit so far, the present one last.

    As many as before are another look where likelihoods or importance draws are of more or fewer of them.

    `anew` says that its folder holds looks of another estimator, policy or seed, or at other draws, which are
    not among them; `other_policies` how many audits of the same truths under other policies came before it.
    """

    trials: tuple[int, ...] = ()
    anew: bool = False
    other_policies: int = 0

    @property
    def number(self) -> int:
        """Which look it is, the first being 1."""
        return max(1, len(self.trials))

    def to_json(self) -> dict[str, Any]:
        """Plain data, for verdict.json."""
        return {
            "number": self.number,
            "trials": list(self.trials),
            "anew": self.anew,
            "other_policies": self.other_policies,
        }
