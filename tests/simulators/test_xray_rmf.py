"""Redistribution matrices: units, damage, channels out of order, and the area that belongs to them."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError

pytest.importorskip("jaxspec")
from astropy.io import fits
from tests.simulators.ogip_files import AREA, LOW, MATRIX, matrix_table, write_arf, write_rmf

from gaugeblock.simulators.xray import Response
from gaugeblock.simulators.xray.rmf import read_rmf


@pytest.mark.parametrize(("unit", "cm2"), [("cm**2", 1.0), ("m^2", 1e4), ("mm2", 1e-2)])
def test_a_matrix_in_a_unit_of_area_includes_the_area(tmp_path, rmf, arf, unit, cm2):
    path = write_rmf(tmp_path / "full.rsp", matrix=MATRIX * AREA[:, None] / np.float32(cm2))
    with fits.open(path, mode="update") as hdus:
        hdus["MATRIX"].header["TUNIT6"] = unit
    assert read_rmf(path).full
    assert not read_rmf(rmf).full
    np.testing.assert_allclose(
        Response.from_ogip(path).transfer, Response.from_ogip(rmf, arf).transfer, rtol=1e-6
    )
    area = (AREA * MATRIX.sum(axis=1))[1:]
    np.testing.assert_allclose(Response.from_ogip(path).area, area, rtol=1e-6)


def test_blocks_with_and_without_the_area_are_not_added_up(tmp_path):
    path = write_rmf(tmp_path / "mixed.rsp", hduclas3="FULL", more=[matrix_table()])
    with pytest.raises(InputError, match="some of its MATRIX blocks include the effective area"):
        read_rmf(path)


@pytest.mark.parametrize(("unit", "keV"), [("eV", 1e-3), ("MeV", 1e3), (" kev ", 1.0)])
def test_energies_in_other_units_become_keV(tmp_path, rmf, unit, keV):
    expected = read_rmf(rmf)
    with fits.open(rmf, mode="update") as hdus:
        hdus["MATRIX"].header["TUNIT1"] = hdus["MATRIX"].header["TUNIT2"] = unit
        hdus["EBOUNDS"].header["TUNIT2"] = hdus["EBOUNDS"].header["TUNIT3"] = unit
    found = read_rmf(rmf)
    np.testing.assert_allclose(found.energies, keV * expected.energies, rtol=1e-12)
    np.testing.assert_allclose(found.fine_channels, keV * expected.fine_channels, rtol=1e-12)
    with fits.open(rmf, mode="update") as hdus:
        hdus["MATRIX"].header["TUNIT2"] = "Angstrom"
    with pytest.raises(InputError, match="ENERG_HI is in angstrom, which is no energy"):
        read_rmf(rmf)


def damaged(path, table, name, values):
    """The file with other values in one column."""
    with fits.open(path, mode="update") as hdus:
        hdus[table].data[name] = values
    return path


@pytest.mark.parametrize(
    ("table", "name", "values", "words"),
    [
        ("MATRIX", "N_GRP", [1, 1, 1, 1, 1, -1], r"N_GRP or N_CHAN is negative|N_GRP"),
        ("MATRIX", "N_CHAN", [4, 4, 4, 4, 4, -4], "N_CHAN|shorter"),
        ("MATRIX", "N_CHAN", [4, 4, 4, 4, 4, 5], "MATRIX has rows that are shorter"),
        ("MATRIX", "N_GRP", [1, 1, 1, 1, 1, 2], "F_CHAN has rows that are shorter"),
        ("MATRIX", "F_CHAN", [0, 0, 0, 1, 0, 0], "channels that EBOUNDS does not"),
        ("MATRIX", "ENERG_HI", LOW, "ENERG_LO and ENERG_HI are not finite, positive and ascending"),
        ("MATRIX", "ENERG_LO", -LOW, "ENERG_LO and ENERG_HI are not finite, positive and ascending"),
        ("EBOUNDS", "E_MAX", [1, 2, np.nan, 4], "E_MIN and E_MAX are not finite, positive and ascending"),
        ("EBOUNDS", "E_MAX", [1, 2, np.inf, 4], "E_MIN and E_MAX are not finite, positive and ascending"),
    ],
)
def test_a_damaged_matrix_says_what_is_damaged(rmf, table, name, values, words):
    with pytest.raises(InputError, match=words):
        read_rmf(damaged(rmf, table, name, values))


def test_channels_that_do_not_ascend_need_to_know_where_they_begin(tmp_path):
    path = write_rmf(tmp_path / "r.rmf", first=3, channel=[9, 8, 7, 6])
    assert read_rmf(path).channel.tolist() == [3, 4, 5, 6]
    with fits.open(path, mode="update") as hdus:
        del hdus["MATRIX"].header["TLMIN4"]
        hdus["EBOUNDS"].header["TLMIN1"] = 3
    assert read_rmf(path).channel.tolist() == [3, 4, 5, 6]
    with fits.open(path, mode="update") as hdus:
        del hdus["EBOUNDS"].header["TLMIN1"]
    with pytest.raises(InputError, match="nothing says where they begin"):
        read_rmf(path)
    # Nor do energies say it that fall once.
    path = write_rmf(tmp_path / "falls.rmf", first=3, channel=[9, 8, 7, 6])
    with fits.open(path, mode="update") as hdus:
        for name in ("E_MIN", "E_MAX"):
            hdus["EBOUNDS"].data[name] = hdus["EBOUNDS"].data[name][[0, 1, 3, 2]]
    with pytest.raises(InputError, match="channels that do not ascend"):
        read_rmf(path)


def test_an_area_belongs_to_bins_that_differ_by_less_than_a_twentieth(tmp_path, rmf):
    near = write_arf(tmp_path / "near.arf", low=LOW + np.float32(0.02))
    assert "up to 4.0e-02 of a bin" in Response.from_ogip(rmf, near).notes[0]
    with pytest.raises(InputError, match=r"differ by up to 0\.06 of a bin"):
        Response.from_ogip(rmf, write_arf(tmp_path / "far.arf", low=LOW + np.float32(0.03)))
