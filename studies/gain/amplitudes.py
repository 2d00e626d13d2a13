"""Whether profiled amplitudes hold: 90% intervals of a gain in 200 catalogues of their own spectra.

    python -m studies gain-amplitudes          # 50 catalogues of 100 bright spectra for each of four gains
    python -m studies gain-amplitudes --page   # docs/gain.md of results/gain-amplitudes.nc; runs nothing

Catalogues share no spectrum, with one another or with the rest of the study. Bins are integrated exactly:
with `jaxspec`'s rule the likelihood is jagged on the scale of a per cent. The spectra are drawn from the
digest of the commit that is measured.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial

import numpy as np
import xarray as xr
from scipy import stats

from gaugeblock.core.progress import Bars
from studies.gain.models import EXACT, GAINS
from studies.gain.pools import LARGE, GainPool
from studies.gain.study import pieces_of
from studies.gain.whole import profiled
from studies.kit.command import carried_out, given, of_a_commit, seeded
from studies.kit.page import counted, fill, table
from studies.kit.results import measured_commit, read, write
from studies.kit.resume import Pieces

NAME = "studies gain-amplitudes"
CATALOGUES, SOURCES = 50, 100
"""Of each gain, and spectra of each catalogue."""


def measured(seed: int, pieces: Pieces, *, catalogues: int, sources: int) -> xr.Dataset:
    """Amplitudes, intervals and errors ``(case, catalogue)``, less what changes nothing."""
    pools = [GainPool("bright", *case, catalogues * sources, spectrum=EXACT) for case in LARGE]
    wanted = {
        f"{pool.name}-{k:03d}": partial(profiled, pool, pool.hidden, sources, seed, k)
        for pool in pools
        for k in range(catalogues)
    }
    found = list(pieces.made(wanted).values())
    shape = (len(LARGE), catalogues)
    return xr.Dataset(
        {
            name: (("case", "catalogue"), np.array([one[name] for one in found]).reshape(shape))
            for name in found[0]
        },
        coords={"case": [_label(*case) for case in LARGE]},
    )


def _label(name: str, value: float) -> str:
    return f"{name.replace('_', ' ')} {100 * (value - GAINS[name].neutral):+.0f}%"


def shown(made: xr.Dataset) -> str:
    """By gain: the mean amplitude, its scatter in its own errors, and how many intervals hold the truth."""
    rows = []
    for case in made["case"].values.tolist():
        part = made.sel(case=case)
        off = (part["value"] - part["truth"]).values
        error = np.maximum(part["standard_error"], part["sandwich_error"]).values
        mean, of_mean = 100 * part["value"].values.mean(), 100 * stats.sem(off)
        rows.append((
            case, f"{mean:+.2f} ± {of_mean:.2f}", f"{100 * error.mean():.2f}",
            f"{(off / error).std(ddof=1):.2f}", _held(part),
        ))  # fmt: skip
    rows.append(("all", "", "", "", _held(made)))
    heads = ("gain", "mean amplitude, %", "error of one, %", "sd of pulls", "truth in the 90% interval")
    return f"{table(heads, rows)}\n\n{measured_commit(made)}"


def _held(part: xr.Dataset) -> str:
    inside = ((part["low"] < part["truth"]) & (part["truth"] < part["high"])).values
    return counted(int(inside.sum()), inside.size)


def run(chosen: argparse.Namespace, command: str) -> None:
    """Every catalogue once, a file each, and all of them as one table."""
    seed, attributes = seeded("gain-amplitudes", chosen, command)
    with Bars() as bars:
        pieces = pieces_of("gain-amplitudes", seed, chosen, bars.show, sources=chosen.sources)
        made = measured(seed, pieces, catalogues=chosen.catalogues, sources=chosen.sources)
    made = made.assign_attrs(attributes)
    write({"": made}, chosen.out / "gain-amplitudes.nc")
    sys.stdout.write(shown(made) + "\n")


def main(arguments: Sequence[str]) -> int:
    """Run it, or make the page of what is stored."""
    options = of_a_commit(NAME, __doc__)
    options.add_argument("--catalogues", type=int, default=CATALOGUES, help="of each gain")
    options.add_argument("--sources", type=int, default=SOURCES, help="in each catalogue")
    chosen = options.parse_args(arguments)
    if chosen.page:
        said = {"amplitudes": shown(read(chosen.out / "gain-amplitudes.nc"))}
        return carried_out(partial(fill, chosen.docs / "gain.md", said))
    return carried_out(partial(run, chosen, given(NAME, arguments)))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
