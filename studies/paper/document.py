"""Results of full runs into the checkout, and docs/reproduction.md with its figures from them.

``python -m studies.paper.document [FOLDER ...]``: each folder is one that `gaugeblock reproduce`
wrote at full size. Without folders the page is made again from the results that are there.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

import xarray as xr

from gaugeblock.core.atomic import write_atomically
from gaugeblock.core.errors import InputError
from studies.paper import store
from studies.paper.experiment import Setting
from studies.paper.experiments import EXPERIMENTS, PAST
from studies.paper.figures import draw
from studies.paper.page import page
from studies.paper.run import from_committed

ROOM = Path(__file__).resolve().parent
DOCS = ROOM.parent / "docs"
PREFIX = "reproduction-"


def adopt(folder: Path, results: Path = ROOM / "results") -> list[str]:
    """Keep the tables of a full run as results of the package; returns their experiments.

    Raises
    ------
    InputError
        If there is no such run in the folder, or it was no full one.
    """
    path = folder / "reproduction.nc"
    try:
        with xr.open_datatree(path, engine="netcdf4") as stored:
            tables = {
                name: stored[name].to_dataset().load()
                for name in (*EXPERIMENTS, *PAST)
                if name in stored.children
            }
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({type(error).__name__})") from None
    for name, table in tables.items():
        if table.attrs.get("setting") != Setting.FULL.value:
            raise InputError(f"{path}: {name} is no full run; results of the package are")
        store.write_one(table, results / f"{name}.nc")
    return list(tables)


def document(docs: Path = DOCS) -> None:
    """Write the page and its figures from the results of the package."""
    result = from_committed(())
    figures = draw(result.tables, result.judgements, docs / "figures", prefix=PREFIX)
    content = page(result.tables, result.judgements, result.family, figures)
    write_atomically(docs / "reproduction.md", content)


def main(folders: Iterable[str]) -> None:
    """Adopt what the folders hold, then write the page."""
    for folder in folders:
        adopt(Path(folder))
    document()


if __name__ == "__main__":
    main(sys.argv[1:])
