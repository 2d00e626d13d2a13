"""Gains of less than a per cent in catalogues of 2,000 bright spectra: by EPIC-pn, and by NICER.

    python -m studies gain-sweep          # two forms, four sizes, two responses
    python -m studies gain-sweep --page   # docs/gain.md of results/gain-sweep.nc; runs nothing

Spectra are simulated and fitted with bins integrated exactly; they are drawn from the digest of the commit
that is measured.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from functools import partial

import xarray as xr

from gaugeblock.core.progress import Bars
from studies.gain.models import Spectrum
from studies.gain.pools import TEMPLATES, GainPool, scored
from studies.gain.study import pieces_of, with_sizes
from studies.gain.table import CATALOGUES, GainCase, summary
from studies.kit.command import carried_out, given, of_a_commit, seeded
from studies.kit.page import fill, table
from studies.kit.results import measured_commit, read, write
from studies.kit.resume import Pieces

NAME = "studies gain-sweep"
RESPONSES = {"epic-pn": "EPIC-pn", "nicer": "NICER"}
SIZES = (0.001, 0.002, 0.003, 0.005)
CLEAN, SHIFTED = 4000, 2000
"""Spectra without a gain, and of every size; the latter are one catalogue."""


def pools(response: str, *, part: float = 1.0) -> dict[str, GainPool]:
    """All pools of a response by name; `part` makes them smaller."""
    spectrum = Spectrum("exact", response)
    clean, shifted = (max(2, round(number * part)) for number in (CLEAN, SHIFTED))
    made = [
        GainPool("bright", "", 0.0, clean, spectrum=spectrum, small=True),
        *(
            GainPool("bright", form, 1 + size, shifted, spectrum=spectrum, small=True)
            for form in TEMPLATES
            for size in SIZES
        ),
    ]
    return {pool.name: pool for pool in made}


def swept(
    response: str, pieces: Pieces, *, seed: int, part: float = 1.0, number: int = CATALOGUES
) -> xr.Dataset:
    """Table ``(case, statistic)`` of a response."""
    planned = pools(response, part=part)
    shifted = [pool for pool in planned.values() if pool.hidden]
    wanted = [GainCase("bright", pool.hidden, pool.value, pool.number) for pool in shifted]
    done = {name: scored(pool, pieces, seed=seed) for name, pool in planned.items()}
    return summary(done, planned, wanted, number=number, seed=seed)


BESIDE = {"alone": "z alone", "offset and area": "z beside offset and area"}


def shown(tables: Mapping[str, xr.Dataset]) -> str:
    """By response and gain: z of catalogues, and the amplitude of one step beside offset and area.

    Without a gain z is the mean of catalogues of the clean pool, with the error that its size leaves.
    """
    rows = []
    for response, words in RESPONSES.items():
        made = tables[response]
        for form in dict.fromkeys(map(_form, made["case"].values.tolist())):
            own = made.sel(case=[case for case in made["case"].values.tolist() if _form(case) == form])
            first = own.isel(case=0)
            error = float(first["null_mean_error"].max())
            clean = [f"{float(first['null_mean'].sel(statistic=s)):+.1f} ± {error:.1f}" for s in BESIDE]
            rows.append((words, form, "none", *clean, ""))
            for case in own["case"].values.tolist():
                here = own.sel(case=case)
                free = here.sel(statistic="offset and area")
                cells = [f"{float(here['z'].sel(statistic=s)):+.1f}" for s in BESIDE]
                step = f"{100 * float(free['amplitude']):+.2f} ± {100 * float(free['standard_error']):.2f}"
                rows.append((words, form, f"{100 * float(free['truth']):+.1f}", *cells, step))
    heads = ("response", "gain", "planted, %", *BESIDE.values(), "amplitude beside both, %")
    return f"{table(heads, rows)}\n\n{measured_commit(tables[''])}"


def _form(case: str) -> str:
    return case.split(", ")[1].rpartition(" ")[0]


def run(chosen: argparse.Namespace, command: str) -> None:
    """Simulate, score, and keep the tables."""
    seed, attributes = seeded("gain-sweep", chosen, command)
    tables: dict[str, xr.Dataset] = {}
    with Bars() as bars:
        for response in RESPONSES:
            pieces = pieces_of(f"gain-sweep-{response}", seed, chosen, bars.show)
            tables[response] = swept(response, pieces, seed=seed, part=chosen.share, number=chosen.catalogues)
    tables = {"": xr.Dataset(attrs=attributes), **tables}
    write(tables, chosen.out / "gain-sweep.nc")
    sys.stdout.write(shown(tables) + "\n")


def main(arguments: Sequence[str]) -> int:
    """Run it, or make the page of what is stored."""
    options = with_sizes(of_a_commit(NAME, __doc__))
    chosen = options.parse_args(arguments)
    if chosen.page:
        stored = {name: read(chosen.out / "gain-sweep.nc", name) for name in ("", *RESPONSES)}
        return carried_out(partial(fill, chosen.docs / "gain.md", {"sweep": shown(stored)}))
    return carried_out(partial(run, chosen, given(NAME, arguments)))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
