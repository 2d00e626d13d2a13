"""OGIP files: good ones are read, odd ones mended, broken ones explained in one line that names the file."""

import gzip
import shutil

import numpy as np
import pytest

from gaugeblock.core.errors import InputError

pytest.importorskip("jaxspec")
from astropy.io import fits

from gaugeblock.simulators.xray import Response, Spectrum

BINS, CHANNELS = 6, 4
LOW = np.array([0.0, 0.5, 1.0, 1.5, 2.0, 2.5], dtype="f4")
MATRIX = np.array([[0.6, 0.4, 0.0, 0.0]] * 3 + [[0.0, 0.1, 0.5, 0.2]] * 3, dtype="f4")
AREA = np.array([0.0, 10.0, 20.0, 30.0, 40.0, 50.0], dtype="f4")


def column(name, form, array, unit=None):
    return fits.Column(name=name, format=form, array=array, unit=unit)


def write_rmf(path, *, matrix=MATRIX, low=LOW, first=0, hduclas3="REDIST"):
    table = fits.BinTableHDU.from_columns(
        [
            column("ENERG_LO", "E", low, "keV"),
            column("ENERG_HI", "E", low + np.float32(0.5), "keV"),
            column("N_GRP", "I", np.ones(len(low), int)),
            column("F_CHAN", "I", np.full(len(low), first)),
            column("N_CHAN", "I", np.full(len(low), CHANNELS)),
            column("MATRIX", f"{CHANNELS}E", matrix),
        ],
        name="MATRIX",
    )
    table.header["HDUCLAS3"] = hduclas3
    edges = np.arange(CHANNELS, dtype="f4")
    bounds = fits.BinTableHDU.from_columns(
        [
            column("CHANNEL", "I", np.arange(first, first + CHANNELS)),
            column("E_MIN", "E", edges, "keV"),
            column("E_MAX", "E", edges + 1, "keV"),
        ],
        name="EBOUNDS",
    )
    fits.HDUList([fits.PrimaryHDU(), table, bounds]).writeto(path, overwrite=True)
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
    table = fits.BinTableHDU.from_columns(
        [
            column("CHANNEL", "I", np.arange(first, first + len(counts))),
            column(name, "J" if name == "COUNTS" else "E", np.asarray(counts)),
            *columns,
        ],
        name="SPECTRUM",
    )
    for key, value in {"EXPOSURE": 100.0, **header}.items():
        if value is not None:
            table.header[key] = value
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(path, overwrite=True)
    return path


@pytest.fixture
def rmf(tmp_path):
    return write_rmf(tmp_path / "r.rmf")


@pytest.fixture
def arf(tmp_path):
    return write_arf(tmp_path / "a.arf")


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
    with open(rmf, "rb") as source, gzip.open(tmp_path / "r.rmf.gz", "wb") as target:
        shutil.copyfileobj(source, target)
    rmf.unlink()
    assert Spectrum.from_ogip(pha).counts.tolist() == [5, 6, 7, 8]
    (tmp_path / "b.pha").unlink()
    with pytest.raises(InputError, match=r"BACKFILE is b\.pha, which is not beside it"):
        Spectrum.from_ogip(pha)


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
    with fits.open(arf, mode="update") as hdus:
        hdus["SPECRESP"].header["TUNIT3"] = "m**2"
    np.testing.assert_allclose(Response.from_ogip(rmf, arf).transfer, 1e4 * expected, rtol=1e-12)
    with pytest.raises(InputError, match=r"b\.arf: holds areas that are negative"):
        Response.from_ogip(rmf, write_arf(tmp_path / "b.arf", area=-AREA))


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
        (lambda p: write_pha(p, HDUCLAS4="TYPE:II"), "type II"),
        (lambda p: write_pha(p, EXPOSURE=None), "no EXPOSURE"),
        (lambda p: write_pha(p, EXPOSURE=0.0), "positive"),
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
