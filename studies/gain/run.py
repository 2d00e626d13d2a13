"""The gain study from a shell: ``python studies/gain/run.py``; ``--help`` says the rest."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    # Started as a file: not this folder but the one above its own has to be importable.
    sys.path[0] = str(Path(__file__).resolve().parents[2])

import xarray as xr

from gaugeblock.auditing.identity import versions
from gaugeblock.core.atomic import write_atomically
from gaugeblock.core.errors import GaugeblockError
from gaugeblock.core.progress import Bars
from gaugeblock.validate.storage import write_groups
from studies.gain.document import document, headline
from studies.gain.limits import limits
from studies.gain.plan import SEED, pools
from studies.gain.pools import scored
from studies.gain.schemes import compare
from studies.gain.table import CATALOGUES, cases, summary
from studies.gain.whole import as_dataset, marginalised, profiled

FOLDER = Path(__file__).resolve().parents[1]
RESULTS, DOCS = FOLDER / "results", FOLDER.parent / "docs"

PROFILED = 10
"""Catalogues of a case whose amplitude is profiled, where a pool has so many."""

NUMBER, PAIRS = 300, 100
"""Spectra, clean and shifted each, that every published scheme sees, and pairs for the evidence."""


def main(arguments: list[str] | None = None) -> int:
    """Make the pools, read them, and keep the tables."""
    parser = argparse.ArgumentParser(prog="python studies/gain/run.py", description=__doc__)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--share", type=float, default=1.0, help="of every pool and catalogue")
    parser.add_argument("--catalogues", type=int, default=CATALOGUES, help="effect-free ones, for each null")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder for gain.nc")
    parser.add_argument("--work", type=Path, help="folder for checkpoints; by default OUT/checkpoints/gain")
    parser.add_argument("--docs", type=Path, default=DOCS, help="folder with gain.md, for --report")
    parser.add_argument("--report", action="store_true", help="figure and text of OUT/gain.nc alone")
    chosen = parser.parse_args(arguments)
    try:
        if not chosen.report:
            command = shlex.join(["python", "studies/gain/run.py", *(arguments or sys.argv[1:])])
            groups = study(
                chosen.work or chosen.out / "checkpoints" / "gain",
                seed=chosen.seed,
                share=chosen.share,
                number=chosen.catalogues,
            )
            groups[""] = groups[""].assign_attrs(
                command=command, seed=chosen.seed, share=chosen.share, versions=json.dumps(versions())
            )
            write_groups(groups, chosen.out / "gain.nc")
        else:
            document(chosen.out / "gain.nc", chosen.docs)
    except GaugeblockError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


def study(work: Path, *, seed: int, share: float = 1.0, number: int = CATALOGUES) -> dict[str, xr.Dataset]:
    """All tables by group; what lies in `work` is not made again."""
    work.mkdir(parents=True, exist_ok=True)
    planned = pools(share=share)
    with Bars() as bars:
        done = {name: scored(pool, work, seed=seed, progress=bars.show) for name, pool in planned.items()}
        sums = summary(done, planned, share=share, number=number, seed=seed)
        profiles, marginals, schemes = {}, {}, {}
        wanted = cases(share)
        for place, case in enumerate(wanted):
            bars.show("whole catalogues", place, len(wanted))
            hidden, clean = case.pool(planned), case.clean(planned)
            for k in range(max(1, min(PROFILED, hidden.number // case.size))):
                profiles[f"{case.label}, catalogue {k + 1}"] = _kept(
                    work / f"profile_{hidden.name}_{case.size}_{k}.json",
                    partial(profiled, hidden, case.hidden, case.size, seed, k),
                )
            if hidden.marginal:
                for label, pool in ((case.label, hidden), (f"{case.size} {case.level}, no gain", clean)):
                    marginals[label] = _kept(
                        work / f"marginal_{pool.name}_{case.size}.json",
                        partial(marginalised, pool, case.size, seed),
                    )
            if not case.small:
                count = max(20, round(NUMBER * min(1.0, share)))
                path = work / f"schemes_{hidden.name}_{count}.nc"
                if not path.exists():
                    found = compare(
                        clean, hidden, number=count, pairs=max(8, count * PAIRS // NUMBER), seed=seed
                    )
                    write_groups({"": found}, path)
                with xr.open_dataset(path, engine="netcdf4") as stored:
                    schemes[case.label] = stored.load()
    beside = xr.concat(schemes.values(), dim="case").assign_coords(case=list(schemes))
    return {
        "": sums,
        "profiles": as_dataset(profiles),
        "marginal": as_dataset(marginals),
        "schemes": beside,
        "limits": limits(done[planned["bright_clean"].name]),
        "headline": headline(sums, beside),
    }


def _kept(path: Path, make: Callable[[], dict[str, float]]) -> dict[str, float]:
    """What a file holds, or else makes it; with the seconds of CPU it took."""
    if not path.exists():
        began = time.process_time()
        made = make()
        write_atomically(path, json.dumps(made | {"cpu_seconds": round(time.process_time() - began, 1)}))
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


if __name__ == "__main__":
    sys.exit(main())
