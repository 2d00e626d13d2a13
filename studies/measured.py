"""Measured spectra whose answer is known: whether the headline holds it.

    python -m studies.measured FOLDER [CASE ...]
    python -m studies.measured FOLDER --name measured-others       # kept beside them: results/NAME.json
    python -m studies.measured --page            # docs/measured.md of results/measured*.json; nothing is run

FOLDER holds ``cases.json`` and a folder for each case. A case says what to run (`model`, `band`, `redshift`,
`background`) and what counts as right: `accept` are headline names (a list: together; ``"nothing"``: naming
nothing), at least one of `set_must_contain_one_of` stands in the set, `reject` are wrong as headline (``"any
name"``: every name). The spectra stay where they are; figures alone are kept.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from gaugeblock import discovery, simulators
from gaugeblock.core.atomic import made_folder, write_atomically
from gaugeblock.core.errors import InputError
from gaugeblock.core.progress import Bars
from studies.kit.command import carried_out
from studies.kit.page import counted, fill, table
from studies.kit.results import RESULTS, record
from studies.kit.resume import Pieces, code_of

PAGE = Path(__file__).resolve().parents[1] / "docs" / "measured.md"
SEED = 1
MARKERS = {"measured": "measured cases", "measured-others": "measured others"}
"""Where results stand on the page, by the name of their file."""

CONTROLS = ("control", "soft control", "weak")


def scored(case: Mapping[str, Any], found: Mapping[str, Any]) -> dict[str, Any]:
    """Whether a discovery (as in discovery.json) is right of a case.

    The headline is `named`, and with it the other certain names where `accept` asks for several together. A
    control is right if nothing is certain and nothing rejected is named; `beside` are certain statements
    other than the headline whose names the case rejects: with one of them nothing is right.
    """
    named, alike = found["named"], list(found["indistinguishable"])
    certain = [one["effect"] for one in found["statements"] if one["certain"] and one["effect"] != "unnamed"]
    headline = named if named not in (None, "unnamed") else "nothing" if named is None else "unnamed"
    alone = [name for name in case["accept"] if isinstance(name, str)]
    together = [name for name in case["accept"] if not isinstance(name, str)]
    right = headline in alone or any(sorted(certain[: len(names)]) == sorted(names) for names in together)
    wanted = case["set_must_contain_one_of"]
    if wanted and headline != "nothing" and not set(wanted) & set(alike):
        right = False
    rejected = set(case["reject"])
    beside = [name for name in certain if name != headline and name in rejected]
    named_wrong = headline in rejected or ("any name" in rejected and headline != "nothing")
    return {
        "kind": case["kind"],
        "named": named,
        "set": alike,
        "certain": certain,
        "right": bool(right and not named_wrong and not beside),
        "rejected": bool(named_wrong),
        "beside": beside,
        "p_global": found["disagreement"]["p_global"],
    }


def searched(folder: Path, case: Mapping[str, Any]) -> dict[str, Any]:
    """Search one case as a user would, and score it."""
    import gaugeblock as gb

    began = time.process_time()
    found = gb.discover(
        folder / case["case"] / "source.pha",
        model=case["model"],
        band=tuple(case["band"]),
        redshift=case["redshift"] or 0.0,
        background=("none",) if case["background"] == "none" else (),
        seed=SEED,
        evidence=False,
        progress=False,
    )
    return {**scored(case, found.to_json()), "seconds": round(time.process_time() - began, 1)}


def run(folder: Path, names: Sequence[str], out: Path, work: Path, name: str) -> None:
    """Search every case once, one file each, and write them as one table."""
    try:
        listed = json.loads((folder / "cases.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{folder}/cases.json: cannot be read ({type(error).__name__})") from None
    chosen = [case for case in listed if not names or case["case"] in names]
    if not chosen:
        raise InputError(f"{folder}/cases.json: holds none of {', '.join(names)}")
    key = {"seed": SEED, "code": code_of(discovery, simulators)}
    with Bars() as bars:
        pieces = Pieces(work, key, name="measured", progress=bars.show)
        rows = pieces.made({case["case"]: partial(searched, folder, case) for case in chosen})
    command = "python -m studies.measured FOLDER" + ("" if name == "measured" else f" --name {name}")
    content = record(command, SEED) | {"cases": rows}
    content["versions"] = json.loads(content["versions"])
    write_atomically(made_folder(out) / f"{name}.json", json.dumps(content, indent=1) + "\n")
    sys.stdout.write(summary(rows) + "\n")


def shown(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """The cases as a table of docs/measured.md."""
    lines = [
        (
            name.split("_")[0],
            row["kind"],
            ", wrong beside it ".join(f"`{name}`" for name in (row["named"], *row["beside"]) if name)
            or "nothing",
            ", ".join(f"`{key}`" for key in row["set"][1:]) or "-",
            "yes" if row["right"] else "no",
            f"{row['seconds']:.0f}",
        )
        for name, row in rows.items()
    ]
    header = ("spectrum", "what it is", "first name", "not told from it", "right", "CPU s")
    return f"{table(header, lines)}\n\n{summary(rows)}."


def kept(out: Path) -> dict[str, dict[str, Any]]:
    """The cases of every file that is stored, by its name."""
    files = {name: out / f"{name}.json" for name in MARKERS}
    return {
        name: json.loads(file.read_text(encoding="utf-8"))["cases"]
        for name, file in files.items()
        if file.exists()
    }


def document(out: Path) -> None:
    """Fill the page from what is stored."""
    fill(PAGE, {MARKERS[name]: shown(rows) for name, rows in kept(out).items()})


def summary(rows: Mapping[str, Mapping[str, Any]]) -> str:
    """Right among strong cases and among controls, with exact 95% limits."""
    said = []
    for what, controls in (("strong cases", False), ("controls and weak cases", True)):
        mine = [row for row in rows.values() if (row["kind"] in CONTROLS) == controls]
        if mine:
            right = sum(row["right"] for row in mine)
            said.append(f"{what}: {counted(right, len(mine))} right")
    return "; ".join(said)


def main(arguments: Sequence[str]) -> int:
    """Run it."""
    parser = argparse.ArgumentParser(prog="python -m studies.measured", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", help="with cases.json")
    parser.add_argument("case", nargs="*", help="only these")
    parser.add_argument("--out", type=Path, default=RESULTS)
    parser.add_argument("--work", type=Path, help="finished cases, to go on from")
    parser.add_argument("--name", choices=MARKERS, default="measured", help="of the file in OUT")
    parser.add_argument("--page", action="store_true", help="only make the page of what is stored")
    given = parser.parse_args(arguments)
    if given.page:
        return carried_out(partial(document, given.out))
    if given.folder is None:
        parser.error("a folder with cases.json, or --page")
    work = given.work or given.out / "checkpoints"
    return carried_out(partial(run, given.folder, given.case, given.out, work, given.name))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
