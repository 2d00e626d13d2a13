"""``python -m studies gain``: a shift that no published check saw, in catalogues, beside three schemes."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import studies.gain
from gaugeblock import discovery, simulators
from gaugeblock.core.progress import Bars
from studies.gain.document import document
from studies.gain.pools import pools
from studies.gain.study import study
from studies.gain.table import CATALOGUES
from studies.kit.command import carried_out, given, parser
from studies.kit.results import record, write
from studies.kit.resume import Pieces, Progress, code_of

NAME = "studies gain"


def main(arguments: Sequence[str]) -> int:
    """Make the pools, read them, and keep the tables."""
    options = parser(NAME, __doc__)
    options.add_argument("--share", type=float, default=1.0, help="of every pool and catalogue")
    options.add_argument("--catalogues", type=int, default=CATALOGUES, help="effect-free ones, for each null")
    options.add_argument("--report", action="store_true", help="figure and text of OUT/gain.nc alone")
    chosen = options.parse_args(arguments)

    def work() -> None:
        if chosen.report:
            document(chosen.out / "gain.nc", chosen.docs)
            return
        folder = chosen.work or chosen.out / "checkpoints"
        with Bars() as bars:
            pieces = pieces_of(folder, chosen.seed, progress=bars.show, workers=chosen.workers)
            planned = pools(share=chosen.share)
            groups = study(planned, pieces, seed=chosen.seed, share=chosen.share, number=chosen.catalogues)
        attributes = record(given(NAME, arguments), chosen.seed, share=chosen.share)
        write(groups | {"": groups[""].assign_attrs(attributes)}, chosen.out / "gain.nc")

    return carried_out(work)


def pieces_of(folder: Path, seed: int, *, progress: Progress | None = None, workers: int = 1) -> Pieces:
    """Where the study keeps what is finished."""
    key = {"seed": seed, "code": code_of(discovery, simulators, studies.gain)}
    return Pieces(folder, key, name="gain", progress=progress, workers=workers)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
