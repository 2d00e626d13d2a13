"""Small OGIP files: a matrix of six input bins and four channels, its area, a spectrum; good ones and bad."""

import numpy as np
from astropy.io import fits

BINS, CHANNELS = 6, 4
LOW = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5], dtype="f4")
MATRIX = np.array([[0.6, 0.4, 0.0, 0.0]] * 3 + [[0.0, 0.1, 0.5, 0.2]] * 3, dtype="f4")
AREA = np.array([0.0, 10.0, 20.0, 30.0, 40.0, 50.0], dtype="f4")


def column(name, form, array, unit=None):
    return fits.Column(name=name, format=form, array=array, unit=unit)


def matrix_table(matrix=MATRIX, low=LOW, first=0, hduclas3="REDIST", name="MATRIX", high=None):
    table = fits.BinTableHDU.from_columns(
        [
            column("ENERG_LO", "E", low, "keV"),
            column("ENERG_HI", "E", low + np.float32(0.5) if high is None else high, "keV"),
            column("N_GRP", "I", np.ones(len(low), int)),
            column("F_CHAN", "I", np.full(len(low), first)),
            column("N_CHAN", "I", np.full(len(low), CHANNELS)),
            column("MATRIX", f"{CHANNELS}E", matrix),
        ],
        name=name,
    )
    table.header["HDUCLAS3"] = hduclas3
    return table


def write_rmf(path, *, first=0, more=(), channel=None, **of_table):
    edges = np.arange(CHANNELS, dtype="f4")
    bounds = fits.BinTableHDU.from_columns(
        [
            column("CHANNEL", "I", np.arange(first, first + CHANNELS) if channel is None else channel),
            column("E_MIN", "E", edges, "keV"),
            column("E_MAX", "E", edges + 1, "keV"),
        ],
        name="EBOUNDS",
    )
    table = matrix_table(first=first, **of_table)
    table.header[f"TLMIN{table.columns.names.index('F_CHAN') + 1}"] = first
    fits.HDUList([fits.PrimaryHDU(), table, *more, bounds]).writeto(path, overwrite=True)
    return path


def write_arf(path, *, low=LOW, area=AREA):
    table = fits.BinTableHDU.from_columns(
        [
            column("ENERG_LO", "E", low, "keV"),
            column("ENERG_HI", "E", low + np.float32(0.5), "keV"),
            column("SPECRESP", "E", area, "cm**2"),
        ],
        name="SPECRESP",
    )
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(path, overwrite=True)
    return path


def write_pha(path, counts=(5, 6, 7, 8), *, first=0, columns=(), name="COUNTS", **header):
    usual = [
        column("CHANNEL", "I", np.arange(first, first + len(counts))),
        column(name, "J" if name == "COUNTS" else "E", np.asarray(counts)),
    ]
    # What is given replaces what is usual.
    table = fits.BinTableHDU.from_columns({c.name: c for c in (*usual, *columns)}.values(), name="SPECTRUM")
    for key, value in {"EXPOSURE": 100.0, **header}.items():
        if value is not None:
            table.header[key] = value
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(path, overwrite=True)
    return path
