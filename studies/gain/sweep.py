"""Gains of less than a per cent in catalogues of 2,000 bright spectra: by EPIC-pn, and by NICER.

    python -m studies gain-sweep                # two forms, four sizes, two responses
    python -m studies gain-sweep --background   # by EPIC-pn, with the background in the model
    python -m studies gain-sweep --page         # docs/gain.md of the tables that are stored; runs nothing

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
from studies.gain.behind import WithRegion
from studies.gain.models import Spectrum
from studies.gain.pools import TEMPLATES, GainPool, scored
from studies.gain.study import pieces_of, with_sizes
from studies.gain.table import CATALOGUES, GainCase, summary
from studies.kit.command import carried_out, given, of_a_commit, seeded
from studies.kit.page import fill, table
from studies.kit.results import measured_commit, read_groups, write
from studies.kit.resume import Pieces

NAME = "studies gain-sweep"
SPECTRA: Mapping[str, Mapping[str, Spectrum]] = {
    "gain-sweep": {name: Spectrum("exact", name) for name in ("epic-pn", "nicer")},
    "gain-background": {"epic-pn-background": WithRegion()},
}
"""Of which spectra a file of results has tables."""

MARKERS = {"gain-sweep": "sweep", "gain-background": "background"}
"""Where they stand on the page."""

WORDS = {"epic-pn": "EPIC-pn", "nicer": "NICER", "epic-pn-background": "EPIC-pn, background"}
SIZES = (0.001, 0.002, 0.003, 0.005)
CLEAN, SHIFTED = 4000, 2000
"""Spectra without a gain, and of every size; the latter are one catalogue."""


def pools(spectrum: Spectrum, *, part: float = 1.0) -> dict[str, GainPool]:
    """All pools of such spectra by name; `part` makes them smaller."""
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
    spectrum: Spectrum, pieces: Pieces, *, seed: int, part: float = 1.0, number: int = CATALOGUES
) -> xr.Dataset:
    """Table ``(case, statistic)`` of such spectra."""
    planned = pools(spectrum, part=part)
    shifted = [pool for pool in planned.values() if pool.hidden]
    wanted = [GainCase("bright", pool.hidden, pool.value, pool.number) for pool in shifted]
    done = {name: scored(pool, pieces, seed=seed) for name, pool in planned.items()}
    return summary(done, planned, wanted, number=number, seed=seed)


BESIDE = {"alone": "z alone", "offset and area": "z beside offset and area"}


def shown(tables: Mapping[str, xr.Dataset]) -> str:
    """By spectra and gain: z of catalogues, and the amplitude of one step beside offset and area.

    Without a gain z is the mean of catalogues of the clean pool, with the error that its size leaves.
    """
    rows = []
    for name in (name for name in WORDS if name in tables):
        words, made = WORDS[name], tables[name]
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
    heads = ("spectra", "gain", "planted, %", *BESIDE.values(), "amplitude beside both, %")
    return f"{table(heads, rows)}\n\n{measured_commit(tables[''])}"


def _form(case: str) -> str:
    return case.split(", ")[1].rpartition(" ")[0]


def run(chosen: argparse.Namespace, command: str) -> None:
    """Simulate, score, and keep the tables."""
    name = "gain-background" if chosen.background else "gain-sweep"
    seed, attributes = seeded(name, chosen, command)
    tables: dict[str, xr.Dataset] = {}
    with Bars() as bars:
        for label, spectrum in SPECTRA[name].items():
            pieces = pieces_of(f"gain-sweep-{label}", seed, chosen, bars.show)
            tables[label] = swept(spectrum, pieces, seed=seed, part=chosen.share, number=chosen.catalogues)
    tables = {"": xr.Dataset(attrs=attributes), **tables}
    write(tables, chosen.out / f"{name}.nc")
    sys.stdout.write(shown(tables) + "\n")


def page(chosen: argparse.Namespace) -> None:
    """Make the page of what is stored."""
    files = {mark: chosen.out / f"{name}.nc" for name, mark in MARKERS.items()}
    found = {mark: shown(read_groups(file)) for mark, file in files.items() if file.exists()}
    fill(chosen.docs / "gain.md", found)


def main(arguments: Sequence[str]) -> int:
    """Run it, or make the page of what is stored."""
    options = with_sizes(of_a_commit(NAME, __doc__))
    options.add_argument("--background", action="store_true", help="spectra with a background in the model")
    chosen = options.parse_args(arguments)
    work = partial(page, chosen) if chosen.page else partial(run, chosen, given(NAME, arguments))
    return carried_out(work)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
