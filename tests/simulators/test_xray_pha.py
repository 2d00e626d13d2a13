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


@pytest.mark.parametrize("off", [1.015, 0.985])
def test_errors_within_a_fiftieth_are_of_poisson_and_others_are_not(read, off):
    # Where nothing was counted every error is.
    error = np.array([2.0, 3.0, 7.0]) * off
    found = read([column("STAT_ERR", "D", error)], POISSERR=False)
    assert "those of Poisson counts" in found.notes[0]
    with pytest.raises(InputError, match="not the errors of Poisson counts"):
        read([column("STAT_ERR", "D", error * off)], POISSERR=False)


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
