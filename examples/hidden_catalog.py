"""Make a catalogue of EPIC-pn spectra with a hidden gain shift, for `gaugeblock discover --catalog` to find.

    python examples/hidden_catalog.py my-catalog --number 200 --slope 1.03
    gaugeblock discover --catalog my-catalog --model "tbabs*(powerlaw+bbodyrad)" --band 0.5 8.0

The spectra are drawn from the reference prior at the bright level; with ``--slope 1`` there is nothing to
find. ``--number 1`` makes one spectrum, long enough to find the shift in it alone.
"""

import argparse
import csv
import shutil
import sys
from pathlib import Path

import numpy as np
from astropy.io import fits

from gaugeblock.simulators import Effect
from gaugeblock.simulators.xray import Response, XraySpectrum, reference, write_pha
from gaugeblock.simulators.xray import data as xray_data


def make(folder, *, number, slope, exposure, seed):
    """Write `number` spectra, their response and catalog.csv into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    files = {role: xray_data.path(xray_data.EXAMPLE + f"PN.{role}") for role in ("rmf", "arf")}
    for role, file in files.items():
        shutil.copy(file, folder / f"pn.{role}")
    grouped = fits.getdata(xray_data.path(xray_data.EXAMPLE + "PN_spectrum_grp20.fits"), "SPECTRUM")
    plain = reference("epic-pn", "bright")
    response = Response.from_ogip(files["rmf"], files["arf"], exposure=exposure)
    simulator = XraySpectrum(plain.model, response, plain.prior, integration="exact")
    if slope != 1.0:
        simulator = simulator.with_effect(Effect("gain_slope", {"slope": slope}))
    rng = np.random.default_rng(seed)
    counts = simulator.simulate(plain.prior.sample(number, rng), rng)
    rows = []
    for i, row in enumerate(counts):
        name = f"source{i + 1:04d}.pha"
        write_pha(
            folder / name, row, exposure, rmf="pn.rmf", arf="pn.arf", grouping=np.asarray(grouped["GROUPING"])
        )
        rows.append((name, 0.0))
    with open(folder / "catalog.csv", "w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([("pha", "redshift"), *rows])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--number", type=int, default=200)
    parser.add_argument("--slope", type=float, default=1.03)
    parser.add_argument("--exposure", type=float, default=3534.0, help="seconds; 3534 is the bright level")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    make(given.folder, number=given.number, slope=given.slope, exposure=given.exposure, seed=given.seed)
    sys.stdout.write(f"{given.number} spectra with a gain of {given.slope}: {given.folder}\n")
