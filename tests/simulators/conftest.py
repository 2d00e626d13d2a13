"""A writer of OGIP spectra, as users have them, and a small response."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture(scope="session")
def write_spectrum() -> Callable[..., Path]:
    """Write a type I spectrum of whole counts; keywords go into its header, `grouping` into a column."""
    fits = pytest.importorskip("astropy.io.fits")

    def write(path: Path, counts, exposure, *, first=0, grouping=None, quality=None, **header) -> Path:
        number = np.arange(first, first + len(counts))
        columns = [
            fits.Column("CHANNEL", "J", array=number),
            fits.Column("COUNTS", "J", array=np.asarray(counts)),
        ]
        for name, flags in (("GROUPING", grouping), ("QUALITY", quality)):
            if flags is not None:
                columns.append(fits.Column(name, "I", array=np.asarray(flags)))
        table = fits.BinTableHDU.from_columns(columns, name="SPECTRUM")
        known = {"EXPOSURE": exposure, "BACKSCAL": 1.0, "AREASCAL": 1.0, "DETCHANS": len(counts)}
        for key, value in {**known, **header}.items():
            table.header[key] = value
        fits.HDUList([fits.PrimaryHDU(), table]).writeto(path, overwrite=True)
        return path

    return write


@pytest.fixture
def rmf(tmp_path: Path) -> Path:
    """A matrix of six input bins and four channels."""
    pytest.importorskip("astropy")
    from tests.simulators.ogip_files import write_rmf

    return write_rmf(tmp_path / "r.rmf")


@pytest.fixture
def arf(tmp_path: Path) -> Path:
    """Its effective area."""
    pytest.importorskip("astropy")
    from tests.simulators.ogip_files import write_arf

    return write_arf(tmp_path / "a.arf")
