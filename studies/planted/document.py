"""``docs/measured.md`` of the sets that were opened: rates by fault, and all headlines together."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from studies.kit.page import counted, fill, table
from studies.kit.results import measured_commit, read
from studies.measured import CONTROLS, kept
from studies.planted.faults import FAULTS, MEASURED

SAID = "stated where it is, not certain"

STRONG = 50.0
"""A case is strong if Cash's statistic of its best fit is that much above the number of bins: 25 nats."""

SETS = ("planted-first", "planted-second", "planted-third", "planted")
"""Sets that were drawn and opened, each once; the last one is what a run leaves."""

CALLED = {"measured": "{} with known answers", "measured-others": "{} others, run once"}
"""Cases of `studies.measured`, and how many there are."""

ALIKE = ("planted-third", "planted")
"""Those that were drawn as the study draws them now."""


def document(out: Path, page: Path) -> None:
    """Fill the page from what is stored."""
    files = {name: out / f"{name}.nc" for name in SETS}
    sets = {name: read(file) for name, file in files.items() if file.exists()}
    blocks = {f"measured {name}": shown(made) for name, made in sets.items()}
    if known := kept(out):
        blocks["measured headlines"] = headlines(
            {CALLED[name].format(len(rows)): rows for name, rows in known.items()},
            {
                f"planted, measured commit {sets[name].attrs['commit'][:7]}": sets[name]
                for name in ALIKE
                if name in sets
            },
        )
    fill(page, blocks)


def shown(made: xr.Dataset) -> str:
    """Rates by fault, with exact 95% limits, and what else was said."""
    lines = []
    for fault in (*FAULTS, "control"):
        part = made.isel(row=made["fault"].values == fault)
        if not part.sizes["row"]:
            continue
        wrong = part.isel(row=~part["right"].values)
        said = [
            f"{name or 'nothing'}{' beside ' + beside if beside else ''}"
            for name, beside in zip(wrong["named"].values, wrong["beside"].values, strict=True)
        ]
        if "stated" in part:
            said = [
                f"{one}, {SAID}" if stated else one
                for one, stated in zip(said, wrong["stated"].values, strict=True)
            ]
        kinds, number = np.unique(said, return_counts=True) if said else ((), ())
        rest = ", ".join(f"{kind} {count}" for kind, count in zip(kinds, number, strict=True))
        seconds = f"{np.median(part['seconds'].values):.0f}"
        control = fault == "control"
        held = "-" if control else _rate(part, _held(part))
        lines.append([fault if control else f"`{fault}`", _rate(part), held, rest or "-", seconds])
    strong = made.isel(row=made["fault"].values != "control")
    lines.append(["all that is planted", _rate(strong), _rate(strong, _held(strong)), "", ""])
    if "statistic" in made:
        strong = strong.isel(row=(strong["statistic"] - strong["bins"]).values >= STRONG)
        words = "of these strong: 25 nats or more in the best fit"
        lines.append([words, _rate(strong), _rate(strong, _held(strong)), "", ""])
    heads = ["planted", "named first, and certain", "in the first set", "else named", "CPU s, median"]
    text = f"{table(heads, lines)}\n\n{measured_commit(made)}"
    if "without" not in made:
        return text
    told = "; ".join(f"{words}: {counted(held, number)}" for words, held, number in intervals(made))
    return f"{text} 90% intervals that hold what was planted: {told}."


def intervals(made: xr.Dataset) -> list[tuple[str, int, int]]:
    """What was planted, how many of its 90% intervals hold it, and of how many.

    Of a line's energy, and of the amplitudes in `MEASURED`: as they are, and less what the control has of
    that effect, of any width.
    """
    found = []
    for fault, parameter in MEASURED.items():
        part = made.isel(row=made["fault"].values == fault)
        neutral = 1.0 if parameter == "slope" else 0.0
        offset = part["without"].values - neutral
        pairs = [
            (f"{fault}, {parameter}", part["amplitude"].values, "amplitude", 0.0 * offset),
            ("less what the control has", part["amplitude"].values, "amplitude", offset),
        ]
        if fault == "emission_line":
            pairs.append((f"{fault}, energy", part["energy"].values, "energy", 0.0 * offset))
        for words, planted, name, off in pairs:
            low, high = (part[f"{name}_{end}"].values - off for end in ("lo", "hi"))
            there = np.isfinite(low) & np.isfinite(high) & np.isfinite(planted)
            held = (low <= planted) & (planted <= high)
            found.append((words, int(held[there].sum()), int(there.sum())))
    return found


def headlines(known: Mapping[str, Mapping[str, Mapping[str, Any]]], sets: Mapping[str, xr.Dataset]) -> str:
    """Strong cases whose headline is right, silent controls, and cases with anything certain and wrong.

    `known` are cases with known answers (`studies.measured`), `sets` those of this study, each by what they
    are called.
    """
    found = {}
    for name, rows in known.items():
        strong = [row for row in rows.values() if row["kind"] not in CONTROLS]
        sound = [row for row in rows.values() if row["kind"] in CONTROLS]
        found[name] = (
            (sum(row["right"] for row in strong), len(strong)),
            (sum(not row["certain"] for row in sound), len(sound)),
            (sum(bool(row["beside"] or row["rejected"]) for row in rows.values()), len(rows)),
        )
    for name, made in sets.items():
        control = made["fault"].values == "control"
        loud = ~control & ((made["statistic"] - made["bins"]).values >= STRONG)
        certain = [names.split() for names in made["certain"].values]
        wrong = [
            any(one not in (fault, *(FAULTS[fault].tolerated if fault in FAULTS else ())) for one in said)
            for fault, said in zip(made["fault"].values, certain, strict=True)
        ]
        found[name] = (
            (int(made["right"].values[loud].sum()), int(loud.sum())),
            (sum(not one for one, quiet in zip(certain, control, strict=True) if quiet), int(control.sum())),
            (sum(wrong), len(wrong)),
        )
    found["together"] = tuple(
        tuple(map(sum, zip(*column, strict=True))) for column in zip(*found.values(), strict=True)
    )
    heads = ["cases", "strong: headline right", "controls: nothing certain", "anything certain and wrong"]
    return table(heads, [[name, *(counted(*pair) for pair in three)] for name, three in found.items()])


def _held(part: xr.Dataset) -> NDArray[np.bool_]:
    """Whether what was planted is among the names that the first one cannot be told from."""
    sets = zip(part["fault"].values, part["set"].values, strict=True)
    return np.array([fault in found.split() for fault, found in sets], dtype=bool)


def _rate(part: xr.Dataset, found: NDArray[np.bool_] | None = None) -> str:
    """Of these cases those that are right, or of which something else was found."""
    return counted(int((part["right"].values if found is None else found).sum()), part.sizes["row"])
