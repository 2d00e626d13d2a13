"""What another training adds to an error: scatter between trained networks, pooled over cells of a kind.

A published number is of one training, and ours is a mean over n: their difference has the error
``s sqrt(1 + 1/n)``, with s between trainings. Few trainings tell s badly; the cells of a detector and level
tell one between them, and these lend each other what they know (Smyth 2004, Stat. Appl. Genet. Mol. Biol.
3, 3).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
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
    """Standard deviation between trainings and its degrees of freedom."""

    sd: float
    df: float

    def error(self, trainings: int) -> float:
        """What training adds to the error of a mean of so many of ours against one other training."""
        return float(self.sd * np.sqrt(1.0 + 1.0 / trainings))


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


def common_share(groups: Iterable[Array]) -> float:
    """Share of the variance between trainings that the cells of a detector have in common, of ``(cell,)``.

    None where there is but one training.

    >>> common_share([np.array([1.0, 1.0]), np.array([-2.0, -2.0])])
    1.0
    """
    values = list(groups)
    if not values:
        return 0.0
    pairs = sum((x.sum() ** 2 - (x**2).sum()) / (len(x) - 1) for x in values)
    return float(np.clip(pairs / sum((x**2).sum() for x in values), 0.0, 1.0))


@cache
def between_trainings() -> Mapping[tuple[str, str, str], Array]:
    """AUCs ``(training, cell)`` less their means over trainings, by response, level and detector.

    In published standard errors. Only the networks and their draws differ: spectra are the same.
    """
    from studies.paper.registry import claims

    found: dict[tuple[str, str, str], list[Array]] = {}
    for name, parts in (_trained("detection") | _trained("detection_nicer")).items():
        if name.startswith("grid."):
            _, response, level, *_, detector = name.split(".")
            values = parts[SINGLE[0]]
            apart = (values - values.mean()) / claims()[name].error[SINGLE[0]]
            found.setdefault((response, level, detector), []).append(apart)
    return {key: np.stack(cells, axis=-1) for key, cells in found.items()}


def freedom(trainings: int, cells: int, share: float) -> float:
    """Degrees of freedom of the mean variance of cells that share their networks (Satterthwaite 1946).

    They are worth fewer than they are: all of their variance in common, and they are worth one.

    >>> freedom(5, 16, 0.0), freedom(5, 16, 1.0)
    (64.0, 4.0)
    """
    return (trainings - 1.0) * cells / (1.0 + (cells - 1.0) * share**2)


def pooled(groups: Iterable[Array]) -> tuple[Array, Array]:
    """Variances between trainings of groups of residuals ``(training, cell)``, and degrees of freedom."""
    every = list(groups)
    share = common_share(row for group in every for row in group)
    variance = [(group**2).sum() / ((len(group) - 1.0) * group.shape[1]) for group in every]
    return moderated(np.array(variance), np.array([freedom(*group.shape, share) for group in every]))


@cache
def _of_cells() -> Mapping[tuple[str, str, str], tuple[float, float]]:
    """Scatter of an AUC between trainings over its own error, and degrees of freedom."""
    values = between_trainings()
    if not values:
        return {}
    variance, total = pooled(values.values())
    return {key: (float(np.sqrt(v)), float(d)) for key, v, d in zip(values, variance, total, strict=True)}


@cache
def _trained(experiment: str) -> dict[str, dict[str, Array]]:
    """What every kept training gives, ``(training,)`` by claim and part; nothing where there is but one."""
    table = committed(experiment)
    if table is None or "trained" not in table:
        return {}
    found: dict[str, dict[str, Array]] = {}
    rows = zip(table["claim"].values, table["part"].values, table["trained"].values.T, strict=True)
    for claim, part, values in rows:
        found.setdefault(str(claim), {})[str(part)] = values
    return found


def is_paired(claim: Claim) -> bool:
    """Whether our number is of the study's own spectra: their noise is then in both numbers alike."""
    from studies.paper.grid_populations import is_kept

    parts = claim.id.split(".")
    if parts[:2] != ["grid", "pn"]:
        return False
    return is_kept(parts[2], parts[3], float(".".join(parts[4:-1])))


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


def scatter(claim: Claim, part: str, less: str = "") -> Scatter | None:
    """Scatter between kept trainings of a part of a claim, or of what it exceeds another by.

    None where no second training is kept, or all gave the same: that is of no training then.
    """
    words = claim.id.split(".")
    if words[0] == "grid":
        known = _of_cells().get((words[1], words[2], words[-1]))
        return Scatter(known[0] * claim.error[SINGLE[0]], known[1]) if known else None
    # A row of table 2 is one network's, of a seed of its own.
    if claim.id.startswith("tab2.") and part == "dev":
        return Scatter(*_of_deviations())
    trained = _trained(claim.by).get(claim.id, {})
    if part not in trained:
        return None
    values = trained[part] - (trained[less] if less else 0.0)
    return Scatter(float(values.std(ddof=1)), len(values) - 1.0) if np.ptp(values) > 0 else None
