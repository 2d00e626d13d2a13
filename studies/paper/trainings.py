"""What another training adds to an error: scatter between trained networks, pooled over claims of a kind.

A published number is of one training, and so is ours where no more are kept: their difference has the error
``s sqrt(1 + 1/n)`` for n trainings of ours, with s between trainings. Few trainings tell s badly; groups of
claims lend each other what they know (Smyth 2004, Stat. Appl. Genet. Mol. Biol. 3, 3).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy import optimize, special

from gaugeblock.core.arrays import Array
from studies.paper.claim import SINGLE, Claim
from studies.paper.experiment import committed
from studies.paper.numbers import by_claim

RETRAINED = ("tab2.reseed101", "tab2.reseed202", "tab2.reseed303")
STOPPED = (*RETRAINED, "tab2.uncapped")
"""Bright trainings that ended by themselves, each another network; the capped one is not among them."""


@dataclass(frozen=True)
class Scatter:
    """Standard deviation between trainings, its degrees of freedom, and of how many trainings ours is."""

    sd: float
    df: float
    trainings: int = 1

    @property
    def error(self) -> float:
        """What training adds to the error of ours against one other training."""
        return float(self.sd * np.sqrt(1.0 + 1.0 / self.trainings))


def moderated(variance: Array, df: Array) -> tuple[Array, Array]:
    """Variances ``(n,)`` drawn together as far as their scatter allows, with their degrees of freedom.

    The prior's degrees of freedom and scale follow from the moments of the log variances; where these scatter
    no more than their own errors, the prior is sharp and all variances are one.

    >>> moderated(np.array([1.0, 1.0]), np.array([3.0, 3.0]))[1]
    array([inf, inf])
    """
    logs = np.log(variance) - special.digamma(df / 2.0) + np.log(df / 2.0)
    excess = logs.var(ddof=1) - special.polygamma(1, df / 2.0).mean()
    if excess <= 0:
        pooled = np.average(variance, weights=df)
        return np.full(len(variance), pooled), np.full(len(variance), np.inf)
    half = optimize.brentq(lambda x: special.polygamma(1, x) - excess, 1e-6, 1e6)
    scale = np.exp(logs.mean() + special.digamma(half) - np.log(half))
    prior = 2.0 * half
    return (prior * scale + df * variance) / (prior + df), df + prior


@cache
def between_networks() -> dict[tuple[str, str], Array]:
    """AUCs of two networks on the same spectra of EPIC-pn: differences over errors, by level and detector.

    One is the study's architecture, the other ours; the spectra are the study's own, so that nothing but the
    networks and their draws differs. In standard errors of one AUC over sqrt(2), as of two trainings.
    """
    from studies.paper.detection_claims import cells
    from studies.paper.grid_populations import LEVELS
    from studies.paper.registry import DETECTORS, claims

    one, other = (committed(name) for name in ("detection", "detection_nicer"))
    assert one is not None
    assert other is not None
    apart = (one["auc"] - other["auc"]).sel(response="epic-pn").values
    found: dict[tuple[str, str], list[float]] = {}
    for name, place in cells("epic-pn"):
        if is_paired(claims()[name]):
            key = (LEVELS[place[0]], DETECTORS[place[-1]])
            error = claims()[name].error[SINGLE[0]]
            found.setdefault(key, []).append(apart[place] / (np.sqrt(2.0) * error))
    return {key: np.array(values) for key, values in found.items()}


def is_paired(claim: Claim) -> bool:
    """Whether our number is of the study's own spectra: their noise is then in both numbers alike."""
    from studies.paper.grid_populations import is_kept

    parts = claim.id.split(".")
    if parts[:2] != ["grid", "pn"]:
        return False
    return is_kept(parts[2], parts[3], float(".".join(parts[4:-1])))


@cache
def _of_cells() -> dict[tuple[str, str], tuple[float, float]]:
    """Scatter of an AUC between networks over its own error, and degrees of freedom."""
    values = between_networks()
    df = np.array([len(x) for x in values.values()], dtype=float)
    variance, total = moderated(np.array([(x**2).mean() for x in values.values()]), df)
    return {key: (float(np.sqrt(v)), float(d)) for key, v, d in zip(values, variance, total, strict=True)}


@cache
def _of_deviations() -> tuple[float, float]:
    """Scatter of the coverage deviation between trainings that stopped: the study's four and ours."""
    from studies.paper.registry import claims

    ours: dict[str, dict[str, float]] = {}
    for table in map(committed, ("calibration_published", "calibration_retrained")):
        assert table is not None
        ours |= by_claim(table)
    rows = np.array([[ours[name]["dev"], claims()[name].parts["dev"]] for name in STOPPED])
    df = np.full(2, len(STOPPED) - 1.0)
    variance, total = moderated(rows.var(axis=0, ddof=1), df)
    return float(np.sqrt(variance[0])), float(min(total[0], df.sum()))


def scatter(claim: Claim, part: str) -> Scatter | None:
    """Scatter between trainings of a part of a claim; None where no second training is kept."""
    words = claim.id.split(".")
    if words[0] == "grid":
        # Faint has no spectra in common, so it takes the level above it.
        level = "medium" if words[2] == "faint" else words[2]
        share, df = _of_cells()[level, words[-1]]
        return Scatter(share * claim.error[SINGLE[0]], df)
    # NICER's flow is of our architecture, which these trainings say nothing of.
    if claim.id.startswith(("cal.dev.pn", "tab2.")) and part in (SINGLE[0], "dev"):
        return Scatter(*_of_deviations())
    return None
