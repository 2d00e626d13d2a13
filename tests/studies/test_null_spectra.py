"""Spectra with nothing in them: made as they say, and read and fitted as they were made."""

import itertools

import numpy as np
import pytest

pytest.importorskip("jaxspec")
from studies.hidden.instrument import response
from studies.kit.results import RESULTS, read
from studies.kit.resume import stream
from studies.nulls.models import MODELS, uniform_in_log
from studies.nulls.spectra import GROUPINGS, Case, drawn, fwhm, instruments, spectrum, written

pytestmark = pytest.mark.usefixtures("xray_data")


@pytest.fixture(scope="module")
def tools(xray_data):
    return {name: response(files.rmf, files.arf) for name, files in instruments(None).items()}


def made(tools, counts=20000.0, seed=1, **changed):
    case = Case(**{"instrument": "EPIC-pn", "model": "tbabs*powerlaw", "band": (0.5, 8.0),
                         "grouping": "20", "background": True, **changed})  # fmt: skip
    return case, spectrum(case, counts, tools[case.instrument], np.random.default_rng(seed))


def inside(tool, band):
    return (tool.edges[:-1] >= band[0]) & (tool.edges[1:] <= band[1])


@pytest.mark.parametrize("model", MODELS)
def test_a_source_has_the_counts_that_were_asked_for(tools, model):
    for instrument, tool in tools.items():
        case, found = made(tools, 40000.0, 3, model=model, instrument=instrument, background=False)
        total = found["counts"][inside(tool, case.band)].sum()
        assert abs(total - 40000.0) < 5 * 200.0, instrument
        assert found["region"] is None
        assert found["exposure"] > 0


def test_a_background_is_in_the_source_region_too(tools):
    """Less the region's counts in the ratio of areas, what is left is the source."""
    tool = tools["EPIC-pn"]
    left = []
    for seed in range(40):
        case, found = made(tools, 30000.0, seed)
        both, region = (found[name][inside(tool, case.band)].sum() for name in ("counts", "region"))
        behind = region / found["larger"]
        assert 0.008 * 30000 < behind < 0.32 * 30000
        assert 3.0 <= found["larger"] <= 30.0
        left.append((both - behind - 30000.0) / np.sqrt(both + behind / found["larger"]))
    assert abs(np.mean(left)) < 4 / np.sqrt(40)
    assert 0.6 < np.std(left) < 1.4


@pytest.mark.parametrize("least", [1, 20])
def test_groups_are_closed_as_soon_as_they_are_full(tools, least):
    _, found = made(tools, grouping=str(least))
    begins = np.flatnonzero(found["flags"] == 1)
    assert begins[0] == 0
    sums = np.add.reduceat(found["counts"], begins)
    assert np.all(sums[:-1] >= least)
    last = np.append(begins[1:], len(found["counts"])) - 1
    assert np.all((sums - found["counts"][last])[:-1] < least)


def test_groups_by_the_resolution_are_a_third_to_the_whole_of_it(tools):
    for instrument, tool in tools.items():
        case, found = made(tools, 1e6, grouping="by the resolution", instrument=instrument)
        begins = np.flatnonzero(found["flags"] == 1)
        share = np.diff(begins) / fwhm(tool)[begins[:-1]]
        used = inside(tool, case.band)[begins[:-1]] & (fwhm(tool)[begins[:-1]] >= 9)
        assert share[used].min() > 0.28, instrument
        assert share[used].max() < 1.06, instrument
        assert share[used].min() < 0.40, instrument


def test_the_fwhm_is_that_of_a_line(tools):
    """The quartiles of a normal distribution are 0.573 of its FWHM apart."""
    for instrument, tool in tools.items():
        line = int(np.argmin(abs(tool.energies.mean(axis=1) - 6.4)))
        row = tool.redistribution[:, [line]].toarray()[:, 0]
        core = np.where(abs(tool.centres - 6.4) < 0.5, row, 0.0)
        low, high = np.interp([0.25, 0.75], np.cumsum(core) / core.sum(), tool.edges[1:])
        at = int(np.searchsorted(tool.centres, 6.4))
        width = fwhm(tool)[at] * np.diff(tool.edges)[at]
        assert high - low == pytest.approx(0.573 * width, rel=0.15), instrument


@pytest.mark.parametrize("instrument", ["EPIC-pn", "EPIC-MOS", "NICER"])
@pytest.mark.parametrize("grouping", ["none", "20", "by the resolution"])
def test_files_are_read_as_they_were_made(tools, tmp_path, instrument, grouping):
    from gaugeblock.simulators.xray import read_observation

    case, found = made(tools, instrument=instrument, grouping=grouping)
    files, tool = instruments(None)[instrument], tools[instrument]
    paths = written(found, files, tmp_path)
    read = read_observation(
        paths["pha"], model=case.model, rmf=files.rmf, arf=files.arf, background=paths["background"],
        band=case.band, regroup="never",
    )  # fmt: skip
    begins = np.arange(len(found["counts"]))
    if found["flags"] is not None:
        begins = np.flatnonzero(found["flags"] == 1)
    ends = np.append(begins[1:], len(found["counts"]))
    whole = (tool.edges[begins] >= case.band[0]) & (tool.edges[ends] <= case.band[1])
    wanted = [np.add.reduceat(found[name], begins)[whole] for name in ("counts", "region")]
    np.testing.assert_array_equal(read.counts[0], np.concatenate(wanted))
    np.testing.assert_allclose(read.simulator.background.scale, 1 / found["larger"])
    assert read.simulator.exposure == pytest.approx(found["exposure"])


@pytest.mark.parametrize(
    ("model", "theta"),
    [
        ("tbabs*powerlaw", lambda rng: [None, rng.uniform(1.2, 2.8)]),
        ("tbabs*cutoffpl", lambda rng: [None, rng.uniform(1.2, 2.8), None]),
    ],
)
def test_models_are_those_that_are_searched_with(tools, tmp_path, model, theta):
    """A spectrum of 1e6 counts is fitted by its own model as well as Poisson noise allows."""
    from gaugeblock.discovery.fitting import fit
    from gaugeblock.simulators.xray import read_observation

    case, found = made(tools, 1e6, 7, model=model, background=False, grouping="by the resolution")
    files = instruments(None)[case.instrument]
    paths = written(found, files, tmp_path)
    read = read_observation(
        paths["pha"], model=model, rmf=files.rmf, arf=files.arf, background="none", band=case.band
    )
    best = fit(read.simulator, read.counts, seed=1)
    counts, mean = read.counts[0], best.expected[0]
    deviance = 2 * (counts * np.log(counts / mean) - counts + mean).sum()
    bins = len(counts)
    assert abs(deviance - bins) < 4 * np.sqrt(2 * bins)


@pytest.mark.parametrize("seed", range(6))
def test_a_line_of_the_model_is_fitted_where_it_is(tools, tmp_path, seed):
    """Anywhere from 0.05 to 16 keV; no fit that begins at the line's own energies ends a nat lower."""
    from gaugeblock.discovery.fitting import fit
    from gaugeblock.simulators.xray import read_observation

    model, files = "tbabs*(powerlaw+gauss)", instruments(None)["EPIC-pn"]
    case, found = made(tools, 2e4, seed, model=model, band=None, background=False, grouping="by the program")
    paths = written(found, files, tmp_path)
    read = read_observation(paths["pha"], model=case.model, rmf=files.rmf, arf=files.arf, background="none")
    assert read.simulator.prior.marginals["gauss_1.El"].support[1] > 15.0
    best = fit(read.simulator, read.counts, bank=16384, tries=16)
    names = list(read.simulator.prior.names)
    starts = np.tile(best.theta[0], (12, 1))
    for row, (energy, sigma, width) in zip(
        starts, itertools.product((6.3, 6.4, 6.5), (0.02, 0.1), (0.05, 0.2)), strict=True
    ):
        at = {name.rpartition(".")[2]: value for name, value in zip(names, row, strict=True)}
        norm = width * row[names.index("powerlaw_1.norm")] * energy ** -at["alpha"]
        for name, value in (("El", energy), ("sigma", sigma), ("norm", norm)):
            row[names.index(f"gauss_1.{name}")] = value
    near = fit(read.simulator, read.counts, start=starts[None])
    assert best.objective[0] - near.objective[0] < 1.0


def test_of_two_components_each_is_fitted_as_what_it_is(tools, tmp_path):
    """The one spectrum of a thousand without an effect in which something was certain.

    Its black body is of 0.14 keV; the likeliest draws from the prior all had one of 1.5 keV, with one seed.
    """
    from gaugeblock.discovery.counts import RANGES, TRIES
    from gaugeblock.discovery.fitting import fit
    from gaugeblock.discovery.held_out import deviance
    from gaugeblock.simulators.xray import read_observation

    table = read(RESULTS / "nulls.nc")
    (at,) = np.flatnonzero(table["certain"].values)
    number, stratum = (int(table[name].values[at]) for name in ("number", "stratum"))
    rng = np.random.default_rng(stream(int(table.attrs["generator_seed"]), "spectrum", number, stratum))
    counts, name = uniform_in_log(rng, 1.8e5, 1e6), "EPIC-MOS"
    assert counts == table["counts"].values[at]
    case = Case(name, "tbabs*(powerlaw+bbodyrad)", (0.5, 8.0), "by the program", background=False)
    files = instruments(None)[name]
    paths = written(spectrum(case, counts, tools[name], rng), files, tmp_path)
    observed = read_observation(
        paths["pha"], model=case.model, rmf=files.rmf, arf=files.arf, background="none", band=case.band
    )
    before, after = (
        [
            fit(observed.simulator, observed.counts, bank=16384, tries=TRIES, ranges=ranges, seed=seed)
            for seed in range(12)
        ]
        for ranges in (0, RANGES)
    )
    best, bins = after[0].objective[0], observed.counts.shape[1]
    assert sum(one.objective[0] > best + 100.0 for one in before) == 1
    assert all(one.objective[0] == pytest.approx(best, abs=0.1) for one in after)
    cash = [bins * float(deviance(observed.counts[0], one[0].expected[0])) for one in (before, after)]
    assert cash[0] == pytest.approx(table["statistic"].values[at], abs=0.1)
    assert [round(value) for value in (*cash, bins)] == [763, 182, 168]
    found = dict(zip(observed.simulator.prior.names, after[0].theta[0], strict=True))
    assert found["blackbodyrad_1.kT"] == pytest.approx(0.138, abs=0.01)


def test_cases_are_of_all_kinds_and_the_same_again():
    known = instruments(None)
    cases = [drawn(np.random.default_rng(seed), known) for seed in range(400)]
    assert cases == [drawn(np.random.default_rng(seed), known) for seed in range(400)]
    assert {one.model for one in cases} == set(MODELS)
    assert {one.grouping for one in cases} == set(GROUPINGS)
    assert {one.instrument for one in cases} == set(known)
    assert {one.band for one in cases} >= {None, (0.5, 8.0)}
    assert 150 < sum(one.background for one in cases) < 250
