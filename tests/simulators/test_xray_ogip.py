"""OGIP files: good ones are read, odd ones mended, broken ones explained in one line that names the file."""

import gzip
import shutil

import numpy as np
import pytest

from gaugeblock.core.errors import InputError

pytest.importorskip("jaxspec")
from astropy.io import fits
from tests.simulators.ogip_files import (
    AREA,
    LOW,
    MATRIX,
    column,
    matrix_table,
    write_arf,
    write_pha,
    write_rmf,
)

from gaugeblock.simulators.xray import Response, Spectrum, writing
from gaugeblock.simulators.xray.pha import load_pha
from gaugeblock.simulators.xray.reader import Reader
from gaugeblock.simulators.xray.rmf import read_rmf


def test_transfer_is_grouping_times_redistribution_times_area_times_exposure(tmp_path, rmf, arf):
    flags = [column("GROUPING", "I", [1, -1, 0, 1]), column("QUALITY", "I", [0, 0, 0, 5])]
    pha = write_pha(tmp_path / "s.pha", columns=flags, AREASCAL=0.5)
    response = Response.from_ogip(rmf, arf, pha)
    assert response.channels.tolist() == [[0.0, 2.0], [2.0, 3.0]]
    # The first bin starts at 0 keV, where a power law does not exist: it is left out.
    assert response.energies[:, 0].tolist() == LOW[1:].tolist()
    grouped = np.stack([MATRIX[:, 0] + MATRIX[:, 1], MATRIX[:, 2]])
    np.testing.assert_allclose(response.transfer, 0.5 * (grouped * AREA * 100.0)[:, 1:], rtol=1e-6)
    assert response.exposure == 100.0
    assert set(response.files) == {"rmf", "arf", "pha"}


def test_a_band_keeps_channels_wholly_inside(rmf, arf):
    response = Response.from_ogip(rmf, arf, band=(0.5, 3.5), exposure=7.0)
    assert response.channels.tolist() == [[1.0, 2.0], [2.0, 3.0]]
    assert response.fold(response.grouping).shape == (2, 5)
    assert response.with_exposure(14.0).transfer == pytest.approx(2 * response.transfer)


def test_grouping_can_be_given(rmf, arf):
    response = Response.from_ogip(rmf, arf, grouping=[1, -1, -1, 1])
    assert response.channels.tolist() == [[0.0, 3.0], [3.0, 4.0]]
    for wrong in ([1, 1, 1], [-1, 1, 1, 1], [1, 2, 1, 1]):
        with pytest.raises(InputError, match="one flag per detector channel"):
            Response.from_ogip(rmf, arf, grouping=wrong)


def test_describe_tells_responses_apart(tmp_path, rmf, arf):
    descriptions = [
        Response.from_ogip(rmf, arf).describe(),
        Response.from_ogip(rmf, arf, grouping=[1, -1, 1, 1]).describe(),
        Response.from_ogip(rmf, arf, band=(1, 4)).describe(),
        Response.from_ogip(rmf, arf, exposure=3.0).describe(),
        Response.from_ogip(rmf, write_arf(tmp_path / "b.arf", area=2 * AREA)).describe(),
    ]
    assert all(a != b for i, a in enumerate(descriptions) for b in descriptions[:i])
    assert Response.from_ogip(rmf, arf).describe() == descriptions[0]
    told = {"name": "r.rmf", "channels": 3, "band_kev": [1.0, 4.0], "exposure_s": 1.0}
    assert told.items() <= descriptions[2].items()
    assert Response.from_ogip(rmf, arf, name="ours").describe()["name"] == "ours"


def test_gzipped_files_are_the_same_files(tmp_path, rmf, arf):
    packed = tmp_path / "r.rmf.gz"
    with open(rmf, "rb") as source, gzip.open(packed, "wb") as target:
        shutil.copyfileobj(source, target)
    assert np.array_equal(Response.from_ogip(packed, arf).transfer, Response.from_ogip(rmf, arf).transfer)


def test_a_spectrum_finds_the_files_that_its_header_names(tmp_path, rmf, arf):
    write_pha(tmp_path / "b.pha", (10, 0, 0, 4), EXPOSURE=200.0, BACKSCAL=3.0)
    pha = write_pha(tmp_path / "s.pha", RESPFILE="r.rmf", ANCRFILE="a.arf", BACKFILE="b.pha", BACKSCAL=6.0)
    spectrum = Spectrum.from_ogip(pha, band=(0.0, 3.0))
    assert spectrum.counts.tolist() == [5, 6, 7]
    assert spectrum.background.tolist() == [10, 0, 0]
    assert spectrum.background_scale.tolist() == [1.0, 1.0, 1.0]  # 100 s * 6 against 200 s * 3
    assert spectrum.exposure == 100.0
    assert set(spectrum.response.files) == {"rmf", "arf", "pha", "background"}
    assert Spectrum.from_ogip(pha, background="none").background is None
    write_pha(tmp_path / "w.pha", (10.505, 0, 0, 4), name="RATE")
    with pytest.raises(
        InputError, match=r"^background .*w\.pha: .*whole.*; background 'none' does without it$"
    ):
        Spectrum.from_ogip(pha, background=tmp_path / "w.pha")
    with open(rmf, "rb") as source, gzip.open(tmp_path / "r.rmf.gz", "wb") as target:
        shutil.copyfileobj(source, target)
    rmf.unlink()
    assert Spectrum.from_ogip(pha).counts.tolist() == [5, 6, 7, 8]
    (tmp_path / "b.pha").unlink()
    with pytest.raises(InputError, match=r"BACKFILE is b\.pha, which is not beside it"):
        Spectrum.from_ogip(pha)


def test_what_is_written_is_read_again(tmp_path, rmf, arf):
    behind = writing.write_pha(
        tmp_path / "b.pha", [1, 2, 3, 4], 50.0, rmf="r.rmf", first_channel=0, BACKSCAL=4.0, CHANTYPE="PHA"
    )
    flags = np.array([1, -1, 1, 1])
    path = writing.write_pha(
        tmp_path / "s.pha", [5, 6, 7, 8], 100.0, rmf="r.rmf", arf="a.arf", background="b.pha",
        grouping=flags, FRMTIME=73.4,
    )  # fmt: skip
    assert path == tmp_path / "s.pha"
    spectrum = Spectrum.from_ogip(path)
    assert spectrum.counts.tolist() == [11, 7, 8]
    assert spectrum.background.tolist() == [3, 3, 4]
    assert spectrum.background_scale.tolist() == [0.5, 0.5, 0.5]  # 100 s * 1 against 50 s * 4
    assert spectrum.exposure == 100.0
    assert spectrum.response.frame_time == pytest.approx(0.0734)
    head = fits.getheader(behind, "SPECTRUM")
    assert [head[key] for key in ("ANCRFILE", "BACKFILE", "DETCHANS", "CHANTYPE")] == [
        "none",
        "none",
        4,
        "PHA",
    ]
    assert load_pha("PHA", behind).grouping is None
    later = writing.write_pha(tmp_path / "l.pha", [5.0, 6.0], 1.0, rmf="r.rmf", first_channel=3)
    assert fits.getdata(later, "SPECTRUM")["CHANNEL"].tolist() == [3, 4]
    for wrong in ([[1, 2]], [1.5, 2.0], [-1, 2]):
        with pytest.raises(InputError, match=r"w\.pha: counts must be whole numbers"):
            writing.write_pha(tmp_path / "w.pha", wrong, 1.0, rmf="r.rmf")


def test_what_astropy_remarks_of_a_header_concerns_nobody(tmp_path, rmf, arf):
    pha = write_pha(tmp_path / "s.pha")
    with fits.open(pha, mode="update") as hdus:
        hdus["SPECTRUM"].header["TDISP2"] = "nonsense"
    with pytest.warns(UserWarning, match="TDISP"):
        fits.getdata(pha, "SPECTRUM")
    assert Spectrum.from_ogip(pha, rmf, arf).counts.tolist() == [5, 6, 7, 8]


def test_a_bad_channel_of_a_group_takes_no_part(tmp_path, rmf, arf):
    flags = [column("GROUPING", "I", [1, -1, 1, -1]), column("QUALITY", "I", [0, 1, 0, 0])]
    response = Response.from_ogip(rmf, arf, write_pha(tmp_path / "s.pha", columns=flags))
    np.testing.assert_allclose(
        response.transfer, (np.stack([MATRIX[:, 0], MATRIX[:, 2] + MATRIX[:, 3]]) * AREA * 100.0)[:, 1:]
    )
    assert response.channels.tolist() == [[0.0, 1.0], [2.0, 4.0]]


def test_a_group_without_a_good_channel_vanishes(tmp_path, rmf, arf):
    flags = [column("GROUPING", "I", [1, -1, 1, -1]), column("QUALITY", "I", [1, 1, 0, 0])]
    spectrum = Spectrum.from_ogip(write_pha(tmp_path / "s.pha", columns=flags), rmf, arf)
    assert spectrum.counts.tolist() == [15]
    assert spectrum.response.channels.tolist() == [[2.0, 4.0]]


def test_edges_that_differ_in_the_last_digit_are_mended_and_noted(tmp_path, rmf):
    low = LOW.copy()
    low[0] = 1e-4
    response = Response.from_ogip(rmf, write_arf(tmp_path / "odd.arf", low=low))
    assert response.energies[:, 0].tolist() == LOW[1:].tolist()
    assert "the RMF's are used" in response.notes[0]
    assert Response.from_ogip(rmf, write_arf(tmp_path / "good.arf")).notes == ()


def test_an_area_in_other_units_is_converted_and_a_negative_one_refused(tmp_path, rmf, arf):
    expected = Response.from_ogip(rmf, arf).transfer
    for unit, factor in (("m**2", 1e4), ("cm^2", 1.0), (None, 1.0), ("mm2", 1e-2)):
        with fits.open(arf, mode="update") as hdus:
            hdus["SPECRESP"].header["TUNIT3"] = unit or ""
        np.testing.assert_allclose(Response.from_ogip(rmf, arf).transfer, factor * expected, rtol=1e-12)
    for unit, says in (("furlong", "furlong"), ("keV", "convertible")):
        with fits.open(arf, mode="update") as hdus:
            hdus["SPECRESP"].header["TUNIT3"] = unit
        with pytest.raises(InputError, match=rf"ARF .*cannot be read .*{says}"):
            Response.from_ogip(rmf, arf)
    with pytest.raises(InputError, match=r"b\.arf: holds areas that are negative"):
        Response.from_ogip(rmf, write_arf(tmp_path / "b.arf", area=-AREA))


def test_edges_in_other_units_are_converted(tmp_path, rmf, arf):
    with fits.open(arf, mode="update") as hdus:
        for name in ("ENERG_LO", "ENERG_HI"):
            hdus["SPECRESP"].data[name] *= 1e3
    with fits.open(arf, mode="update") as hdus:
        hdus["SPECRESP"].header["TUNIT1"] = hdus["SPECRESP"].header["TUNIT2"] = "eV"
    np.testing.assert_allclose(Response.from_ogip(rmf, arf).area, AREA[1:], rtol=1e-6)
    with fits.open(arf, mode="update") as hdus:
        del hdus["SPECRESP"].header["TUNIT2"]
    with pytest.raises(InputError, match="energy bins differ"):
        Response.from_ogip(rmf, arf)


def test_a_rate_becomes_counts_again_if_they_are_whole(tmp_path, rmf, arf):
    rate = np.array([5, 6, 700_001, 8]) / 123.4
    pha = write_pha(tmp_path / "s.pha", rate, name="RATE", EXPOSURE=123.4, HDUCLAS3="RATE")
    assert Spectrum.from_ogip(pha, rmf, arf).counts.tolist() == [5, 6, 700_001, 8]
    pha = write_pha(tmp_path / "s.pha", rate * 1.01, name="RATE", EXPOSURE=123.4, HDUCLAS3="RATE")
    with pytest.raises(InputError, match=r"s\.pha: RATE times EXPOSURE are not whole"):
        Spectrum.from_ogip(pha, rmf, arf)


def test_a_complete_response_needs_no_arf_and_a_bare_one_does(tmp_path, rmf, arf):
    full = write_rmf(tmp_path / "full.rsp", matrix=MATRIX * AREA[:, None], hduclas3="FULL")
    theirs, ours = Response.from_ogip(full), Response.from_ogip(rmf, arf)
    np.testing.assert_allclose(theirs.transfer, ours.transfer, rtol=1e-6)
    with pytest.raises(InputError, match="already includes the effective area"):
        Response.from_ogip(full, arf)
    with pytest.raises(InputError, match=r"r\.rmf: holds no effective area; give the ARF"):
        Response.from_ogip(rmf)


def break_it(path, how):
    content = path.read_bytes()
    if how == "missing":
        path.unlink()
    elif how == "empty":
        path.write_bytes(b"")
    elif how == "text":
        path.write_text("not a FITS file at all\n" * 50)
    elif how == "cut":
        path.write_bytes(content[: len(content) - 2880])
    elif how == "half":
        path.write_bytes(content[: len(content) // 2])
    elif how == "folder":
        path.unlink()
        path.mkdir()
    elif how == "cut gzip":
        path.write_bytes(gzip.compress(content)[:-200])


@pytest.mark.parametrize("how", ["missing", "empty", "text", "cut", "half", "folder", "cut gzip"])
@pytest.mark.parametrize("role", ["rmf", "arf", "pha"])
def test_broken_files_each_give_one_line_with_their_name(tmp_path, rmf, arf, role, how):
    pha = write_pha(tmp_path / "s.pha")
    broken = {"rmf": rmf, "arf": arf, "pha": pha}[role]
    break_it(broken, how)
    with pytest.raises(InputError) as caught:
        Spectrum.from_ogip(pha, rmf, arf)
    message = str(caught.value)
    assert broken.name in message
    assert "\n" not in message
    assert "check" in message


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda p: write_pha(p, first=1), "has channels 1 to 4 of 4"),
        (lambda p: write_pha(p, range(9)), "give the response that was made for this spectrum"),
        (lambda p: write_pha(p, (1, 2, 3), DETCHANS=9), "of 9"),
        (lambda p: write_pha(p, HDUCLAS2="NET"), "background-subtracted"),
        (
            lambda p: write_pha(p, columns=[column("STAT_ERR", "E", [5, 5, 5, 5])], POISSERR=False),
            "neither weighted",
        ),
        (lambda p: write_pha(p, columns=[column("STAT_ERR", "E", [5, 5, 5, 5])]), "POISSERR is absent and"),
        (
            lambda p: write_pha(p, columns=[column("QUALITY", "I", [1, 2, 5, 5])]),
            "QUALITY says that all of its 4 channels are bad; set it to 0 for those that are good",
        ),
        (lambda p: write_pha(p, EXPOSURE=None), "no EXPOSURE"),
        (lambda p: write_pha(p, EXPOSURE=0.0), "positive"),
        (lambda p: write_pha(p, columns=[column("QUALITY", "E", [0, 0.5, 0, 0])]), "QUALITY holds fractions"),
        (lambda p: write_pha(p, columns=[column("GROUPING", "E", [1, -1, 0.5, 1])]), "GROUPING holds fract"),
        (lambda p: write_pha(p, columns=[column("BACKSCAL", "E", [1, np.nan, 1, 1])]), "BACKSCAL is not one"),
        (lambda p: write_pha(p, columns=[column("AREASCAL", "2E", np.ones((4, 2)))]), "AREASCAL is not one"),
        (lambda p: write_pha(p, columns=[column("GROUPING", "I", [-1, 1, 1, 1])]), "the first not -1"),
        (lambda p: write_pha(p, columns=[column("CHANNEL", "I", [0, 2, 1, 3])]), "CHANNEL does not ascend"),
        (lambda p: write_pha(p, ()), "COUNTS has no channels"),
        (lambda p: write_pha(p, (1, -2, 3, 4)), "whole, nonnegative"),
        (lambda p: write_pha(p, (1, np.nan, 3, 4), name="RATE"), "whole, nonnegative"),
        (lambda p: write_pha(p, name="FLUX"), "neither a COUNTS nor a RATE"),
        (lambda p: write_rmf(p), "SPECTRUM"),
    ],
)
def test_a_spectrum_that_cannot_be_used_says_why(tmp_path, rmf, arf, make, words):
    with pytest.raises(InputError, match=words) as caught:
        Spectrum.from_ogip(make(tmp_path / "s.pha"), rmf, arf)
    assert "s.pha" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_spectrum_may_hold_some_of_the_channels(tmp_path, rmf, arf):
    spectrum = Spectrum.from_ogip(write_pha(tmp_path / "s.pha", (6, 7), first=1, DETCHANS=4), rmf, arf)
    assert spectrum.response.channels.tolist() == [[1.0, 2.0], [2.0, 3.0]]


def test_a_response_of_another_instrument_says_so(tmp_path, rmf):
    with pytest.raises(InputError, match=r"5 energy bins and RMF .* has 6"):
        Response.from_ogip(rmf, write_arf(tmp_path / "b.arf", low=LOW[1:], area=AREA[1:]))
    with pytest.raises(InputError, match=r"differ by up to 0\.6 of a bin"):
        Response.from_ogip(rmf, write_arf(tmp_path / "b.arf", low=LOW + np.float32(0.3)))
    with pytest.raises(InputError, match="no usable channel lies wholly between 90 and 100 keV"):
        Response.from_ogip(rmf, write_arf(tmp_path / "b.arf"), band=(90, 100))
    with pytest.raises(InputError, match="low < high"):
        Response.from_ogip(rmf, write_arf(tmp_path / "b.arf"), band=(3, 1))
    with pytest.raises(InputError, match="names no response"):
        Spectrum.from_ogip(write_pha(tmp_path / "s.pha"))


MEASURED = {
    "mcg6_pn/pn_spec_grp.fits": ({}, 1_973_664, (226, 2067)),
    "chandra/obs1.pi": ({"background": "none"}, 54, (1024, 1078)),
    "maxij1820_nicer/nicer_unbinned.pha": (
        {"rmf": "nicer.rmf.gz", "arf": "nicer.arf"}, 96_505_118, (1501, 3451),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", MEASURED)
def test_measured_spectra_load(shared_file, name):
    options, total, shape = MEASURED[name]
    pha = shared_file(f"data/{name}")
    paths = {k: v if k == "background" else pha.parent / v for k, v in options.items()}
    spectrum = Spectrum.from_ogip(pha, **paths)
    assert spectrum.counts.sum() == total
    assert spectrum.response.transfer.shape == shape
    assert np.isfinite(spectrum.response.transfer).all()
    if spectrum.background is not None:
        assert np.all(spectrum.background_scale > 0)


def test_the_matrix_may_be_called_otherwise_and_its_channels_garbled(tmp_path, rmf, arf):
    expected = Response.from_ogip(rmf, arf)
    other = write_rmf(tmp_path / "o.rmf", name="RSP_MATRIX", channel=[256, 512, 0, -9])
    response = Response.from_ogip(other, arf)
    assert np.array_equal(response.transfer, expected.transfer)
    assert "counted from 0 (TLMIN)" in response.notes[0]
    # Numbered from 1, it is another detector's.
    numbered = write_rmf(tmp_path / "n.rmf", first=1, channel=[4, 3, 2, 1])
    with pytest.raises(InputError, match="has channels 0 to 3"):
        Spectrum.from_ogip(write_pha(tmp_path / "s.pha"), numbered, arf)


def test_several_matrices_are_added_up_on_the_finest_bins(tmp_path, rmf, arf):
    tail = np.array([[0.2, 0.1, 0.0, 0.0], [0.0, 0.0, 0.3, 0.4], [0.1, 0.0, 0.0, 0.0]], dtype="f4")
    coarse = matrix_table(tail, low=LOW[::2], high=LOW[::2] + np.float32(1.0))
    response = Response.from_ogip(write_rmf(tmp_path / "two.rmf", more=[coarse]), arf)
    expected = (MATRIX + np.repeat(tail, 2, axis=0)).T * AREA
    np.testing.assert_allclose(response.transfer, expected[:, 1:], rtol=1e-6)
    assert "2 MATRIX blocks" in response.notes[0]
    odd = matrix_table(tail, low=LOW[::2] + np.float32(0.25), high=LOW[::2] + np.float32(1.25))
    with pytest.raises(InputError, match=r"odd\.rmf: .* do not nest"):
        Response.from_ogip(write_rmf(tmp_path / "odd.rmf", more=[odd]), arf)


def test_rows_of_any_length_and_several_groups_are_read(tmp_path, arf):
    """Variable-length columns: two groups in one row, none in another."""
    table = matrix_table()
    rows = [[0.5, 0.2, 0.3], [], *[[1.0]] * 4]
    ragged = fits.BinTableHDU.from_columns(
        [
            *(table.columns[name] for name in ("ENERG_LO", "ENERG_HI")),
            column("N_GRP", "I", [2, 0, 1, 1, 1, 1]),
            column("F_CHAN", "PI()", np.array([[0, 3], [], [1], [1], [2], [2]], dtype=object)),
            column("N_CHAN", "PI()", np.array([[2, 1], [], [1], [1], [1], [1]], dtype=object)),
            column("MATRIX", "PE()", np.array([np.array(r, "f4") for r in rows], dtype=object)),
        ],
        name="MATRIX",
    )
    write_rmf(tmp_path / "r.rmf")
    with fits.open(tmp_path / "r.rmf") as hdus:
        bounds = hdus["EBOUNDS"].copy()
        fits.HDUList([fits.PrimaryHDU(), ragged, bounds]).writeto(tmp_path / "v.rmf")
    matrix = read_rmf(tmp_path / "v.rmf").matrix.toarray()
    expected = np.zeros((4, 6))
    expected[[0, 1, 3], 0] = rows[0]
    expected[[1, 1, 2, 2], [2, 3, 4, 5]] = 1.0
    np.testing.assert_allclose(matrix, expected, rtol=1e-6)


def test_edges_that_differ_where_no_channel_in_use_looks_do_not_matter(tmp_path, rmf):
    low = LOW.copy()
    low[0] = 0.2
    odd = write_arf(tmp_path / "odd.arf", low=low)
    with pytest.raises(InputError, match=r"differ by up to 0\.4 of a bin"):
        Response.from_ogip(rmf, odd)
    # The first three bins reach channels 0 and 1 alone.
    used = Response.from_ogip(rmf, odd, band=(2.0, 4.0))
    expected = Response.from_ogip(rmf, write_arf(tmp_path / "good.arf"), band=(2.0, 4.0))
    assert np.array_equal(used.transfer, expected.transfer)
    assert used.notes == ()


def test_one_spectrum_of_several_is_named_by_its_number(tmp_path, rmf, arf):
    counts = np.array([[5, 6, 7, 8], [1, 0, 2, 9], [3, 3, 3, 3]])
    table = fits.BinTableHDU.from_columns(
        [
            column("SPEC_NUM", "I", [1, 2, 3]),
            column("CHANNEL", "4I", np.tile(np.arange(4), (3, 1))),
            column("COUNTS", "4J", counts),
            column("QUALITY", "4I", [[0, 0, 0, 0], [0, 0, 0, 1], [0, 0, 0, 0]]),
            column("EXPOSURE", "D", [10.0, 20.0, 30.0]),
            column("BACKSCAL", "D", [1.0, 2.0, 4.0]),
            column("RESPFILE", "8A", ["r.rmf"] * 3),
            column("ANCRFILE", "8A", ["a.arf"] * 3),
        ],
        name="SPECTRUM",
    )
    path = tmp_path / "many.pha"
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(path)
    second = Spectrum.from_ogip(f"{path}{{2}}", background=f"{path}{{3}}")
    assert second.counts.tolist() == [1, 0, 2]
    assert second.exposure == 20.0
    np.testing.assert_allclose(second.background_scale, 20.0 * 2.0 / (30.0 * 4.0))
    assert second.background.tolist() == [3, 3, 3]
    assert Response.from_ogip(rmf, arf, f"{path}{{3}}").exposure == 30.0
    for name in (path, f"{path}{{4}}", f"{path}{{0}}"):
        with pytest.raises(
            InputError, match=r"holds 3 spectra \(type II\); name one .*many\.pha|many\.pha: holds 3"
        ):
            Spectrum.from_ogip(name)
    with pytest.raises(InputError, match="holds one spectrum, and number 2"):
        Spectrum.from_ogip(f"{write_pha(tmp_path / 's.pha')}{{2}}", rmf, arf)


@pytest.mark.parametrize("at", [(0, 2), (5, 0)])
def test_a_little_below_nothing_in_a_matrix_is_nothing_and_more_is_refused(tmp_path, arf, at):
    # The matrix adds up to 5.4.
    little, much = MATRIX.copy(), MATRIX.copy()
    little[at], much[at] = -0.005, -0.006
    path = write_rmf(tmp_path / "little.rmf", matrix=little)
    found, plain = read_rmf(path), read_rmf(write_rmf(tmp_path / "plain.rmf"))
    np.testing.assert_array_equal(found.matrix.toarray(), plain.matrix.toarray())
    assert plain.notes == ()
    assert found.notes == ("1 entries of MATRIX are negative, 0.0009 of it, and are taken for 0",)
    assert found.notes[0] in Response.from_ogip(path, arf).notes
    for wrong in (much, np.where(little < 0, np.nan, little), np.where(little < 0, np.inf, little)):
        with pytest.raises(InputError, match="negative or not finite"):
            read_rmf(write_rmf(tmp_path / "much.rmf", matrix=wrong))


def test_a_file_of_one_spectrum_may_say_that_it_has_several(tmp_path):
    # As CIAO leaves it where one order of a grating was taken out of a file of all.
    pha = write_pha(tmp_path / "s.pha", columns=[column("SPEC_NUM", "I", [1] * 4)], HDUCLAS4="TYPE:II")
    assert (
        load_pha("PHA", pha).counts.tolist() == load_pha("PHA", write_pha(tmp_path / "t.pha")).counts.tolist()
    )


def test_spectra_of_one_file_may_differ_in_channels(tmp_path):
    counts = np.array([np.array([5, 6, 7, 8]), np.array([1, 2])], dtype=object)
    table = fits.BinTableHDU.from_columns(
        [column("COUNTS", "PJ()", counts), column("EXPOSURE", "D", [10.0, 20.0])], name="SPECTRUM"
    )
    path = tmp_path / "many.pha"
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(path)
    assert load_pha("PHA", f"{path}{{2}}").counts.tolist() == [1, 2]
    with pytest.raises(InputError, match=r"holds 2 spectra \(type II\); name one of them, many\.pha\{1\} to"):
        load_pha("PHA", path)


def test_channels_that_a_file_of_several_does_not_number_are_from_one_on(tmp_path):
    table = fits.BinTableHDU.from_columns(
        [column("COUNTS", "4J", [[5, 6, 7, 8]] * 2), column("EXPOSURE", "D", [10.0, 20.0])], name="SPECTRUM"
    )
    path = tmp_path / "many.pha"
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(path)
    assert load_pha("PHA", f"{path}{{2}}").channel.tolist() == [1, 2, 3, 4]


def test_one_reader_keeps_detectors_apart_by_their_areas(tmp_path, rmf, arf):
    half = write_arf(tmp_path / "half.arf", area=np.asarray(AREA) / 2)
    pha, reader = write_pha(tmp_path / "s.pha"), Reader()
    first, second, again = (reader.read(pha, rmf, area).spectrum.response.area for area in (arf, half, arf))
    np.testing.assert_allclose(second, first / 2, rtol=1e-6)
    np.testing.assert_array_equal(again, first)
    with pytest.raises(InputError, match="gone"):
        reader.read(pha, rmf, tmp_path / "gone.arf")


def test_errors_that_are_not_used_are_told_and_those_of_poisson_are_fine(tmp_path, rmf, arf):
    counts = np.array([5, 16, 0, 100])

    def notes(columns=(), **header):
        pha = write_pha(tmp_path / "s.pha", counts, columns=columns, **header)
        told = Spectrum.from_ogip(pha, rmf, arf).response.notes
        assert Response.from_ogip(rmf, arf, pha).notes == told
        return told

    assert notes() == notes(SYS_ERR=0) == notes(POISSERR=True, STAT_ERR=0) == ()
    assert "SYS_ERR (median 0.03, up to 0.03) is not used" in notes(SYS_ERR=0.03)[0]
    assert "(median 0.02, up to 1)" in notes([column("SYS_ERR", "E", [0, 0.02, 0.02, 1])])[0]
    assert "whole counts are taken" in notes(POISSERR=False)[0]
    for error in (np.sqrt(counts), 1 + np.sqrt(counts + 0.75)):
        assert "those of Poisson counts" in notes([column("STAT_ERR", "E", error)], POISSERR=False)[0]


def test_the_errors_of_a_background_are_read_as_those_of_a_spectrum(tmp_path, rmf, arf):
    pha = write_pha(tmp_path / "s.pha", SYS_ERR=0.25)
    behind = write_pha(tmp_path / "b.pha", SYS_ERR=0.5, POISSERR=True, STAT_ERR=9)
    notes = Spectrum.from_ogip(pha, rmf, arf, behind).response.notes
    assert [note[:32] for note in notes] == [
        "SYS_ERR (median 0.25, up to 0.25",
        "background: SYS_ERR (median 0.5,",
        "background: STAT_ERR (channel 0:",
    ]
    behind = write_pha(behind, SYS_ERR=-0.5)
    with pytest.raises(InputError, match=r"background .*b\.pha: SYS_ERR .*; background 'none' does"):
        Spectrum.from_ogip(write_pha(pha), rmf, arf, behind)


@pytest.mark.parametrize("name", ["3c186_chandra", "m31_r0085_chandra"])
def test_files_that_0_1_0_refused_are_those_that_were_mended_by_hand(shared_file, name):
    ours = Spectrum.from_ogip(shared_file(f"spectra/refused/{name}/source.pha"))
    mended = Spectrum.from_ogip(shared_file(f"spectra/{name}/source.pha"))
    assert np.array_equal(ours.counts, mended.counts)
    np.testing.assert_allclose(ours.response.transfer.sum(), mended.response.transfer.sum(), rtol=0.2)


def test_what_a_response_says_of_its_band_and_widths(rmf, arf):
    response = Response.from_ogip(rmf, arf, grouping=[1, -1, 0, 0])
    # Bins from 0.5 to 3 keV, by their middles; channels from 0 to 4.
    assert response.band == (0.75, 2.75)
    assert Response.from_ogip(rmf, arf, band=(1.0, 2.0)).band == (1.0, 2.0)
    assert response.width.tolist() == [2.0, 1.0, 1.0]
    np.testing.assert_allclose(response.with_exposure(3.0).sparse.toarray(), 3.0 * response.transfer)
    assert response.with_frame_time(0.07).frame_time == 0.07
    for wrong in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(InputError, match="exposure must be a positive number of seconds"):
            response.with_exposure(wrong)
        with pytest.raises(InputError, match="frame time must be a positive number of seconds"):
            response.with_frame_time(wrong)
