"""What the studies' commands have in common."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from gaugeblock.core.errors import GaugeblockError
from studies.kit.commit import ROOT, committed, seed_of
from studies.kit.results import DOCS, RESULTS, record

SEED = 20260611
PLACES = ("--folder", "--out", "--docs", "--work", "--repository")


def parser(name: str, says: str | None) -> argparse.ArgumentParser:
    """A parser with the options that every study has."""
    made = argparse.ArgumentParser(prog=f"python -m {name}", description=says)
    made.add_argument("--seed", type=int, default=SEED)
    made.add_argument("--workers", type=int, default=1, help="processes; results do not depend on it")
    made.add_argument("--out", type=Path, default=RESULTS, help="folder for the tables (NetCDF)")
    made.add_argument("--work", type=Path, help="folder for finished pieces; by default OUT/checkpoints")
    made.add_argument("--docs", type=Path, default=DOCS, help="folder with the page")
    return made


def of_a_commit(name: str, says: str | None, *, folder: str = "") -> argparse.ArgumentParser:
    """The same for a study whose cases are drawn from the commit that it measures; `folder` is its help."""
    made = parser(name, says)
    if folder:
        made.add_argument("folder", type=Path, nargs="?", help=folder)
    asks_for_a_commit(made)
    made.add_argument("--page", action="store_true", help="only make the page of what is stored")
    return made


def asks_for_a_commit(options: argparse.ArgumentParser) -> None:
    """The options that `drawn_from` and `seeded` read."""
    options.add_argument("--commit", default="HEAD", help="of the code that is measured: draws the cases")
    options.add_argument("--generator-seed", type=int, help="in place of the one that the commit gives")


def drawn_from(study: str, chosen: argparse.Namespace) -> tuple[str, int]:
    """The commit that is measured, and the seed that it gives, or that was given in its place."""
    commit, own = committed(ROOT, chosen.commit), chosen.generator_seed
    return commit, seed_of(study, commit) if own is None else own


def seeded(name: str, chosen: argparse.Namespace, command: str) -> tuple[int, dict[str, Any]]:
    """The seed of a study's cases, of its commit or as it was given, and what is kept beside its tables.

    `chosen` are options of `asks_for_a_commit`.
    """
    commit, seed = drawn_from(name, chosen)
    return seed, record(command, chosen.seed, commit=commit, generator_seed=str(seed))


def given_folder(name: str, arguments: Sequence[str], folder: Path | None) -> str:
    """`given`, with FOLDER where a folder was named without an option.

    >>> given_folder("studies nulls", ["here", "--each", "3"], Path("here"))
    'python -m studies nulls --each 3 FOLDER'
    """
    kept = [word for word in arguments if not folder or word != str(folder)]
    return given(name, [*kept, *(["FOLDER"] if folder else [])])


def given(name: str, arguments: Sequence[str]) -> str:
    """The command as it is kept with its results: which folders were used is nobody's concern.

    >>> given("studies.hidden", ["score", "--folder", "somewhere", "--out=there", "--so-far"])
    'python -m studies.hidden score --so-far'
    """
    kept, rest = [], iter(arguments)
    for argument in rest:
        option, _, value = argument.partition("=")
        if option not in PLACES:
            kept.append(argument)
        elif not value:
            next(rest, None)
    return shlex.join(["python", "-m", *name.split(), *kept])


def carried_out(work: Callable[[], object]) -> int:
    """Do it; input that cannot be used is one line and exit code 2."""
    try:
        work()
    except GaugeblockError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0
