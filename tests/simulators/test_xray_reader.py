"""What readers of many spectra group, share and tell."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError

pytest.importorskip("jaxspec")
from astropy.io import fits
from tests.simulators.ogip_files import column, write_pha, write_rmf

from gaugeblock.simulators.xray.reader import Reader


def written(folder, name, counts=(5, 6, 7, 8), **header):
    return write_pha(folder / name, counts, RESPFILE="r.rmf", ANCRFILE="a.arf", **header)


def test_spectra_of_one_response_and_one_grouping_have_one_identity(tmp_path, rmf, arf):
    reader = Reader()

    def identity(**changed):
        return reader.read(written(tmp_path, "s.pha", **changed)).identity

    usual = identity()
    assert identity(counts=(1, 2, 3, 4)) == identity(EXPOSURE=7.0) == identity(BACKSCAL=2.0) == usual
    others = [
        identity(columns=[column("QUALITY", "I", [0, 0, 0, 1])]),
        identity(columns=[column("GROUPING", "I", [1, -1, 1, 1])]),
        identity(AREASCAL=0.5),
        identity(FRMTIME=73.4),
        identity(counts=(1, 2, 3), DETCHANS=4),
    ]
    assert len({usual, *others}) == 6
    # What is asked of the reader is the same for all that it reads, but where it groups.
    again = Reader(regroup="always").read(written(tmp_path, "s.pha"))
    assert again.identity not in {usual, *others}
    # It groups whatever groups there were.
    flags = [column("GROUPING", "I", [1, -1, 1, 1])]
    own = Reader(regroup="always").read(written(tmp_path, "s.pha", columns=flags))
    assert own.identity == again.identity


def test_readers_group_what_they_are_told_to(tmp_path, rmf, arf):
    flags = [column("GROUPING", "I", [1, -1, -1, 1])]
    plain, own = written(tmp_path, "p.pha"), written(tmp_path, "o.pha", columns=flags)

    def groups(regroup, path):
        return len(Reader(regroup=regroup).read(path).spectrum.counts)

    assert [groups(regroup, own) for regroup in ("never", "ungrouped", "always")] == [2, 2, 4]
    assert groups("ungrouped", plain) == groups("always", plain) == 4
    with pytest.raises(InputError, match="must be never, ungrouped or always, got 'often'"):
        Reader(regroup="often")


def test_a_background_is_weighed_in_every_group_by_its_channels(tmp_path, rmf, arf):
    back = column("BACKSCAL", "E", [1, 2, 4, 8])
    write_pha(tmp_path / "b.pha", (3, 1, 4, 1), EXPOSURE=50.0, columns=[back], AREASCAL=2.0)
    flags = [column("GROUPING", "I", [1, -1, 1, -1]), column("QUALITY", "I", [0, 0, 0, 2])]
    pha = written(tmp_path, "s.pha", columns=flags, BACKSCAL=3.0, AREASCAL=0.5)
    spectrum = Reader().read(pha, background=tmp_path / "b.pha").spectrum
    assert spectrum.counts.tolist() == [11, 7]
    assert spectrum.background.tolist() == [4, 4]
    # 100 s * 3 * 0.5 over 50 s * BACKSCAL * 2, and the mean of it over the channels that count.
    each = 150.0 / (100.0 * np.array([1.0, 2.0, 4.0]))
    np.testing.assert_allclose(spectrum.background_scale, [each[:2].mean(), each[2]])
    write_pha(tmp_path / "c.pha", (3, 1, 4))
    with pytest.raises(InputError, match=r"c\.pha: has other channels than the spectrum"):
        Reader().read(pha, background=tmp_path / "c.pha")


def test_an_exposure_of_ones_own_is_the_responses(tmp_path, rmf, arf):
    pha = written(tmp_path, "s.pha", INSTRUME=" EPN ")
    reading = Reader().read(pha, exposure=8.0)
    assert reading.spectrum.exposure == 8.0
    assert reading.instrument == "EPN"
    assert reading.spectrum.response.name == "s.pha"
    assert Reader().read(written(tmp_path, "t.pha")).instrument == ""


@pytest.mark.parametrize(
    ("instrument", "told"),
    [("FPMA", "is commonly used at 3 to 79 keV, and there are 0 to 3"), ("XYZ", None), ("xti", "0.3 to 12")],
)
def test_channels_beyond_all_photons_are_left_out_and_odd_energies_told(tmp_path, rmf, arf, instrument, told):
    # Photons end at 3 keV; the fourth channel, from there on, sees none of them.
    pha = written(tmp_path, "s.pha", INSTRUME=instrument)
    response = Reader(reached=True).read(pha).spectrum.response
    assert response.channels.tolist() == [[0.0, 1.0], [1.0, 2.0], [2.0, 3.0]]
    assert "channels below 0.5 or above 3 keV, where the response ends" in response.notes[0]
    assert [told in note for note in response.notes[1:]] == ([True] if told else [])
    assert len(Reader().read(pha).spectrum.counts) == 4
    band = Reader(reached=True, band=(0.0, 4.0)).read(pha).spectrum.response
    assert (len(band.channels), band.notes) == (4, ())


@pytest.mark.parametrize(
    ("lowest", "highest", "told"), [(0.28, 13.0, False), (0.26, 13.0, True), (0.28, 13.4, True)]
)
def test_a_tenth_beyond_the_usual_energies_is_not_worth_telling(tmp_path, lowest, highest, told):
    # Photons of 4 to 16 keV: what ends where they begin sees none of them.
    low = np.array([4.0, 6.0, 8.0, 10.0, 12.0, 14.0], dtype="f4")
    path = write_rmf(tmp_path / "r.rmf", low=low, high=low + np.float32(2.0), hduclas3="FULL")
    pha = write_pha(tmp_path / "s.pha", RESPFILE="r.rmf", INSTRUME="EPN")
    for edges, kept in (([lowest, 5.0, 8.0, 12.0, highest], 4), ([1.0, 4.0, 8.0, 12.0, highest], 3)):
        with fits.open(path, mode="update") as hdus:
            hdus["EBOUNDS"].data["E_MIN"], hdus["EBOUNDS"].data["E_MAX"] = edges[:-1], edges[1:]
        response = Reader(reached=True).read(pha).spectrum.response
        assert len(response.channels) == kept
        cut, usual = (
            [word in note for note in response.notes].count(True)
            for word in ("channels below 4 or above 16 keV", "EPN is commonly used at 0.3 to 12 keV")
        )
        assert cut == (kept == 3)
        assert usual == (told if kept == 4 else highest > 13.2)
