"""The tables of docs/cures.md, from what is stored."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import xarray as xr
from scipy import stats

from studies.cures.catalogue import FAULTS
from studies.cures.measure import TRAININGS
from studies.faults.document import WORDS, rate
from studies.faults.measure import ARMS
from studies.kit import page
from studies.kit.results import command_of, stored

PAGE = "cures.md"
SAID = {
    "named": "the cures of what was named",
    "placebo": "nothing, but for another seed (placebo)",
    "runner_up": "the cures of the runner-up",
    "right": "everything right",
}


def _blocked(table: xr.Dataset) -> xr.Dataset:
    return table.isel(case=table["outcome"].values == "FAIL")


def provenance(table: xr.Dataset) -> str:
    """Which cases, and where their seed comes from."""
    outcome = table["outcome"].values
    count = ", ".join(f"{(outcome == one).sum()} {one}" for one in ("FAIL", "INCONCLUSIVE", "PASS"))
    return (
        f"{table.sizes['case']} flows: {count}. Measured is commit `{table.attrs['commit']}`, whose digest "
        f"gave the seed {table.attrs['generator_seed']}. `{command_of(table)}`."
    )


def trial(table: xr.Dataset) -> str:
    """Flows that FAIL, trained again in each way: how many PASS, of all and where the cause was listed."""
    blocked = _blocked(table)
    caused = blocked.isel(case=blocked["called_cause"].values)
    rows = []
    for way in TRAININGS:
        cells = [SAID[way]]
        for part in (blocked, caused):
            cells.append(rate(int((part[way].values == "PASS").sum()), part.sizes["case"]))
        rows.append(cells)
    return page.table(
        ["trained again with", "PASS, of all that FAILed", "of those whose cause was listed"], rows
    )


def differences(table: xr.Dataset) -> str:
    """The named cure beside the others on the same flows, by those that only one of two mended."""
    blocked, rows = _blocked(table), []
    mended = {way: blocked[way].values == "PASS" for way in TRAININGS}
    for way in ("placebo", "runner_up"):
        only, other = (mended["named"] & ~mended[way]).sum(), (mended[way] & ~mended["named"]).sum()
        gain = float((mended["named"].astype(float) - mended[way]).mean())
        times = mended["named"].sum() / max(int(mended[way].sum()), 1)
        p = stats.binomtest(int(only), int(only + other)).pvalue if only + other else 1.0
        rows.append([SAID[way], f"{gain:+.0%}", f"{times:.1f}", str(only), str(other), f"{p:.1g}"])
    header = ["the named cure against", "difference", "times as often", "only it mended", "only the other"]
    return page.table([*header, "p (McNemar, exact)"], rows)


def names(table: xr.Dataset) -> str:
    """Symptom and cause, of flows that FAIL, in both arms."""
    blocked, rows = _blocked(table), []
    for arm in ARMS:
        one = [WORDS[arm]]
        for part in ("symptom", "cause"):
            one.append(rate(int(blocked[f"{arm}_{part}"].values.sum()), blocked.sizes["case"]))
        one.append(rate(int((blocked[f"{arm}_named"].values == "other").sum()), blocked.sizes["case"]))
        rows.append(one)
    return page.table(["arm", "symptom right", "its cause among those listed", "`other`"], rows)


def by_fault(table: xr.Dataset) -> str:
    """Each way of training wrongly."""
    rows = []
    for fault in FAULTS:
        every = table.isel(case=table["fault"].values == fault)
        blocked = _blocked(every)
        said, count = np.unique(blocked["called_named"].values, return_counts=True)
        order = np.argsort(-count, kind="stable")
        cells = [fault, f"{blocked.sizes['case']} of {every.sizes['case']}"]
        cells.append(", ".join(f"`{said[k] or 'nothing'}` {count[k]}" for k in order) or "-")
        cells.append(str(int(blocked["called_cause"].values.sum())))
        cells += [str(int((blocked[way].values == "PASS").sum())) for way in TRAININGS]
        rows.append(cells)
    header = ["trained with", "FAIL", "named, called again", "cause listed", "PASS: named cure"]
    return page.table([*header, "placebo", "runner-up", "right"], rows)


MAKERS: Mapping[str, Callable[[xr.Dataset], str]] = {
    "provenance": provenance,
    "trial": trial,
    "differences": differences,
    "names": names,
    "faults": by_fault,
}


def document(out: Path, docs: Path) -> None:
    """Fill the page with what there is."""
    for name, table in stored(["cures"], out).items():
        page.fill(docs / PAGE, {f"{name} {part}": make(table) for part, make in MAKERS.items()})
