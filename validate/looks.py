"""Looks at an audit that grows: how its error rates are shared among them.

An audit that is enlarged and judged again has one more chance to be wrong. Each look may be wrong with a
fixed share of the policy's error budget, and of the 5% of PASS. The shares sum to 1, so the rates hold for
all looks together, whatever decides whether there is another one (Bonferroni; the first look's share is fixed
as in alpha spending: Lan & DeMets 1983). Audits that stop by themselves bet instead: see `anytime`.
"""

from __future__ import annotations

# One-sided, over all looks: how often a PASS of an estimator on the edge of the tolerance is right.
PASS_LEVEL = 0.95
# Of one look alone. It makes a first look some 10% longer than one that will never be looked at again.
FIRST = 0.75


def share(look: int) -> float:
    """Share of the error rates that a look may spend: the first, then half of what is left each time.

    >>> [share(look) for look in (1, 2, 3)]
    [0.75, 0.125, 0.0625]
    """
    return FIRST if look == 1 else (1 - FIRST) * 0.5 ** (look - 1)


def pass_level(look: int = 1) -> float:
    """Level of the one-sided bounds that must lie inside the tolerance for PASS at this look.

    >>> round(pass_level(), 4)
    0.9625
    """
    return 1 - (1 - PASS_LEVEL) * share(look)
