"""Table models: interpolated and added parameters, bins, redshift; against SciPy's interpolation."""

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import LogUniform, Uniform

pytest.importorskip("jaxspec")
from astropy.io import fits

from gaugeblock.simulators.xray import (
    XraySpectrum,
    default_prior,
    double_precision,
    read_xcm,
    reference,
    write_xcm,
)
from gaugeblock.simulators.xray.expression import leaves, parameter_names, parse, with_sources, written
from gaugeblock.simulators.xray.folding import photon_flux
from gaugeblock.simulators.xray.tables import load_table, table_priors

TEMPERATURES, SLOPES = np.array([0.5, 1.0, 4.0]), np.array([1.0, 1.6, 2.5, 3.0])
EDGES = np.geomspace(0.2, 15.0, 301)
MIDDLE, WIDTH = np.sqrt(EDGES[1:] * EDGES[:-1]), np.diff(EDGES)


def spectrum(temperature, slope):
    return WIDTH * np.exp(-MIDDLE / temperature) * MIDDLE**-slope


def line(temperature, slope):
    return WIDTH * np.exp(-(((MIDDLE - 1.0 - 0.2 * slope) / 0.05) ** 2)) / temperature


def write(
    path, *, kind="atable", values=spectrum, added=(line,), redshift=True, parameters=None, scale=1.0,
    temperatures=TEMPERATURES, delta=0.1, **head,
):  # fmt: skip
    column = fits.Column
    rows = [
        ("kT", 1, 1.0, delta, 0.5, 0.6, 3.0, 4.0, temperatures),
        ("slope x", 0, 2.0, 0.1, 1.0, 1.0, 3.0, 3.0, SLOPES),
        ("Fe", 0, 0.5, 0.1, 0.0, 0.0, 5.0, 5.0, np.zeros(0)),
    ][: 2 + len(added)]
    longest = max(len(row[-1]) for row in rows)
    names = ("NAME", "METHOD", "INITIAL", "DELTA", "MINIMUM", "BOTTOM", "TOP", "MAXIMUM")
    table = fits.BinTableHDU.from_columns(
        [
            *(column(n, f, array=[row[k] for row in rows]) for k, (n, f) in enumerate(
                zip(names, ("12A", "J", "E", "E", "E", "E", "E", "E"), strict=True))),
            column("NUMBVALS", "J", array=[len(row[-1]) for row in rows]),
            column("VALUE", f"{longest}E", array=[[*row[-1], *(0,) * longest][:longest] for row in rows]),
        ],
        name="PARAMETERS",
    )  # fmt: skip
    table.header["NINTPARM"], table.header["NADDPARM"] = 2, len(added)
    energies = fits.BinTableHDU.from_columns(
        [column("ENERG_LO", "D", array=EDGES[:-1]), column("ENERG_HI", "D", array=EDGES[1:])], name="ENERGIES"
    )
    grid = [(t, s) for t in temperatures for s in SLOPES] if parameters is None else parameters
    grid = [grid[k] for k in np.random.default_rng(0).permutation(len(grid))]  # In no order.
    size = len(MIDDLE)
    spectra = fits.BinTableHDU.from_columns(
        [
            column("PARAMVAL", "2E", array=grid),
            column("INTPSPEC", f"{size}D", array=[scale * values(*at) for at in grid]),
            *(column(f"ADDSP{k:03d}", f"{size}D", array=[one(*at) for at in grid])
              for k, one in enumerate(added, 1)),
        ],
        name="SPECTRA",
    )  # fmt: skip
    first = fits.PrimaryHDU()
    first.header.update({"ADDMODEL": kind == "atable", "REDSHIFT": redshift, "MODLNAME": "made"} | head)
    fits.HDUList([first, table, energies, spectra]).writeto(path, overwrite=True)
    return f"{kind}{{{path}}}"


def photons(expression, low, high, **values):
    tree, names = parse(expression), tuple(name.replace("__", ".") for name in values)
    assert set(parameter_names(tree)) == set(names)
    with double_precision():
        return np.asarray(photon_flux(tree, names, low, high, "exact")(np.array([*values.values()]), 1))


def interpolated(function, temperature, slope):
    """SciPy's, linear in log temperature and in slope."""
    content = np.array([[function(t, s) for s in SLOPES] for t in TEMPERATURES])
    return RegularGridInterpolator((np.log(TEMPERATURES), SLOPES), content)([[np.log(temperature), slope]])[0]


def rebinned(content, edges):
    """Photons of the table's bins in others, spread evenly within each."""
    return np.diff(np.interp(edges, EDGES, np.append(0.0, np.cumsum(content))))


@pytest.mark.parametrize(
    ("temperature", "slope"), [(0.5, 1.0), (4.0, 3.0), (1.0, 1.6), (2.3, 1.9), (0.6, 2.9)]
)
def test_emission_is_interpolated_added_and_rebinned(tmp_path, temperature, slope):
    model = write(tmp_path / "plasma_1.fits")
    edges = np.linspace(0.15, 20.0, 118)
    ours = photons(model, edges[:-1], edges[1:], atable_1__kT=temperature, atable_1__slope_x=slope,
                   atable_1__Fe=1.7, atable_1__redshift=0.25, atable_1__norm=2.0)  # fmt: skip
    whole = interpolated(spectrum, temperature, slope) + 1.7 * interpolated(line, temperature, slope)
    # N(E (1 + z)): photons of the bin at E (1 + z), over 1 + z; none beyond the table.
    expected = 2.0 * rebinned(whole, 1.25 * edges) / 1.25
    np.testing.assert_allclose(ours, expected, rtol=1e-6, atol=1e-9 * expected.max())
    assert (ours[edges[1:] * 1.25 < 0.2] == 0).all()


def test_factors_and_optical_depths_are_averaged_over_bins(tmp_path):
    def wave(temperature, slope):
        return 0.5 + 0.3 * np.sin(3.0 * MIDDLE / slope) / temperature

    edges = np.linspace(0.5, 10.0, 4001)
    at = {"kT": 1.4, "slope_x": 2.2, "redshift": 0.1}
    mean = rebinned(interpolated(wave, 1.4, 2.2) * WIDTH, 1.1 * edges) / (1.1 * np.diff(edges))
    for kind, expected in (("mtable", mean), ("etable", np.exp(-mean))):
        model = write(tmp_path / f"{kind}.fits", kind=kind, values=wave, added=())
        values = {f"{kind}_1__{name}": value for name, value in at.items()}
        flux = photons(
            f"{model}*powerlaw", edges[:-1], edges[1:], powerlaw_1__alpha=0.0, powerlaw_1__norm=1.0, **values
        )
        np.testing.assert_allclose(flux / np.diff(edges), expected, rtol=2e-3)
        assert np.abs(expected - 1).max() > 0.1


def test_a_factor_beyond_the_table_is_what_the_file_says_or_none(tmp_path):
    def half(*_):
        return np.full(len(MIDDLE), 0.5)

    edges = np.array([0.05, 0.1, 1.0, 2.0, 18.0, 20.0])
    for head, below, above in (({}, 1.0, 1.0), ({"LOELIMIT": 0.0, "HIELIMIT": 0.25}, 0.0, 0.25)):
        model = write(tmp_path / "m.fits", kind="mtable", values=half, added=(), redshift=False, **head)
        flux = photons(f"{model}*powerlaw", edges[:-1], edges[1:], powerlaw_1__alpha=0.0,
                       powerlaw_1__norm=1.0, mtable_1__kT=1.0, mtable_1__slope_x=2.0)  # fmt: skip
        np.testing.assert_allclose((flux / np.diff(edges))[[0, 2, 4]], [below, 0.5, above], rtol=1e-9)


@pytest.mark.usefixtures("xray_data")
def test_a_table_is_a_component_like_others_batched_and_differentiable(tmp_path):
    model = with_sources(
        f"tbabs*({write(tmp_path / 'p.fits')}+gauss)", {"atable_1.redshift": 0.1, "gauss_1.El": 6.4}
    )
    assert model == written(parse(model))
    response = reference().response
    prior = default_prior(model, response, np.full(102, 50))
    assert prior.names == ("tbabs_1.nh", "atable_1.kT", "atable_1.slope_x", "atable_1.Fe", "atable_1.norm",
                           "gauss_1.sigma", "gauss_1.norm")  # fmt: skip
    assert prior.marginals["atable_1.kT"].support == pytest.approx((0.6, 3.0))
    assert isinstance(prior.marginals["atable_1.kT"], LogUniform)
    assert isinstance(prior.marginals["atable_1.slope_x"], Uniform)
    simulator = XraySpectrum(model, response, prior)
    assert simulator.integration == "exact"
    theta = prior.sample(40, np.random.default_rng(0))
    theta[:, 1] = 1.7
    counts, slope = simulator.expected(theta), simulator.jacobian(theta[:1])[0]
    np.testing.assert_allclose(simulator.expected(theta[3]), counts[3], rtol=1e-9)
    for k in (1, 2, 3, 4):
        step = np.zeros(7)
        step[k] = 1e-6 * theta[0, k]
        rise = (simulator.expected(theta[0] + step) - simulator.expected(theta[0] - step)) / (2 * step[k])
        np.testing.assert_allclose(slope[:, k], rise, rtol=1e-4, atol=1e-6 * np.abs(rise).max())
    described = simulator.describe()["tables"]
    write(tmp_path / "p.fits", scale=2.0)
    assert XraySpectrum(model, response, prior).describe()["tables"] != described
    assert not np.allclose(XraySpectrum(model, response, prior).expected(theta), counts)


@pytest.mark.parametrize("redshift", [True, False])
def test_priors_reach_over_the_file_s_ranges_and_of_a_redshift_only_where_there_is_one(tmp_path, redshift):
    made = table_priors(write(tmp_path / "p.fits", redshift=redshift))
    assert list(made) == ["kT", "slope_x", "Fe"] + ["redshift"] * redshift
    # Interpolated in the logarithm, within the file's bottom and top; in the value; added.
    assert isinstance(made["kT"], LogUniform)
    assert made["kT"].support == pytest.approx((0.6, 3.0))
    assert [made["slope_x"], made["Fe"]] == [Uniform(1.0, 3.0), Uniform(0.0, 5.0)]
    assert made.get("redshift", Uniform(0.0, 1.0)) == Uniform(0.0, 1.0)


def test_xspec_gets_the_file_s_name_as_it_is(tmp_path):
    model = f"tbabs*{write(tmp_path / 'wind_12.fits')}"
    values = dict.fromkeys(parameter_names(parse(model)), 0.5)
    (tmp_path / "out.xcm").write_text(write_xcm(model, values))
    assert read_xcm(tmp_path / "out.xcm").model == model
    assert read_xcm(tmp_path / "out.xcm").values == values


def test_parameters_beyond_the_grid_have_the_value_at_its_end(tmp_path):
    model = write(tmp_path / "p.fits", added=(), redshift=False)
    at = {"atable_1__slope_x": 9.0, "atable_1__norm": 1.0}
    low, high = EDGES[:-1], EDGES[1:]
    np.testing.assert_allclose(
        photons(model, low, high, atable_1__kT=0.01, **at), spectrum(0.5, 3.0), rtol=1e-5, atol=1e-12
    )


def test_what_the_file_froze_or_has_one_value_of_is_a_number(tmp_path):
    kept = {"added": (), "redshift": False}
    frozen = write(tmp_path / "f.fits", delta=-0.1, **kept)
    single = write(tmp_path / "s.fits", temperatures=np.array([1.25]), **kept)
    for model, value in ((frozen, 1.0), (single, 1.0)):
        (leaf,) = leaves(parse(model))
        assert dict(leaf.bindings)["kT"] == value
        assert parameter_names(parse(model)) == ("atable_1.slope_x", "atable_1.norm")
    assert set(table_priors(single)) == {"slope_x"}
    assert set(table_priors(frozen)) == {"kT", "slope_x"}
    assert parameter_names(parse(f"{single}+{frozen}"))[2:] == ("atable_2.slope_x", "atable_2.norm")
    # Whatever the temperature, it is that one's spectrum.
    with double_precision():
        found = np.asarray(load_table(single).cumulative({"kT": 3.0, "slope_x": 1.6}))
    np.testing.assert_allclose(found, np.append(0.0, np.cumsum(spectrum(1.25, 1.6))), rtol=1e-6)


def test_keywords_that_are_not_there_are_as_ogip_has_them(tmp_path):
    model = write(tmp_path / "p.fits", added=())
    with fits.open(tmp_path / "p.fits", mode="update") as hdus:
        for key in ("ADDMODEL", "REDSHIFT"):
            del hdus[0].header[key]
        del hdus["PARAMETERS"].header["NINTPARM"]
    for kind, end, outside in (("atable", ("norm",), 0.0), ("mtable", (), 1.0), ("etable", (), 0.0)):
        table = load_table(model.replace("atable", kind))
        assert [axis.name for axis in table.interpolated] == ["kT", "slope_x"]
        assert table.outside == (outside, outside)
        assert not table.redshift
        leaf = leaves(parse(("" if end else "po*") + model.replace("atable", kind)))[-1]
        assert tuple(name for name, _ in leaf.bindings) == ("kT", "slope_x", *end)


def test_what_is_no_table_model_is_one_line(tmp_path):
    def refused(expression, words):
        with pytest.raises(InputError, match=words) as caught:
            parse(expression)
        assert "\n" not in str(caught.value)

    refused(f"tbabs*atable{{{tmp_path}/none.fits}}", r"none\.fits: no such file")
    refused("tbabs*atable", r"needs its file: atable\{file\.fits\}")
    made = write(tmp_path / "p.fits")
    refused(made.replace("atable", "mtable") + "*po", "use atable instead")
    refused(write(tmp_path / "m.fits", kind="mtable").replace("mtable", "atable"), "use mtable or etable")
    half = [(t, s) for t in TEMPERATURES for s in SLOPES[:3]]
    refused(write(tmp_path / "half.fits", parameters=half), "9 spectra for a grid of 12")
    twice = [(t, s) for t in TEMPERATURES for s in (*SLOPES[:3], SLOPES[0])]
    refused(write(tmp_path / "twice.fits", parameters=twice), "not complete")
    refused(write(tmp_path / "nan.fits", scale=np.nan), "not finite")
    (tmp_path / "text.fits").write_text("no FITS at all")
    refused(f"atable{{{tmp_path}/text.fits}}", "cannot be read as an OGIP table model")
