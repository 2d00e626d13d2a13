"""``python -m studies gain``: a shift that no published check saw, in catalogues, beside three schemes."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

import studies.gain
from gaugeblock import discovery, simulators
from gaugeblock.core.progress import Bars
from studies.gain.document import document, headline
from studies.gain.limits import limits
from studies.gain.pools import pools, scored
from studies.gain.schemes import compare
from studies.gain.table import CATALOGUES, cases, summary
from studies.gain.whole import as_dataset, marginalised, profiled
from studies.kit.command import carried_out, given, parser
from studies.kit.results import record, write
from studies.kit.resume import Pieces, Progress, code_of

NAME = "studies gain"

PROFILED = 10
"""Catalogues of a case whose amplitude is profiled, where a pool has so many."""

NUMBER, PAIRS = 300, 100
"""Spectra, clean and shifted each, that every published scheme sees, and pairs for the evidence."""


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
            groups = study(pieces, seed=chosen.seed, share=chosen.share, number=chosen.catalogues)
        attributes = record(given(NAME, arguments), chosen.seed, share=chosen.share)
        write(groups | {"": groups[""].assign_attrs(attributes)}, chosen.out / "gain.nc")

    return carried_out(work)


def pieces_of(folder: Path, seed: int, *, progress: Progress | None = None, workers: int = 1) -> Pieces:
    """Where the study keeps what is finished."""
    key = {"seed": seed, "code": code_of(discovery, simulators, studies.gain)}
    return Pieces(folder, key, name="gain", progress=progress, workers=workers)


def study(
    pieces: Pieces, *, seed: int, share: float = 1.0, number: int = CATALOGUES
) -> dict[str, xr.Dataset]:
    """All tables by group."""
    planned = pools(share=share)
    done = {name: scored(pool, pieces, seed=seed) for name, pool in planned.items()}
    sums = summary(done, planned, share=share, number=number, seed=seed)
    count = max(20, round(NUMBER * min(1.0, share)))
    compared = partial(_compared, number=count, pairs=max(8, count * PAIRS // NUMBER), seed=seed)
    profiles, marginals, schemes = {}, {}, {}
    for case in cases(share):
        hidden, clean = case.pool(planned), case.clean(planned)
        for k in range(max(1, min(PROFILED, hidden.number // case.size))):
            make = partial(profiled, hidden, case.hidden, case.size, seed, k)
            profiles[f"{case.label}, catalogue {k + 1}"] = make
        if hidden.marginal:
            marginals[case.label] = partial(marginalised, hidden, case.size, seed)
            marginals[f"{case.size} {case.level}, no gain"] = partial(marginalised, clean, case.size, seed)
        if not case.small:
            schemes[case.label] = partial(compared, clean, hidden)

    def made(kind: str, wanted: Mapping[str, Any]) -> dict[str, Any]:
        found = pieces.made({f"{kind}, {label}": make for label, make in wanted.items()}, kind=kind)
        return dict(zip(wanted, found.values(), strict=True))

    tables = {label: xr.Dataset.from_dict(found) for label, found in made("schemes", schemes).items()}
    beside = xr.concat(tables.values(), dim="case").assign_coords(case=list(tables))
    return {
        "": sums,
        "profiles": as_dataset(made("profile", profiles)),
        "marginal": as_dataset(made("marginal", marginals)),
        "schemes": beside,
        "limits": limits(done[planned["bright_clean"].name]),
        "headline": headline(sums, beside),
    }


def _compared(*pools: Any, **options: Any) -> dict[str, Any]:
    plain: dict[str, Any] = compare(*pools, **options).to_dict()
    return plain


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
