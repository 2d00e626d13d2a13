"""The part of ``docs/error-rates.md`` on the informed gate, made of the stored results."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from studies.kit import page
from studies.kit.results import command_of, of_commit, read

# Which file is of which validator, and how its gate is judged.
FILES = {"informed": "informed.nc", "anytime": "informed-anytime.nc"}
JUDGED = {
    "informed": "`informed.rank` alone, judged by the default policy as one of two that share its budget",
    "anytime": "`anytime.informed` after every trial, judged by the default policy beside the other bets",
}


def text(table: xr.Dataset) -> str:
    """How often each estimator is blocked and passed, with exact intervals."""
    rows = []
    for case in table["case"].values.tolist():
        row = table.sel(case=case)
        rates = (
            f"{float(part['rate']):.1%} ({float(part['low']):.1%} - {float(part['high']):.1%})"
            for part in (row.sel(thing=thing) for thing in ("FAIL", "PASS"))
        )
        z = f"{float(row['z']):+.1f} ({float(row['z_spread']):.1f})"
        cost = f"{float(row['seconds']):.1f}"
        rows.append([str(row["kind"].item()), case, *rates, f"{float(row['gap']):+.3f}", z, cost])
    header = ("estimator", "case", "FAIL", "PASS", "mean gap", "mean z (sd)", "CPU s")
    made = (
        f"{JUDGED[str(table.attrs.get('validator', 'informed'))]}; {int(table.attrs['trials']):,} trials x "
        f"{int(table.attrs['draws'])} draws, {int(table['replicates'])} audits of each. Made by "
        f"`{command_of(table)}`{of_commit(table)}."
    )
    return f"{made}\n\n{page.table(header, rows)}"


def document(folder: Path, docs: Path) -> None:
    """Fill the page in the folder `docs` from the results in another."""
    made = {file.stem: text(read(file)) for name in FILES.values() if (file := folder / name).exists()}
    page.fill(docs / "error-rates.md", made)
