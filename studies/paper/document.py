"""Results of full runs into the checkout, and docs/reproduction.md with its figures from them.

``python -m studies.paper.document [FOLDER ...]``: each folder is one that `python -m studies.paper`
wrote at full size. Without folders the page is made again from the results that are there.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from gaugeblock.core.atomic import write_atomically
from gaugeblock.core.errors import InputError
from studies.kit.results import DOCS, read_groups, write
from studies.paper.experiment import Setting
from studies.paper.experiments import EXPERIMENTS, PAST
from studies.paper.figures import draw
from studies.paper.page import page
from studies.paper.run import from_committed

ROOM = Path(__file__).resolve().parent
PREFIX = "reproduction-"


def adopt(folder: Path, results: Path = ROOM / "results") -> list[str]:
    """Keep the tables of a full run as committed results; returns their experiments.

    Raises
    ------
    InputError
        If there is no such run in the folder, or it was no full one.
    """
    path = folder / "reproduction.nc"
    tables = {name: table for name, table in read_groups(path).items() if name in (*EXPERIMENTS, *PAST)}
    for name, table in tables.items():
        if table.attrs.get("setting") != Setting.FULL.value:
            raise InputError(f"{path}: {name} is no full run; what is committed is")
        write({"": table}, results / f"{name}.nc")
    return list(tables)


def document(docs: Path = DOCS) -> None:
    """Write the page and its figures from the committed results."""
    result = from_committed(())
    figures = draw(result.tables, result.judgements, docs / "figures", prefix=PREFIX)
    content = page(result.tables, result.judgements, result.families, figures)
    write_atomically(docs / "reproduction.md", content)


def main(folders: Iterable[str]) -> None:
    """Adopt what the folders hold, then write the page."""
    for folder in folders:
        adopt(Path(folder))
    document()


if __name__ == "__main__":
    main(sys.argv[1:])
