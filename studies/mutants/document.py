"""The table of docs/tests.md, from what is stored."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from studies.kit import page
from studies.kit.results import command_of

UNNOTICED = ("survived", "time was up")


def counts(table: xr.Dataset) -> dict[str, tuple[int, int, int, int]]:
    """Run, noticed, survived and equivalent, by room."""
    room, outcome = table["room"].values, table["outcome"].values
    found = {}
    for name in dict.fromkeys(room.tolist()):
        said = outcome[room == name]
        noticed, equivalent = int((said == "noticed").sum()), int((said == "equivalent").sum())
        found[name] = (len(said), noticed, int(np.isin(said, UNNOTICED).sum()), equivalent)
    return found


def draw_table(table: xr.Dataset, name: str) -> str:
    """A draw by room."""
    by_room = counts(table)
    if len(by_room) > 1:
        by_room["all"] = tuple(map(sum, zip(*by_room.values(), strict=True)))  # type: ignore[assignment]
    rows = []
    for room, (number, noticed, survived, equivalent) in by_room.items():
        told = noticed + survived
        share = f"{noticed / told:.0%} {page.limits(noticed, told)}" if told else ""
        rows.append([room, str(number), str(noticed), str(survived), str(equivalent), share])
    header = ["room", "run", "noticed", "survived", "equivalent", "noticed, of those that are not equivalent"]
    run, drawn = len(table["mutant"]), int(table.attrs["drawn"])
    what = f"**{name.capitalize()} draw**, {run} run of {drawn} drawn, from commit"
    if "left" in table.attrs:
        what = (
            f"**{name.capitalize()}**: of {table.attrs['left']} changes that it left unnoticed {drawn} can "
            f"still be made, {run} were, at commit"
        )
    return (
        f"{what} `{str(table.attrs['commit'])[:10]}`:\n\n{page.table(header, rows)}\n\n"
        f"Made by `{command_of(table)}`, {float(table['seconds'].sum()) / 60:.0f} CPU minutes, "
        f"at most {float(table.attrs['seconds']):.0f} seconds a mutant."
    )


def document(draws: Mapping[str, xr.Dataset], docs: Path) -> None:
    """Fill the page."""
    tables = [draw_table(table, name) for name, table in draws.items() if "mutant" in table.dims]
    page.fill(docs / "tests.md", {"mutants": "\n\n".join(tables)})
