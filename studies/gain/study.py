"""All tables of pools of spectra: catalogues and their null, profiles, schemes beside them, limits."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from functools import partial
from typing import Any

import xarray as xr

import studies.gain
from gaugeblock import discovery, simulators
from studies.gain.document import headline
from studies.gain.limits import limits
from studies.gain.pools import GainPool, scored
from studies.gain.schemes import compare
from studies.gain.table import CATALOGUES, cases, summary
from studies.gain.whole import as_dataset, marginalised, profiled
from studies.kit.resume import Pieces, Progress, code_of

PROFILED = 10
"""Catalogues of a case whose amplitude is profiled, where a pool has so many."""

NUMBER, PAIRS = 300, 100
"""Spectra, clean and shifted each, that every published scheme sees, and pairs for the evidence."""


def with_sizes(options: argparse.ArgumentParser) -> argparse.ArgumentParser:
    """The same options, and how large the study is."""
    options.add_argument("--share", type=float, default=1.0, help="of every pool and catalogue")
    options.add_argument("--catalogues", type=int, default=CATALOGUES, help="effect-free ones, for each null")
    return options


def pieces_of(name: str, seed: int, chosen: argparse.Namespace, progress: Progress, **more: Any) -> Pieces:
    """Where a study of the gain keeps what is finished; `more` decides its numbers too."""
    key = {"seed": str(seed), "code": code_of(discovery, simulators, studies.gain), **more}
    return Pieces(chosen.work or chosen.out / "checkpoints", key, name, progress, chosen.workers)


def study(
    planned: Mapping[str, GainPool],
    pieces: Pieces,
    *,
    seed: int,
    share: float = 1.0,
    number: int = CATALOGUES,
    profiles: int = PROFILED,
) -> dict[str, xr.Dataset]:
    """All tables by group, of cases that the pools have spectra for; at most so many `profiles` of each."""
    done = {name: scored(pool, pieces, seed=seed) for name, pool in planned.items()}
    chosen = [case for case in cases(share) if case.known(planned)]
    sums = summary(done, planned, chosen, number=number, seed=seed)
    count = max(20, round(NUMBER * min(1.0, share)))
    compared = partial(_compared, number=count, pairs=max(8, count * PAIRS // NUMBER), seed=seed)
    wanted, marginals, schemes = {}, {}, {}
    for case in chosen:
        hidden, clean = case.pool(planned), case.clean(planned)
        for k in range(min(profiles, max(1, hidden.number // case.size))):
            make = partial(profiled, hidden, case.hidden, case.size, seed, k)
            wanted[f"{case.label}, catalogue {k + 1}"] = make
        if hidden.marginal:
            marginals[case.label] = partial(marginalised, hidden, case.size, seed)
            marginals[f"{case.size} {case.level}, no gain"] = partial(marginalised, clean, case.size, seed)
        if not case.small:
            schemes[case.label] = partial(compared, clean, hidden)

    def made(kind: str, makers: Mapping[str, Any]) -> dict[str, Any]:
        found = pieces.made({f"{kind}, {label}": make for label, make in makers.items()}, kind=kind)
        return dict(zip(makers, found.values(), strict=True))

    tables = {label: xr.Dataset.from_dict(found) for label, found in made("schemes", schemes).items()}
    beside = xr.concat(tables.values(), dim="case").assign_coords(case=list(tables))
    return {
        "": sums,
        "profiles": as_dataset(made("profile", wanted)),
        "marginal": as_dataset(made("marginal", marginals)),
        "schemes": beside,
        "limits": limits(done["bright_clean"]),
        "headline": headline(sums, beside),
    }


def _compared(*pools: Any, **options: Any) -> dict[str, Any]:
    plain: dict[str, Any] = compare(*pools, **options).to_dict()
    return plain
