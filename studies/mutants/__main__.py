"""Whether tests notice small wrong changes to lines that compute, drawn from a commit's own digest."""

from __future__ import annotations

import sys
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError
from gaugeblock.core.progress import Bars
from studies.kit.command import carried_out, given, parser
from studies.kit.commit import committed
from studies.kit.results import STUDIES, read_groups, record, write
from studies.kit.resume import Arrays, Pieces
from studies.mutants.bench import bench, copied
from studies.mutants.document import UNNOTICED, document
from studies.mutants.places import Mutant, Tree, drawn, found_again
from studies.mutants.reached import aimed

NAME = "studies mutants"
HERE = Path(__file__).parent
DECIDES = ("operators.py", "places.py", "reached.py", "bench.py", "server.py")
TRACES = ("reached.py", "server.py", "traced/sitecustomize.py")


def equivalents(path: Path = HERE / "equivalents.toml") -> dict[tuple[str, str, str], str]:
    """Why a change makes no difference, by file, line and change."""
    rows = tomllib.loads(path.read_text(encoding="utf-8")).get("equivalent", [])
    return {(row["file"], row["before"], row["change"]): row["reason"] for row in rows}


def pieces(mutants: Sequence[Mutant], root: Path, commit: str, seconds: float) -> dict[str, Any]:
    """What makes each answer, by the mutant's name: a longer draw begins with the shorter one's."""
    return {name: partial(_judged, root, commit, mutant, seconds) for name, mutant in named(mutants).items()}


def named(mutants: Sequence[Mutant]) -> dict[str, Mutant]:
    """Mutants by a name that does not depend on how many there are."""
    seen: dict[str, int] = {}
    found = {}
    for mutant in mutants:
        place = seen[mutant.room] = seen.get(mutant.room, -1) + 1
        found[f"{mutant.room.split(',')[0]}-{place:04d}"] = mutant
    return found


def _judged(root: Path, commit: str, mutant: Mutant, seconds: float) -> dict[str, Any]:
    return bench(root, commit).judged(mutant, seconds)


def table(answers: Mapping[str, Mapping[str, Any]], mutants: Mapping[str, Mutant]) -> xr.Dataset:
    """A row a mutant that was run: where, what, whether it was noticed, and by which test."""
    known = equivalents()
    rows = []
    for name, said in answers.items():
        mutant = mutants[name]
        outcome = said["outcome"]
        if outcome != "noticed" and (mutant.file, mutant.before, mutant.after) in known:
            outcome = "equivalent"
        rows.append(
            {
                "room": mutant.room,
                "place": f"{mutant.file}:{mutant.mutation.line}",
                "operator": mutant.mutation.operator,
                "before": mutant.before,
                "change": mutant.after,
                "outcome": outcome,
                "by": said["by"],
            }
        )
    columns: dict[str, Any] = {
        key: ("mutant", np.array([row[key] for row in rows], dtype=str)) for key in (rows[0] if rows else {})
    }
    seconds = np.array([answers[name]["seconds"] for name in answers])
    return xr.Dataset({**columns, "seconds": ("mutant", seconds)}, coords={"mutant": list(answers)})


def main(arguments: Sequence[str]) -> int:
    """Draw, run what has not been run, print a line for each that survived, and keep the table."""
    options = parser(NAME, __doc__)
    options.add_argument("--number", type=int, default=400, help="mutants, equally many in each room")
    options.add_argument("--commit", default="HEAD", help="what is changed; its digest is part of the seed")
    options.add_argument(
        "--draw", default="first", help="name of this draw in the results, and part of the seed"
    )
    options.add_argument("--seconds", type=float, default=240, help="CPU seconds for the tests of one mutant")
    options.add_argument("--repository", type=Path, default=STUDIES.parent, help="another checkout")
    options.add_argument(
        "--again",
        action="store_true",
        help="what DRAW left unnoticed, by OUT's table, made in COMMIT once more",
    )
    options.add_argument("--list", action="store_true", help="the draw alone; nothing is run")
    options.add_argument("--so-far", action="store_true", help="what was run before; nothing else is")
    options.add_argument("--report", action="store_true", help="the page, from OUT; nothing is run")
    chosen = options.parse_args(arguments)
    if chosen.report:
        return carried_out(lambda: document(read_groups(chosen.out / "mutants.nc"), chosen.docs))
    # A table that was written before the run was over is of the same command.
    return carried_out(lambda: _run(chosen, given(NAME, [one for one in arguments if one != "--so-far"])))


def _run(chosen: Any, command: str) -> None:
    root = chosen.repository.resolve()
    commit = committed(root, chosen.commit)
    path = chosen.out / "mutants.nc"
    groups = read_groups(path) if path.exists() else {}
    left = _left(groups, chosen.draw) if chosen.again else []
    with tempfile.TemporaryDirectory() as folder:
        # From the commit's files, whatever the checkout looks like.
        tree = Tree(copied(root, commit, Path(folder) / "copy"))
        if chosen.again:
            mutants = named(found_again(tree, left))
        else:
            mutants = named(drawn(tree, chosen.number, chosen.seed, commit, chosen.draw))
        sources = {mutant.file: (tree.root / mutant.file).read_bytes() for mutant in mutants.values()}
        tests = {f"{file.replace('/', '.')}-{tree.text(file)[:12]}": file for file in tree.tests}
    if chosen.list:
        for name, mutant in mutants.items():
            sys.stdout.write(_line(name, mutant, " ".join(mutant.tests[0])))
        return
    settings = {"commit": commit, "draw": chosen.draw, "seconds": chosen.seconds}
    again = {"again": left} if chosen.again else {}
    key = {
        "seed": chosen.seed,
        **settings,
        **again,
        "code": [digest((HERE / name).read_text()) for name in DECIDES],
    }
    work = chosen.work or chosen.out / "checkpoints"
    with Bars() as bars:
        if not chosen.so_far:
            code = [digest((HERE / name).read_text()) for name in TRACES]
            traces = Pieces(work, {"code": code}, "traces", bars.show, chosen.workers)
            found = traces.made({name: partial(_traced, root, commit, file) for name, file in tests.items()})
            tables = {file: found[name] for name, file in tests.items()}
            mutants = {
                name: aimed(one, sources[one.file], tables, chosen.seconds) for name, one in mutants.items()
            }
        kept = Pieces(work, key, "mutants", bars.show, chosen.workers)
        wanted = pieces(list(mutants.values()), root, commit, chosen.seconds)
        made = kept.finished() if chosen.so_far else kept.made(wanted)
    answers = {name: made[name] for name in mutants if name in made}
    told = table(answers, mutants)
    for name in answers:
        if (outcome := str(told["outcome"].sel(mutant=name).values)) != "noticed":
            sys.stdout.write(_line(name, mutants[name], outcome))
    attributes = record(command, chosen.seed, drawn=len(mutants), **settings)
    if chosen.again:
        attributes["left"] = len(left)
    name = f"{chosen.draw} draw again" if chosen.again else chosen.draw
    write({**groups, name: told.assign_attrs(attributes)}, path)


def _traced(root: Path, commit: str, test: str) -> Arrays:
    """What a file of tests reaches; one that did not change is not traced again."""
    return bench(root, commit).traced(test)


def _left(groups: Mapping[str, xr.Dataset], draw: str) -> list[dict[str, str]]:
    """What a draw left unnoticed: the rows of its table."""
    if draw not in groups:
        there = ", ".join(filter(None, groups)) or "none"
        raise InputError(f"no draw {draw!r} in mutants.nc; it has {there}")
    table = groups[draw]
    rows = table.isel(mutant=np.isin(table["outcome"], UNNOTICED))
    columns = ("room", "place", "before", "change")
    return [
        dict(zip(columns, row, strict=True))
        for row in zip(*(rows[c].values.tolist() for c in columns), strict=True)
    ]


def _line(name: str, mutant: Mutant, says: str) -> str:
    where = f"{mutant.file}:{mutant.mutation.line}"
    return f"{name}  {where}  {mutant.mutation.operator}: {mutant.after}  [{mutant.before}]  {says}\n"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
