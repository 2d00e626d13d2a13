"""Spectra and catalogues from files: what belongs together shares a simulator, what is wrong is named."""

import gzip
import json
import pickle
from types import SimpleNamespace

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators import Effect, LogUniform, Uniform
from gaugeblock.simulators.prior import Prior

pytest.importorskip("jaxspec")
from gaugeblock.simulators.xray import (
    JointSpectra,
    Response,
    Spectrum,
    WithBackground,
    XraySpectrum,
    data,
    on_instrument,
    read_catalog,
    read_observation,
    reader,
)
from gaugeblock.simulators.xray.catalog import entries, pooled, thinned, with_equal_scales
from gaugeblock.simulators.xray.measured_background import MeasuredBackground
from gaugeblock.simulators.xray.observation import source_counts
from gaugeblock.simulators.xray.pha import read_pha
from gaugeblock.simulators.xray.siblings import Siblings

pytestmark = pytest.mark.usefixtures("xray_data")
CHANNELS = 4096
MODEL = "powerlaw"
PRIOR = Prior({"powerlaw_1.alpha": Uniform(1.0, 3.0), "powerlaw_1.norm": LogUniform(1e-5, 1e-1)})


@pytest.fixture(scope="module")
def pn():
    return Response.from_ogip(*(data.path(data.EXAMPLE + n) for n in ("PN.rmf", "PN.arf")), exposure=1.0)


@pytest.fixture
def write(tmp_path, write_spectrum):
    """Write spectra of EPIC-pn into a folder."""
    rmf, arf = (str(data.path(data.EXAMPLE + n)) for n in ("PN.rmf", "PN.arf"))

    def one(name, exposure=1e4, rate=0.5, **options):
        counts = np.random.default_rng(len(name)).poisson(rate * exposure / CHANNELS, CHANNELS)
        keywords = {"RESPFILE": rmf, "ANCRFILE": arf, "BACKFILE": "none", "INSTRUME": "EPN", **options}
        return write_spectrum(tmp_path / name, counts, exposure, **keywords)

    return one


def read(folder, **options):
    return read_catalog(folder, **{"model": MODEL, "priors": PRIOR, "band": (0.5, 8.0), **options})


def test_one_spectrum_is_one_row(write):
    observation = read_observation(write("a.pha"), model=MODEL, priors=PRIOR, band=(0.5, 8.0), redshift=0.3)
    assert isinstance(observation.simulator, XraySpectrum)
    assert observation.counts.shape == (1, *observation.simulator.data_shape)
    assert observation.names == ("a.pha",)
    assert len(observation) == 1
    assert (observation.scale[0], observation.redshift[0]) == (1.0, 0.3)
    assert observation.simulator.exposure == 1e4
    longer = read_observation(write("a.pha"), model=MODEL, priors=PRIOR, exposure=2e4)
    assert longer.simulator.exposure == 2e4
    Sources(
        observation.simulator, observation.counts, observation.scale, observation.redshift, observation.names
    )


def test_the_header_names_the_background_and_none_does_without(write):
    write("a.bkg", rate=2.0, BACKSCAL=4.0)
    path = write("a.pha", BACKFILE="a.bkg")
    both = read_observation(path, model=MODEL, priors=PRIOR, band=(0.5, 8.0))
    assert isinstance(both.simulator, WithBackground)
    channels = both.simulator.data_shape[0] // 2
    spectrum = Spectrum.from_ogip(path)
    assert both.counts.shape == (1, 2 * channels)
    assert np.all(both.simulator.background.scale == 0.25)
    assert np.all(spectrum.background_scale == 0.25)
    alone = read_observation(path, model=MODEL, priors=PRIOR, band=(0.5, 8.0), background="none")
    assert np.array_equal(alone.counts[0], both.counts[0, :channels])


def test_several_spectra_are_several_instruments(write):
    write("b.bkg")
    paths = [write("a.pha"), write("b.pha", BACKFILE="b.bkg", INSTRUME="EMOS1")]
    joint = read_observation(paths, model=MODEL, priors=PRIOR, band=(0.5, 8.0))
    assert isinstance(joint.simulator, JointSpectra)
    assert joint.simulator.names == ("epn", "emos1")
    assert joint.counts.shape == (1, *joint.simulator.data_shape)
    assert len(joint.simulator.segments()) == 3
    same = read_observation([paths[0], paths[0]], model=MODEL, priors=PRIOR, names=["first", "second"])
    assert same.simulator.names == ("first", "second")
    paths = [write("c.pha"), paths[1]]
    bare = read_observation(paths, model=MODEL, priors=PRIOR, band=(0.5, 8.0), background="none")
    assert len(bare.simulator.segments()) == 2
    # A band of its own for each; whole groups of channels lie within.
    each = read_observation(
        paths, model=MODEL, priors=PRIOR, band=[(0.5, 8.0), [2.0, 6.0]], background="none"
    )
    wide, narrow = (part.simulator.response.band for part in each.simulator.parts)
    assert wide == pytest.approx((0.5, 8.0), abs=0.1)
    assert narrow == pytest.approx((2.0, 6.0), abs=0.1)
    assert each.counts.shape[1] < bare.counts.shape[1]
    # Where headers call two alike, they have the names of their files.
    twice = read_observation([paths[0], write("a.pha")], model=MODEL, priors=PRIOR, band=(0.5, 8.0))
    assert twice.simulator.names == ("c", "a")


@pytest.mark.parametrize(
    ("counts", "background", "scale", "share"),
    [
        ([6, 4], [2, 2], 0.5, 0.8),
        ([6, 4], [9, 9], 1.0, 0.1),
        ([0, 0], [1, 0], 1.0, 0.0),
        ([6, 4], None, None, 1),
    ],
)
def test_what_is_left_of_the_counts_is_a_tenth_at_least(counts, background, scale, share):
    scales = None if scale is None else np.full(2, scale)
    behind = None if background is None else np.array(background)
    left = source_counts(Spectrum(np.array(counts), None, behind, scales))
    np.testing.assert_allclose(left, share * np.array(counts))


def test_a_response_that_ships_with_jaxspec_can_be_named(write):
    path = write("a.pha", RESPFILE="none", ANCRFILE="none")
    found = read_observation(path, model=MODEL, priors=PRIOR, rmf="PN.rmf", arf="PN.arf", band=(0.5, 8.0))
    assert found.simulator.response.files.keys() >= {"rmf", "arf", "pha"}
    with pytest.raises(InputError, match=r"RMF MINE\.rmf: no such file"):
        read_observation(path, model=MODEL, priors=PRIOR, rmf="MINE.rmf")


def test_without_priors_there_are_default_ones(write, tmp_path):
    given = {"powerlaw_1.alpha": {"distribution": "uniform", "low": 1.5, "high": 2.5}}
    found = read_observation(write("a.pha"), model="tbabs*powerlaw", priors=given, band=(0.5, 8.0))
    assert found.simulator.prior.marginals["powerlaw_1.alpha"] == Uniform(1.5, 2.5)
    assert found.simulator.prior.names == ("tbabs_1.nh", "powerlaw_1.alpha", "powerlaw_1.norm")


@pytest.mark.parametrize("band", [(0.5, 8.0), None])
def test_a_catalogue_of_one_has_the_prior_of_its_spectrum(write, tmp_path, band):
    alone = read_observation(write("a.pha"), model=MODEL, band=band)
    (found,) = read_catalog(tmp_path, model=MODEL, band=band)
    assert found.simulator.prior == alone.simulator.prior
    np.testing.assert_array_equal(found.counts, alone.counts)
    if band is None:
        return
    # One more, that sees a quarter of the photons: its rate counts as the first one's response would have it.
    write("b.pha", exposure=2e4, AREASCAL=0.25)
    found, other = read_catalog(tmp_path, model=MODEL, band=band)
    assert other.simulator.prior == found.simulator.prior
    assert (found.simulator.exposure, other.simulator.exposure) == pytest.approx((1e4, 2e4))
    ratio = other.counts.sum() / 0.25 / 2e4 / (found.counts.sum() / 1e4)
    assert ratio > 3
    supports = [one.simulator.prior.marginals["powerlaw_1.norm"].support for one in (alone, found)]
    # Six decades, in whose middle both are.
    np.testing.assert_allclose(np.divide(*supports[::-1]), np.sqrt(ratio), rtol=1e-6)


def test_ungrouped_spectra_are_grouped_by_resolution_and_groups_are_kept(write):
    bare = read_observation(write("a.pha"), model=MODEL, priors=PRIOR, band=(0.5, 8.0))
    assert 100 < bare.counts.shape[1] < 200
    never = read_observation(write("a.pha"), model=MODEL, priors=PRIOR, band=(0.5, 8.0), regroup="never")
    assert never.counts.shape[1] > 1400
    flags = np.where(np.arange(CHANNELS) % 64, -1, 1)
    theirs = read_observation(write("b.pha", grouping=flags), model=MODEL, priors=PRIOR, band=(0.5, 8.0))
    edges = theirs.simulator.channels
    np.testing.assert_allclose(np.diff(edges, axis=1), 64 * 0.005, rtol=0.05)
    np.testing.assert_allclose(edges[1:, 0], edges[:-1, 1], rtol=1e-6)
    always = read_observation(
        write("b.pha", grouping=flags), model=MODEL, priors=PRIOR, band=(0.5, 8.0), regroup="always"
    )
    assert always.counts.shape == bare.counts.shape
    with pytest.raises(InputError, match="grouping"):
        read_observation(write("a.pha"), model=MODEL, priors=PRIOR, regroup="perhaps")


def test_systematic_errors_are_noted_of_one_source_and_of_many(write, tmp_path):
    pha = write("a.pha", SYS_ERR=0.02)
    options = {"model": MODEL, "priors": PRIOR, "band": (0.5, 8.0)}
    one = read_observation(pha, **options)
    (many,) = read(tmp_path)
    for found in (one, many):
        (note,) = found.simulator.notes
        assert note.startswith("SYS_ERR (median 0.02, up to 0.02) is not used: ")


def test_sources_of_one_response_share_a_simulator_and_the_response_is_read_once(
    write, tmp_path, monkeypatch
):
    calls = []

    def counted(*arguments):
        calls.append(arguments)
        return original(*arguments)

    original = reader.read_detector
    monkeypatch.setattr(reader, "read_detector", counted)
    for i, exposure in enumerate((1e3, 4e3, 32e3)):
        write(f"s{i}.pha", exposure)
    quality = np.zeros(CHANNELS, int)
    quality[300] = 5
    write("s9.pha", quality=quality)
    told = []
    first, second = read(tmp_path, progress=lambda done, total: told.append((done, total)))
    assert first.names == ("s0.pha", "s1.pha", "s2.pha")
    assert second.names == ("s9.pha",)
    np.testing.assert_allclose(first.scale, [0.25, 1.0, 8.0])
    assert first.simulator.exposure == pytest.approx(4e3)
    assert first.counts[2].sum() > 2 * first.counts[1].sum()
    assert len(calls) == 1
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]
    Sources(first.simulator, first.counts, first.scale, first.redshift, first.names)
    json.dumps([first.simulator.describe(), second.simulator.describe()])


def test_catalog_csv_says_which_spectra_names_and_redshifts(write, tmp_path):
    (tmp_path / "sub").mkdir()
    for name in ("sub/a.pha", "b.pha", "unlisted.pha"):
        write(name)
    table = tmp_path / "catalog.csv"
    table.write_text("redshift, pha, name\n0.1, sub/a.pha, Alpha\n, b.pha,\n")
    (found,) = read(tmp_path)
    assert found.names == ("Alpha", "b.pha")
    assert found.redshift.tolist() == [0.1, 0.0]
    for text, message in (
        ("file,redshift\na.pha,1\n", r"catalog\.csv: needs a header line"),
        ("pha,redshift\n", r"catalog\.csv: lists no spectrum"),
        ("pha,redshift\nb.pha,near\n", "line 2: redshift 'near' is not a number"),
        ("pha,redshift\nb.pha,-2\n", "line 2: redshift '-2'"),
        ("pha,redshift\n,0.1\n", "line 2: names no pha"),
        ("pha,redshift\ngone.pha,0.1\n", r"gone\.pha: no such file"),
    ):
        table.write_text(text)
        with pytest.raises(InputError, match=message):
            read(tmp_path)


def test_what_counts_as_a_spectrum_of_a_folder(tmp_path):
    for name in ("a.fits", "b.pi"):
        (tmp_path / name).touch()
    assert [(entry.name, entry.redshift) for entry in entries(tmp_path)] == [("a.fits", 0.0), ("b.pi", 0.0)]
    with gzip.open(tmp_path / "c.pha.gz", "wb"):
        pass
    assert [entry.name for entry in entries(tmp_path)] == ["c.pha.gz"]
    with pytest.raises(InputError, match="no such folder"):
        entries(tmp_path / "none")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"neither catalog\.csv nor any"):
        entries(tmp_path / "empty")


def test_backgrounds_of_near_scales_share_a_simulator(write, tmp_path):
    write("near.bkg", rate=2.0, BACKSCAL=4.0)
    write("wide.bkg", rate=4.0, BACKSCAL=40.0)
    for name, background, size in (("a", "near", 1.0), ("b", "near", 0.9), ("c", "wide", 1.0)):
        write(f"{name}.pha", BACKFILE=f"{background}.bkg", BACKSCAL=size)
    write("d.pha")
    groups = read(tmp_path)
    assert sorted(group.names for group in groups) == [("a.pha", "b.pha"), ("c.pha",), ("d.pha",)]
    near, wide = (next(g for g in groups if name in g.names) for name in ("a.pha", "c.pha"))
    np.testing.assert_allclose(near.simulator.background.scale, 0.25)
    np.testing.assert_allclose(wide.simulator.background.scale, 0.025)
    assert all(len(group.simulator.segments()) == 2 for group in groups if "d.pha" not in group.names)
    # One thing is compiled for both, with an effect as without.
    assert near.simulator.source is wide.simulator.source
    gain = Effect("gain_slope", {"slope": Uniform(0.9, 1.1)})
    assert near.simulator.with_effect(gain).source is wide.simulator.with_effect(gain).source
    other = Effect("gain_slope", {"slope": Uniform(0.8, 1.1)})
    assert near.simulator.with_effect(other).source is not wide.simulator.with_effect(gain).source
    (again,) = (g for g in read(tmp_path) if "a.pha" in g.names)
    assert np.array_equal(again.counts, near.counts)
    (tmp_path / "c.pha").unlink()
    (fewer,) = (g for g in read(tmp_path) if "a.pha" in g.names)
    assert np.array_equal(fewer.counts, near.counts)
    assert all(isinstance(group.simulator, XraySpectrum) for group in read(tmp_path, background=False))


def test_siblings_remember_the_latest_64_effects_of_each_source():
    first, other = (SimpleNamespace(with_effect=lambda effect: object()) for _ in range(2))
    effects = [Effect("gain_slope", {"slope": 1.0 + k / 100}) for k in range(64)]
    siblings = Siblings()
    made = [siblings.with_effect(first, effect) for effect in effects]
    assert len({id(one) for one in made}) == 64
    assert [siblings.with_effect(first, effect) for effect in effects] == made
    # Another process makes its own; one more, of another source or kind, and the oldest is forgotten.
    assert pickle.loads(pickle.dumps(siblings)).with_effect(first, effects[1]) is not made[1]
    assert siblings.with_effect(other, effects[1]) is not made[1]
    assert siblings.with_effect(first, effects[1]) is made[1]
    assert siblings.with_effect(first, effects[0]) is not made[0]
    assert siblings.with_effect(first, on_instrument(effects[9], "pn")) is not made[9]


def fake(response, scale, background):
    return Spectrum(np.zeros(len(response.channels), int), response, background, scale)


def test_thinned_backgrounds_are_poisson_of_the_larger_scale(pn):
    number = len(pn.channels)
    rng = np.random.default_rng(0)
    spectra = [fake(pn, np.full(number, s), rng.poisson(5.0 / s, number)) for s in (0.8, 1.0)]
    scale, counts = thinned(spectra, [(0, 1), (0, 2)])
    assert np.all(scale == 1.0)
    assert np.array_equal(counts[1], spectra[1].background)
    assert np.all(counts[0] <= spectra[0].background)
    # Mean and variance of Poisson counts, each within four standard errors (one in 16,000 seeds beyond).
    assert abs(counts[0].mean() - 5.0) < 4 * np.sqrt(5.0 / number)
    assert abs(counts[0].var() - 5.0) < 4 * np.sqrt((5.0 + 2 * 25.0) / number)


def test_scales_that_differ_more_are_apart(pn):
    number = len(pn.channels)
    spectra = [fake(pn, np.full(number, s), np.ones(number, int)) for s in (1.0, 0.81, 0.79, 0.1)]
    spectra.append(Spectrum(np.zeros(number, int), pn))
    groups = with_equal_scales(range(5), lambda i: spectra[i])
    assert [sorted(group) for group in groups] == [[0, 1], [2], [3], [4]]
    # By their mean in the logarithm; the largest of a group is what the others are compared with.
    uneven = [np.where(np.arange(number) % 2, 4.0, 1.0), np.full(number, 1.61), np.full(number, 1.45)]
    spectra = [fake(pn, scale, np.ones(number, int)) for scale in uneven]
    groups = with_equal_scales(range(3), lambda i: spectra[i])
    assert [sorted(group) for group in groups] == [[0, 1], [2]]


def test_a_pooled_prior_holds_the_sources_that_it_is_for(pn):
    number = len(pn.channels)
    rng = np.random.default_rng(1)
    levels = np.exp(rng.normal(0.0, 1.0, 40))
    shape = np.exp(-pn.channels.mean(axis=1))
    spectra = [fake(pn, np.ones(number), rng.poisson(level * shape)) for level in levels]
    scale, counts = thinned(spectra, [(0, i) for i in range(40)])
    background = pooled(spectra, scale, counts)
    single = pooled(spectra[:1], scale, counts[:1])
    assert len(single.prior.names) >= 6
    deviation = [
        (np.log(level) - np.log(levels).mean()) / marginal.sd
        for level in levels
        for marginal in background.prior.marginals.values()
    ]
    assert np.std(deviation) < 1.0
    assert np.max(np.abs(deviation)) < 3.0


@pytest.mark.parametrize(("spread", "least"), [(0.1, 0.5), (1.0, 0.0), (3.0, 2.0)])
def test_a_pooled_prior_is_the_fit_to_all_as_wide_as_sources_differ(spread, least):
    """By hand: rates move to the mean of the levels, one and a half times as wide; lines stand on them."""
    from scipy.sparse import eye_array

    edges = np.linspace(0.5, 8.0, 61)
    bins = np.stack([edges[:-1], edges[1:]], axis=1)
    eye = eye_array(60, format="csr")
    exposures = np.array([1e3, 4e3, 2e3, 8e3])
    levels = np.exp(spread * np.array([-1.0, 0.2, 0.3, 1.1]))
    shape = 0.02 + 0.3 * np.exp(-0.5 * ((bins.mean(axis=1) - 2.0) / 0.06) ** 2)
    rng = np.random.default_rng(3)
    spectra = [
        fake(Response("made", bins, bins, bins, np.ones(60), eye, eye, seconds), np.full(60, 0.5), found)
        for seconds, found in zip(exposures, rng.poisson(np.outer(levels * exposures, shape)), strict=True)
    ]
    scale, counts = thinned(spectra, [(0, i) for i in range(4)])
    background = pooled(spectra, scale, counts)
    together = MeasuredBackground.fit(counts.sum(axis=0), 0.5, bins, exposure=exposures.sum())
    assert np.array_equal(background.shape.knots, together.shape.knots)
    assert np.all(background.scale == 0.5)
    rates = np.log((counts.sum(axis=1) + 0.5) / exposures)
    shift = rates.mean() - np.log((counts.sum() + 0.5) / exposures.sum())
    sd = min(max(1.5 * np.sqrt(((rates - rates.mean()) ** 2).sum() / 3), 0.5), 2.0)
    assert sd == least or 0.5 < sd < 2.0
    assert any(".line_" in name for name in together.prior.names)
    for name, marginal in together.prior.marginals.items():
        found = background.prior.marginals[name]
        if ".line_" in name:
            assert found == marginal
        else:
            assert found.center == pytest.approx(marginal.center + shift)
            assert found.sd == pytest.approx(max(sd, marginal.sd))


def test_files_that_do_not_fit_are_named(write, tmp_path):
    path = write("a.pha")
    with pytest.raises(InputError, match="rmf: 2 given for 1 spectra"):
        read_observation(path, model=MODEL, priors=PRIOR, rmf=["PN.rmf", "PN.rmf"])
    with pytest.raises(InputError, match="band: 2 given for 1 spectra; give one for all or one for each"):
        read_observation(path, model=MODEL, priors=PRIOR, band=[(0.5, 8.0), (1.0, 2.0)])
    for band in ((0.5, 2.0, 8.0), [(0.5, 8.0), 3.0], ("low", "high"), 5.0):
        with pytest.raises(InputError, match=r"band: give \(low, high\) in keV, or one such pair a spectrum"):
            read_observation(path, model=MODEL, priors=PRIOR, band=band)
    with pytest.raises(InputError, match="none given"):
        read_observation([], model=MODEL, priors=PRIOR)
    with pytest.raises(InputError, match="single spectrum"):
        read_observation([path, path], model=MODEL, priors=PRIOR, exposure=1.0)
    bad = write("b.pha", BACKFILE="gone.bkg")
    with pytest.raises(InputError, match=r"b\.pha: its header's BACKFILE is gone\.bkg"):
        read(tmp_path)
    assert read_pha(bad).instrument == "EPN"
