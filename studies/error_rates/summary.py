"""From replicates to the small tables that are kept: counts, and what the true rates may be given them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from gaugeblock.core.errors import InputError
from gaugeblock.validate import Outcome
from studies.kit.results import clopper_pearson, command_of_both, measured_of_both

Values = Mapping[str, float]

LEVELS = (0.01, 0.05, 0.1)
BINS = 50


def indicators(results: Mapping[str, Sequence[Values]]) -> xr.Dataset:
    """How often each thing happened in each case: count, replicates, rate and its exact 95% interval.

    A thing that a replicate does not mention did not happen in it; one that is NaN was not to be had.
    """
    things = sorted({name for replicates in results.values() for values in replicates for name in values})
    count, number = (np.zeros((len(results), len(things)), dtype=np.int64) for _ in range(2))
    for row, replicates in enumerate(results.values()):
        table = np.array([[values.get(thing, 0.0) for thing in things] for values in replicates])
        table = table.reshape(len(replicates), len(things))
        count[row] = (table == 1).sum(axis=0)
        number[row] = np.isfinite(table).sum(axis=0)
    dims = ("case", "thing")
    counted = {"count": (dims, count), "replicates": (dims, number)}
    return _rates(xr.Dataset(counted, coords={"case": list(results), "thing": things}))


def indicators_where_asked(results: Mapping[str, Sequence[Values]]) -> xr.Dataset:
    """The same, where not every replicate was asked everything: what is not mentioned was not to be had."""
    things = {name for replicates in results.values() for values in replicates for name in values}
    none = dict.fromkeys(things, np.nan)
    return indicators({case: [none | dict(values) for values in made] for case, made in results.items()})


def verdicts(outcome: Outcome) -> Values:
    """A verdict as indicators.

    >>> verdicts(Outcome.FAIL)
    {'PASS': 0.0, 'FAIL': 1.0, 'INCONCLUSIVE': 0.0}
    """
    return {name.value: float(outcome is name) for name in Outcome}


def has(table: xr.Dataset) -> int:
    """Replicates of each case that a table of `indicators` has.

    Raises
    ------
    InputError
        If it is no such table.
    """
    if "count" not in table:
        raise InputError(
            f"{table.attrs.get('part')}: its table is no sum, nothing can be added; make it anew"
        )
    return int(table.replicates.max())


def added(earlier: xr.Dataset, later: xr.Dataset) -> xr.Dataset:
    """Two tables of `indicators` as one: replicates of the same cases, none of them in both.

    Raises
    ------
    InputError
        If they were not made alike.
    """
    command = command_of_both(earlier.attrs, later.attrs)
    things = sorted({*earlier.thing.values, *later.thing.values})
    both = [
        # What no replicate mentions happened in none of them.
        table[["count", "replicates"]].reindex(
            thing=things, fill_value={"count": 0, "replicates": has(table)}
        )
        for table in (earlier, later)
    ]
    numbers = [has(table) for table in (earlier, later)]
    took = np.average([table.attrs["seconds_per_replicate"] for table in (earlier, later)], weights=numbers)
    alike = {name: value for name, value in later.attrs.items() if name not in ("commit", "code")}
    more = {"command": command, "seconds_per_replicate": round(float(took), 4)}
    return _rates((both[0] + both[1]).drop_attrs()).assign_attrs(
        alike | measured_of_both(earlier.attrs, later.attrs) | more
    )


def _rates(counted: xr.Dataset) -> xr.Dataset:
    low, high = clopper_pearson(counted["count"], counted.replicates)
    rate = counted["count"] / np.maximum(counted.replicates, 1)
    dims = counted["count"].dims
    return counted.assign(rate=rate, low=(dims, low), high=(dims, high))


def p_values(results: Mapping[str, Sequence[Values]]) -> xr.Dataset:
    """Rejection rates of each test at three levels with exact 95% intervals, and its histogram."""
    rows = {
        (case, test): np.array([values[test] for values in replicates if test in values])
        for case, replicates in results.items()
        for test in sorted({name for values in replicates for name in values})
    }
    rows = {key: p[np.isfinite(p)] for key, p in rows.items()}
    number = np.array([len(p) for p in rows.values()])
    rejected = np.array([[np.count_nonzero(p <= level) for level in LEVELS] for p in rows.values()])
    low, high = clopper_pearson(rejected, number[:, None])
    histogram = np.array([np.histogram(p, BINS, (0, 1))[0] for p in rows.values()])
    return xr.Dataset(
        {
            "case": ("row", [case for case, _ in rows]),
            "test": ("row", [test for _, test in rows]),
            "replicates": ("row", number),
            "rejected": (("row", "level"), rejected),
            "rate": (("row", "level"), rejected / np.maximum(number, 1)[:, None]),
            "low": (("row", "level"), low),
            "high": (("row", "level"), high),
            "histogram": (("row", "bin"), histogram),
        },
        coords={"level": list(LEVELS), "bin": (np.arange(BINS) + 0.5) / BINS},
    )
