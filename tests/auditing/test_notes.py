"""What was left out or repaired when files were read is told where people look."""

import numpy as np
import pytest

pytest.importorskip("jaxspec")
pytest.importorskip("astropy")
from astropy.io import fits

from gaugeblock.auditing.discovering import discover
from gaugeblock.core.errors import InputError
from gaugeblock.simulators.protocol import HasNotes
from gaugeblock.simulators.xray import read_observation
from gaugeblock.simulators.xray.data import EXAMPLE, path

pytestmark = pytest.mark.usefixtures("xray_data")


@pytest.fixture(scope="module")
def files(xray_data, tmp_path_factory):
    """NGC 7793's spectrum with a response for 2 to 8 keV alone."""
    folder = tmp_path_factory.mktemp("cut")
    made = {
        "pha": path(EXAMPLE + "PN_spectrum_grp20.fits"),
        "behind": path(EXAMPLE + "PNbackground_spectrum.fits"),
    }
    made |= {"rmf": folder / "cut.rmf", "arf": path(EXAMPLE + "PN.arf")}
    with fits.open(path(EXAMPLE + "PN.rmf")) as file:
        rows = next(file[one] for one in ("MATRIX", "SPECRESP MATRIX") if one in file).data
        rows["N_GRP"][(rows["ENERG_LO"] < 2.0) | (rows["ENERG_HI"] > 8.0)] = 0
        file.writeto(made["rmf"])
    return made


def read(files, **further):
    asked = {"model": "powerlaw", "rmf": files["rmf"], "arf": files["arf"], "background": "none", **further}
    return read_observation(files["pha"], **asked)


def test_channels_that_no_photon_reaches_are_left_out(files):
    whole = read(files, rmf=path(EXAMPLE + "PN.rmf"), arf=path(EXAMPLE + "PN.arf"))
    cut = read(files)
    channels = cut.simulator.channels
    low, high = cut.simulator.response.energies[0, 0], cut.simulator.response.energies[-1, 1]
    assert (low, high) == (pytest.approx(2.0, abs=0.01), pytest.approx(8.0, abs=0.01))
    # Every channel that reaches into it stays, however little.
    kept = (whole.simulator.channels[:, 1] > low) & (whole.simulator.channels[:, 0] < high)
    np.testing.assert_array_equal(channels, whole.simulator.channels[kept])
    np.testing.assert_array_equal(cut.counts, whole.counts[:, kept])
    assert 10 < kept.sum() < len(kept) - 10
    (note,) = cut.simulator.notes
    assert note == (
        "no band was given: channels below 2.01 or above 7.99 keV, where the response ends, are left out"
    )


def test_energies_at_which_an_instrument_is_seldom_used_are_told(files, tmp_path):
    full = {"rmf": path(EXAMPLE + "PN.rmf"), "arf": path(EXAMPLE + "PN.arf")}
    (note,) = read(files, **full).simulator.notes
    assert note.startswith("no band was given: EPN is commonly used at 0.3 to 12 keV, and there are 0.")
    assert note.endswith("(--band 0.3 12 leaves it out)")
    assert read(files, **full, band=(0.3, 12.0)).simulator.notes == ()
    for instrument, told in (("NEW", False), ("FPMA", True)):  # NuSTAR's energies end far above these
        renamed = tmp_path / f"{instrument}.pha"
        with fits.open(files["pha"]) as file:
            file["SPECTRUM"].header["INSTRUME"] = instrument
            file.writeto(renamed)
        assert bool(read({**files, "pha": renamed}, **full).simulator.notes) == told


def test_a_band_that_is_given_is_the_band(files):
    cut = read(files, band=(1.0, 9.0))
    assert cut.simulator.channels.min() < 1.1
    assert cut.simulator.notes == ()


def test_whoever_stands_around_a_spectrum_tells_its_notes(files):
    (note,) = read(files).simulator.notes
    behind = read(files, background=files["behind"]).simulator
    assert isinstance(behind, HasNotes)
    assert behind.notes == (note,)
    both = read_observation(
        [files["pha"]] * 2, model="powerlaw", rmf=[files["rmf"]] * 2, arf=[files["arf"]] * 2,
        background="none", names=["one", "two"],
    ).simulator  # fmt: skip
    assert both.notes == (f"one: {note}", f"two: {note}")


def test_a_search_tells_them_in_its_record_and_in_the_terminal(files, tmp_path):
    from typer.testing import CliRunner

    from gaugeblock.cli import app

    (note,) = read(files).simulator.notes
    told = ["--rmf", files["rmf"], "--arf", files["arf"], "--background", "none", "--model", "powerlaw"]
    few = ["--effect", "emission_line", "--replicates", 399, "--out", tmp_path / "found"]
    ran = CliRunner().invoke(app, [str(one) for one in ("discover", files["pha"], *told, *few)])
    assert ran.exit_code == 0, ran.output
    assert f"note: {note}" in " ".join(ran.output.split())
    few[3] = 198
    ran = CliRunner().invoke(app, [str(one) for one in ("discover", files["pha"], *told, *few)])
    # Of which the entry point makes one line and exit code 2.
    assert isinstance(ran.exception, InputError)
    assert "needs at least 399 replicates, got 198" in str(ran.exception)
    found = discover(
        files["pha"], rmf=files["rmf"], arf=files["arf"], background=["none"], model="powerlaw",
        only=["emission_line"], replicates=399, progress=False,
    )  # fmt: skip
    assert found.provenance["notes"] == [note]
    assert note in found.remarks
