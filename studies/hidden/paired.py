"""The same sealed set searched again: case by case beside what was said before, and how sure it was."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import xarray as xr
from scipy import stats

from studies.hidden.targets import eligible
from studies.kit.page import limits
from studies.kit.page import table as rows

EDGES = (0.0, 0.5, 0.8, 0.925, 0.97, 1.0)
"""Of printed probabilities, from row to row."""


def paired(before: xr.Dataset, after: xr.Dataset) -> str:
    """Right names, names where nothing is, and wrong names without a rival: then, now, both or neither.

    The p-value is of the sign test on cases of which only one of the two holds.
    """
    was = before.set_index(row="number").sel(row=after["number"].values).reset_index("row")
    was = was.assign(number=("row", after["number"].values))
    fair = np.isin(after["number"].values, eligible(was, "listed")["number"].values)
    nothing = was["kind"].values == "nothing"
    lacking = np.isin(after["number"].values, eligible(was, "unlisted")["number"].values)
    given = [~np.isin(one["named"].values, ("", "unnamed")) for one in (was, after)]
    kinds = (
        ("the right name, alone", fair, [one["right"].values == 1 for one in (was, after)]),
        ("the right name, alone or one of two", fair, [one["right"].values > 0 for one in (was, after)]),
        ("a name where nothing is hidden", nothing, given),
        (
            "a wrong name alone for what the library lacks",
            lacking,
            [one["wrong"].values for one in (was, after)],
        ),
        ("a wrong name alone for what the library has", fair, [one["wrong"].values for one in (was, after)]),
    )
    lines = []
    for name, of, (then, now) in kinds:
        first, second = then[of].astype(bool), now[of].astype(bool)
        lost, won = int((first & ~second).sum()), int((second & ~first).sum())
        p = float(stats.binomtest(lost, lost + won).pvalue) if lost + won else 1.0
        lines.append(
            (
                name,
                str(int(of.sum())),
                str(int(first.sum())),
                str(int(second.sum())),
                str(lost),
                str(won),
                f"{p:.2g}",
            )
        )
    header = ("", "cases", "0.1.0", "now", "only 0.1.0", "only now", "p")
    return rows(header, lines)


def reliability(statements: xr.Dataset) -> str:
    """How many of the statements that are printed at about one probability hold."""
    stated, right = statements["probability"].values, statements["right"].values.astype(bool)
    certain = statements["certain"].values.astype(bool)
    chosen = [
        *(
            (f"{low:g} to {high:g}", (stated >= low) & ((stated < high) | (high == 1.0)))
            for low, high in pairwise(EDGES)
        ),
        ("certain", certain),
        ("not certain", ~certain),
        ("all", np.full(len(stated), True)),
    ]
    lines = []
    for name, of in chosen:
        if of.any():
            number = int(of.sum())
            share = f"{right[of].mean():.1%} {limits(int(right[of].sum()), number, digits=1)}"
            lines.append((name, str(number), f"{stated[of].mean():.3f}", share))
    return rows(("printed probability", "statements", "mean of it", "hold"), lines)
