"""What is read of one spectrum's file, keyword by keyword."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError

pytest.importorskip("astropy")
from astropy.io import fits
from tests.simulators.ogip_files import column, write_pha

from gaugeblock.simulators.xray.pha import group_matrix, load_pha


@pytest.fixture
def read(tmp_path):
    """What is read of a spectrum of three channels with these columns and keywords."""

    def made(columns=(), primary=(), counts=(4, 9, 0), **header):
        usual = column("CHANNEL", "I", [2, 3, 5])
        path = write_pha(
            tmp_path / "s.pha", counts, columns=[usual, *columns], **{"EXPOSURE": 10.0, **header}
        )
        with fits.open(path, mode="update") as hdus:
            hdus[0].header.update(dict(primary))
        return load_pha("PHA", path)

    return made


def test_what_is_not_said_is_as_ogip_has_it(read):
    found = read()
    assert found.channel.tolist() == [2, 3, 5]
    assert found.counts.tolist() == [4, 9, 0]
    assert found.counts.dtype == found.channel.dtype == np.int64
    assert found.grouping is None
    assert found.quality.tolist() == [0, 0, 0]
    assert found.backscal.tolist() == found.areascal.tolist() == [1.0, 1.0, 1.0]
    assert found.detector_channels == 3
    said = (found.background_file, found.response_file, found.area_file, found.instrument, found.frame_time)
    assert said == (None,) * 5
    assert found.notes == ()


def test_what_is_said_is_taken(read):
    found = read(
        [column("QUALITY", "I", [0, 5, 1]), column("AREASCAL", "E", [0.5, 0.25, 1.0])],
        BACKSCAL=0.125, GROUPING=0, DETCHANS=4096, INSTRUME="EPN", BACKFILE="b.pha", RESPFILE="r.rmf",
        ANCRFILE="a.arf",
    )  # fmt: skip
    assert found.quality.tolist() == [0, 5, 1]
    assert found.areascal.tolist() == [0.5, 0.25, 1.0]
    assert found.backscal.tolist() == [0.125] * 3
    assert found.detector_channels == 4096
    assert (found.instrument, found.exposure) == ("EPN", 10.0)
    assert (found.background_file, found.response_file, found.area_file) == ("b.pha", "r.rmf", "a.arf")


def test_a_scale_of_zero_means_nothing_and_one_of_each_channel_is_kept(read):
    assert read(BACKSCAL=0.0, AREASCAL=0).backscal.tolist() == [1.0, 1.0, 1.0]
    assert read([column("BACKSCAL", "E", [0, 2, 0])]).backscal.tolist() == [0.0, 2.0, 0.0]


@pytest.mark.parametrize(
    ("header", "primary", "seconds"),
    [
        ({"FRMTIME": 73.4}, {}, 0.0734),
        ({"FRMTIME": 73.4, "TIMEDEL": 2.6}, {}, 0.0734),
        ({"TIMEDEL": 2.6}, {}, 2.6),
        ({}, {"TIMEDEL": 3.2}, 3.2),
        ({"TIMEDEL": 1.5}, {"TIMEDEL": 3.2}, 1.5),
        # How finely photons are timed, one by one; no frame is as long as this; no number.
        ({"TIMEDEL": 4e-8}, {}, None),
        ({"TIMEDEL": 1e-5}, {}, 1e-5),
        ({"TIMEDEL": 100.0}, {}, None),
        ({"TIMEDEL": "2.6"}, {}, None),
    ],
)
def test_the_time_of_a_frame(read, header, primary, seconds):
    assert read(primary=primary, **header).frame_time == (seconds and pytest.approx(seconds))


def test_errors_of_a_rate_are_those_of_its_counts_over_the_time(tmp_path):
    counts = np.array([4.0, 9.0, 100.0])
    table = fits.BinTableHDU.from_columns(
        [
            column("CHANNEL", "I", [0, 1, 2]),
            column("RATE", "D", counts / 8),
            column("STAT_ERR", "D", np.sqrt(counts) / 8),
        ],
        name="SPECTRUM",
    )
    table.header.update({"EXPOSURE": 8.0, "POISSERR": False})
    path = tmp_path / "r.pha"
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(path)
    found = load_pha("PHA", path)
    assert found.counts.tolist() == [4, 9, 100]
    assert "those of Poisson counts" in found.notes[0]


COUNTS = np.array([1, 5, 16, 0, 10_000])
ROOT, GEHRELS = np.sqrt(COUNTS), 1.0 + np.sqrt(COUNTS + 0.75)


@pytest.fixture
def notes(read):
    """What is noted of five channels with these columns, by name, and keywords."""

    def made(columns=(), *, counts=COUNTS, **header):
        channel = column("CHANNEL", "I", np.arange(3, 3 + len(counts)))
        given = [column(name, "D", values) for name, values in dict(columns).items()]
        return read([channel, *given], counts=counts, **header).notes

    return made


@pytest.mark.parametrize(
    "error",
    [
        ROOT,
        GEHRELS,
        # One for no counts; either in the same file; as a file of text or of single precision rounds.
        np.maximum(ROOT, 1.0),
        np.where(COUNTS < 10, GEHRELS, ROOT),
        np.round(ROOT, 2),
        np.round(GEHRELS, 2),
        ROOT.astype("f4"),
        1.0009 * ROOT,
        0.9991 * ROOT,
        0 * ROOT,
    ],
)
def test_the_errors_of_counting_need_no_word(notes, error):
    for said in ({}, {"POISSERR": True}, {"POISSERR": "T"}):
        assert notes({"STAT_ERR": error}, **said) == ()
    (note,) = notes({"STAT_ERR": error}, POISSERR="F")
    assert ("those of Poisson counts" if error.any() else "no errors are given") in note


@pytest.mark.parametrize(
    ("channel", "error"),
    [
        # What a background takes off: a hundred of ten thousand; any error where nothing was counted.
        (4, 100.5), (4, 99.8), (4, 100.12), (2, 4.02), (2, 3.98), (0, 0.0), (3, 0.9), (3, 1.1), (3, 1.8),
        (3, 7.0),
    ],
)  # fmt: skip
def test_one_error_of_another_kind_is_refused_and_named(notes, channel, error):
    errors = ROOT.copy()
    errors[channel] = error
    for said, word in (({}, "absent"), ({"POISSERR": False}, "F"), ({"POISSERR": "F"}, "F")):
        with pytest.raises(InputError) as caught:
            notes({"STAT_ERR": errors}, **said)
        assert f"POISSERR is {word} and STAT_ERR are not the errors of Poisson counts" in str(caught.value)
        where = f"(channel {channel + 3}: {COUNTS[channel]} counts, error {error:.4g})"
        assert where in str(caught.value)
        assert "neither weighted nor background-subtracted, or set POISSERR to T" in str(caught.value)
    (note,) = notes({"STAT_ERR": errors}, POISSERR=True)
    assert note.startswith(f"STAT_ERR {where} is not used: POISSERR is T")


@pytest.mark.parametrize(
    ("said", "means"),
    [
        (True, "T"), ("T", "T"), (" true", "T"), (1, "T"), (False, "F"), ("F", "F"), ("False ", "F"),
        (0, "F"), ("", "absent"), (fits.card.UNDEFINED, "absent"),
    ],
)  # fmt: skip
def test_poisserr_as_headers_write_it(notes, said, means):
    odd = {"STAT_ERR": 3.0 * ROOT + 5.0}
    if means == "T":
        assert "is not used: POISSERR is T" in notes(odd, POISSERR=said)[0]
    else:
        with pytest.raises(InputError, match=f"POISSERR is {means} and STAT_ERR are not"):
            notes(odd, POISSERR=said)


@pytest.mark.parametrize("said", ["maybe", 2, 0.5])
def test_poisserr_that_is_neither_is_refused(notes, said):
    with pytest.raises(InputError, match=f"POISSERR is {said!r}, and has to be T or F; correct the header"):
        notes(POISSERR=said)


def test_errors_may_be_keywords(notes):
    assert notes(STAT_ERR=2.0, counts=(4, 4)) == ()
    with pytest.raises(InputError, match="channel 4: 9 counts, error 2"):
        notes(STAT_ERR=2.0, counts=(4, 9))
    blank = fits.card.UNDEFINED
    assert notes(STAT_ERR=blank, SYS_ERR=blank) == ()


@pytest.mark.parametrize("name", ["STAT_ERR", "SYS_ERR"])
@pytest.mark.parametrize("poisson", [True, False, None])
def test_errors_that_are_none_are_refused(notes, name, poisson):
    nan, negative = np.where(COUNTS == 5, np.nan, ROOT), np.where(COUNTS == 5, -0.25, 0.0)
    with pytest.raises(InputError, match=f"{name} is not one finite number for each of 5 channels"):
        notes({name: nan}, POISSERR=poisson)
    with pytest.raises(InputError, match=rf"{name} is negative \(-0.25\), which no error is; make it anew"):
        notes({name: negative}, POISSERR=poisson)


@pytest.mark.parametrize("poisson", [True, False, None])
def test_systematic_errors_are_noted(notes, poisson):
    """Most spectra of NICER have them."""
    least = {"SYS_ERR": np.where(COUNTS == 16, 0.25, 0.0)}
    for columns, header, size in (
        (least, {}, "median 0, up to 0.25"),
        ({}, {"SYS_ERR": 0.03}, "median 0.03, up to 0.03"),
        ({"SYS_ERR": np.array([0.01, 0.02, 0.02, 0.02, 1.0])}, {}, "median 0.02, up to 1"),
    ):
        told = notes(columns, POISSERR=poisson, **header)
        assert told[0].startswith(f"SYS_ERR ({size}) is not used: the likelihood is Poisson's")
        assert len(told) == (2 if poisson is False else 1)
    assert notes({"SYS_ERR": 0.0 * ROOT}) == notes(SYS_ERR=0) == ()


@pytest.mark.parametrize(
    ("flags", "groups"),
    [
        ([0, 0, 0], [[0], [1], [2]]),
        ([1, -1, -1], [[0, 1, 2]]),
        ([0, 1, -1], [[0], [1, 2]]),
        ([1, -1, 1], [[0, 1], [2]]),
        (None, [[0], [1], [2]]),
    ],
)
def test_flags_make_groups(flags, groups):
    matrix = group_matrix(None if flags is None else np.array(flags), 3).toarray()
    assert [np.flatnonzero(row).tolist() for row in matrix] == groups
    assert set(np.unique(matrix)) <= {0.0, 1.0}


def test_a_file_of_several_numbers_its_channels_from_what_it_says(tmp_path):
    table = fits.BinTableHDU.from_columns(
        [
            column("CHANNEL", "I", [1, 7]),
            column("RATE", "3D", [[1.0, 2.0, 3.0], [0.5, 0.0, 1.0]]),
            column("EXPOSURE", "D", [10.0, 20.0]),
            column("BACKFILE", "5A", ["b.pha", "c.pha"]),
        ],
        name="SPECTRUM",
    )
    path = tmp_path / "many.pha"
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(path)
    second = load_pha("PHA", f"{path}{{2}}")
    assert second.channel.tolist() == [7, 8, 9]
    assert second.counts.tolist() == [10, 0, 20]
    assert (second.exposure, second.background_file) == (20.0, "c.pha")


def test_each_spectrum_of_a_file_has_errors_of_its_own(tmp_path):
    table = fits.BinTableHDU.from_columns(
        [
            column("COUNTS", "2J", [[4, 9], [4, 9], [4, 9]]),
            column("STAT_ERR", "2D", [[2.0, 3.0], [9.0, 9.0], [9.0, 9.0]]),
            column("SYS_ERR", "2D", [[0.0, 0.5], [0.0, 0.0], [0.0, 0.0]]),
            column("POISSERR", "L", [True, False, True]),
        ],
        name="SPECTRUM",
    )
    table.header["EXPOSURE"] = 10.0
    path = tmp_path / "many.pha"
    fits.HDUList([fits.PrimaryHDU(), table]).writeto(path)
    assert len(load_pha("PHA", f"{path}{{1}}").notes) == 1
    with pytest.raises(InputError, match="POISSERR is F and STAT_ERR"):
        load_pha("PHA", f"{path}{{2}}")
    assert "POISSERR is T" in load_pha("PHA", f"{path}{{3}}").notes[0]
