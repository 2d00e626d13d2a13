"""SYS_ERR as scatter: what it leaves of the counts has Poisson's variance, and the model expects it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import Effect

pytest.importorskip("jaxspec")
from astropy.io import fits

from gaugeblock.auditing.discovering import discover, read_measured
from gaugeblock.discovery import Sources
from gaugeblock.simulators.xray import XraySpectrum, data, reference
from gaugeblock.simulators.xray.extra_scatter import REACH, scattered, weights
from gaugeblock.simulators.xray.observation import read_observation
from gaugeblock.simulators.xray.reader import Reader

pytestmark = pytest.mark.usefixtures("xray_data")

NAMES = ("PN_spectrum_grp20.fits", "PN.rmf", "PN.arf", "PNbackground_spectrum.fits")


@pytest.mark.parametrize("mean", [0.3, 5.0, 100.0, 3e3, 1e6])
def test_variance_and_mean_are_the_same_again(mean):
    """Of means that scatter by 5 per cent; 4,000 channels, so that the ratio is known to 2.2 per cent."""
    rng = np.random.default_rng(2)
    counts = rng.poisson(mean * rng.gamma(0.05**-2, 0.05**2, 4000))
    plain = reference().response
    edges = np.stack([np.arange(4000.0), np.arange(1.0, 4001.0)], axis=1)
    response = replace(
        plain, fine_channels=edges, channels=edges, grouping=csr_array(np.eye(4000)), redistribution=None
    )
    whole, changed, weight = scattered(counts, response, np.full(4000, 0.05))
    assert np.array_equal(changed.grouping.diagonal(), weight)
    pull = (whole - weight * mean) / np.sqrt(weight * mean)
    assert np.mean(pull**2) == pytest.approx(1.0, abs=0.1)
    assert pull.mean() == pytest.approx(0.0, abs=5 / np.sqrt(4000))
    # As they are they scatter by more: by 2,500 times where they are a million.
    bare = (counts - mean) / np.sqrt(mean)
    assert np.mean(bare**2) == pytest.approx(1 + 0.05**2 * mean, rel=0.15)
    assert f"{counts.sum():,} counts weigh as {whole.sum():,}" in changed.notes[-1]


def test_neighbours_say_what_is_expected():
    counts, width = np.arange(100.0, 130.0), np.linspace(0.1, 0.4, 30)
    found = weights(counts, width, np.full(30, 0.1))
    assert REACH == 5
    there = np.r_[10:15, 16:21]
    mean = width[15] * counts[there].sum() / width[there].sum()
    assert found[15] == pytest.approx(1 / (1 + 0.01 * mean))
    louder = counts.copy()
    louder[15] = 1e6
    assert weights(louder, width, np.full(30, 0.1))[15] == pytest.approx(found[15])
    assert weights([400.0], [1.0], [0.05]) == pytest.approx([0.5])
    assert np.array_equal(weights(counts, width, np.zeros(30)), np.ones(30))


@pytest.fixture
def files(tmp_path):
    """NGC 7793 with SYS_ERR of 0.2 below channel 300 and 0.1 above."""
    pha, rmf, arf, background = (data.path(data.EXAMPLE + name) for name in NAMES)
    with fits.open(pha) as file:
        table = file["SPECTRUM"]
        error = np.where(np.arange(len(table.data)) < 300, 0.2, 0.1)
        columns = [one for one in table.columns if one.name != "SYS_ERR"]
        columns.append(fits.Column("SYS_ERR", "D", array=error))
        header = table.header.copy()
        header.remove("SYS_ERR", ignore_missing=True)
        made = fits.BinTableHDU.from_columns(columns, header=header, name="SPECTRUM")
        fits.HDUList([file[0], made]).writeto(tmp_path / "s.pha")
    return tmp_path / "s.pha", rmf, arf, background


def test_a_spectrum_of_which_channels_weigh_what_their_errors_leave(files):
    bare, used = (Reader(band=(0.5, 8.0), sys_err=used).read(*files).spectrum for used in (False, True))
    groups = bare.response.grouping
    places = np.asarray(groups @ np.arange(groups.shape[1])) / np.asarray(groups.sum(axis=1)).ravel()
    error = np.where(places < 295, 0.2, 0.1)
    weight = weights(bare.counts, bare.response.width, error)
    far = np.abs(places - 300) > 30
    np.testing.assert_allclose((used.response.width / bare.response.width)[far], weight[far], rtol=1e-9)
    assert np.all(np.abs(used.counts - weight * bare.counts)[far] <= 1.0)
    np.testing.assert_allclose((used.background_scale / bare.background_scale)[far], weight[far], rtol=1e-9)
    assert np.array_equal(used.background, bare.background)
    assert "SYS_ERR (median 0.1, up to 0.2) is not used" in bare.response.notes[0]
    (note,) = used.response.notes
    assert note.startswith("SYS_ERR (median 0.")
    assert "is used as scatter beyond Poisson's: " in note
    assert used.response.describe() != bare.response.describe()
    # Models and what moves counts between channels are weighted alike.
    theta = [0.2, 1.7, 3e-3, 0.5, 40.0]
    for effects in (
        (),
        (Effect("gain_slope", {"slope": 1.02}),),
        (Effect("background", {"level": 1.0, "index": 1.0}),),
    ):
        expected = [
            XraySpectrum(
                "tbabs*(powerlaw+bbodyrad)", one.response, reference().prior, effects=effects
            ).expected(theta)
            for one in (bare, used)
        ]
        np.testing.assert_allclose((expected[1] / expected[0])[far], weight[far], rtol=1e-6)


def test_it_is_asked_for_of_one_source(files, tmp_path):
    given = {"model": "tbabs*powerlaw", "band": (0.5, 8.0)}
    pha, rmf, arf, background = files
    whole = read_observation(pha, rmf=rmf, arf=arf, background=background, **given)
    used = read_observation(pha, rmf=rmf, arf=arf, background=background, sys_err=True, **given)
    channels = whole.counts.shape[1] // 2
    assert used.counts[0, :channels].sum() < 0.9 * whole.counts[0, :channels].sum()
    assert np.array_equal(used.counts[0, channels:], whole.counts[0, channels:])
    asked = {"redshift": 0.0, "seed": 0, "progress": lambda *_: None, "background": (), **given}
    (source,) = read_measured(
        pha, rmf=rmf, arf=arf, sys_err=True, **{**asked, "background": (str(background),)}
    )
    assert np.array_equal(source.counts, used.counts)
    with pytest.raises(InputError, match="SYS_ERR is used of one source"):
        read_measured(tmp_path, rmf=(), arf=(), sys_err=True, **asked)


@pytest.mark.slow
def test_a_search_that_is_told_of_the_scatter_finds_nothing_in_it():
    """A million counts in 102 bins whose means scatter by 3 per cent: C is 800, of Poisson's 100."""
    spectrum = reference(level="bright")
    theta = np.array([0.22, 1.8, 3e-3, 0.9, 0.2])
    bright = spectrum.with_exposure(1e6 / spectrum.expected(theta).sum() * spectrum.exposure)
    counts = np.random.default_rng(1).poisson(
        bright.expected(theta) * np.random.default_rng(2).gamma(0.03**-2, 0.03**2, 102)
    )
    whole, response, _ = scattered(counts, bright.response, np.full(102, 0.03))
    for observed, seen, named in ((whole, response, False), (counts, bright.response, True)):
        told = XraySpectrum(spectrum.model, seen, spectrum.prior, integration="exact")
        found = discover(Sources.of(told, observed), seed=1, replicates=399, progress=False)
        assert any(one.certain for one in found.statements) is named
        assert (found.p_global < 0.01) is named
