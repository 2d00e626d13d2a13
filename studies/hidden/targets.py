"""The targets, what was measured, and whether a target is missed beyond its 99% binomial limit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from scipy import stats

from studies.hidden.score import FAIR
from studies.kit.results import clopper_pearson

ALLOWED = 0.01
"""Chance of calling a target missed that is just met."""


@dataclass(frozen=True)
class Target:
    """A promise: a rate between `low` and `high`; `limits` is what chance allows among `number` cases."""

    name: str
    low: float
    high: float
    rate: float
    number: float
    limits: tuple[float, float]
    interval: tuple[float, float]

    @property
    def met(self) -> bool:
        """Whether the rate lies within the limits of chance."""
        return bool(self.limits[0] <= self.rate <= self.limits[1])


def target(name: str, hits: float, number: float, *, low: float = 0.0, high: float = 1.0) -> Target:
    """A target on a rate of `hits` among `number` independent cases.

    >>> target("a name where nothing is", 31, 400, high=0.05).met
    True
    >>> target("a name where nothing is", 32, 400, high=0.05).met
    False
    """
    n = int(np.floor(number))
    if n == 0:
        return Target(name, low, high, float("nan"), 0, (0.0, 1.0), (0.0, 1.0))
    tail = ALLOWED / 2 if low > 0 and high < 1 else ALLOWED
    least = float(stats.binom.ppf(tail, n, low)) / n if low > 0 else 0.0
    most = float(stats.binom.ppf(1 - tail, n, high)) / n if high < 1 else 1.0
    found = clopper_pearson(hits * n / number, n)
    return Target(name, low, high, hits / number, number, (least, most), (float(found[0]), float(found[1])))


def eligible(table: xr.Dataset, kind: str) -> xr.Dataset:
    """Cases of a kind that lie far enough from every rival."""
    return table.isel(row=(table["kind"].values == kind) & (table["nearest"].values >= FAIR))


def by_effect(table: xr.Dataset) -> tuple[float, float]:
    """Mean over effects of the mean of `right`, and the number of cases that such a mean is worth."""
    truth, right = table["truth"].values, table["right"].values
    names = np.unique(truth)
    if not len(names):
        return float("nan"), 0.0
    means = np.array([right[truth == name].mean() for name in names])
    sizes = np.array([np.count_nonzero(truth == name) for name in names])
    return float(means.mean()), float(len(names) ** 2 / (1.0 / sizes).sum())


def targets(table: xr.Dataset) -> list[Target]:
    """Every target of the study."""
    listed, unlisted = eligible(table, "listed"), eligible(table, "unlisted")
    nothing = table.isel(row=table["kind"].values == "nothing")
    mean, worth = by_effect(listed)
    named = listed.isel(row=listed["named"].values == listed["truth"].values)
    covered = named.isel(row=np.isfinite(named["amplitude_low"].values))
    inside = (covered["amplitude_low"] <= covered["amplitude_true"]) & (
        covered["amplitude_true"] <= covered["amplitude_high"]
    )
    gaps = named.isel(row=np.isfinite(named["gap_after"].values))
    shrunk = gaps["gap_after"] < gaps["gap_before"]
    given = ~np.isin(nothing["named"].values, ("", "unnamed"))
    return [
        target("eligible cases named correctly, averaged per effect", mean * worth, worth, low=0.9),
        target("a name given where nothing is hidden", int(given.sum()), nothing.sizes["row"], high=0.05),
        target(
            "a confident wrong name for what the library lacks",
            int(unlisted["wrong"].sum()),
            unlisted.sizes["row"],
            high=0.05,
        ),
        target(
            "90% interval of the amplitude holds the true one",
            int(inside.sum()),
            covered.sizes["row"],
            low=0.85,
            high=0.95,
        ),
        target(
            "the held-out gap shrinks where the name is right", int(shrunk.sum()), gaps.sizes["row"], low=0.95
        ),
    ]
