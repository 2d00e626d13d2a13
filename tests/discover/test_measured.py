"""Measured spectra whose right answer is not one name: what fits them, found without the search, and by it.

Two observations are not distributed with the package: these tests say which file they lack, and are skipped.
"""

import numpy as np
import pytest
from scipy.optimize import minimize

from gaugeblock.discovery import Sources, discover_source
from gaugeblock.simulators import Effect, LogUniform, Prior, Uniform

pytest.importorskip("jaxspec")
from gaugeblock.simulators.xray import Spectrum, XraySpectrum, data
from gaugeblock.simulators.xray.observation import read_observation

pytestmark = pytest.mark.usefixtures("xray_data")

POWER_LAW = Prior({"powerlaw_1.alpha": Uniform(0.5, 3.5), "powerlaw_1.norm": LogUniform(1e-4, 1.0)})
LINE = Effect(
    "emission_line",
    {"energy": Uniform(4.0, 8.0), "sigma": Uniform(0.02, 2.0), "norm": Uniform(0.0, 1e-3)},
)
COVERING = Effect("partial_covering", {"nh": LogUniform(1.0, 500.0), "fraction": Uniform(0.0, 1.0)})


@pytest.fixture(scope="session")
def mcg6(shared_file):
    """XMM EPIC-pn of MCG-6-30-15: spectrum, RMF, ARF, background."""
    return [
        shared_file(f"data/mcg6_pn/{name}")
        for name in ("pn_spec_grp.fits", "pn.rmf.gz", "pn.arf", "pn_bg_spec.fits")
    ]


@pytest.fixture(scope="session")
def iron_band(mcg6):
    """Its 3 to 10 keV."""
    return Spectrum.from_ogip(*mcg6, band=(3.0, 10.0))


@pytest.fixture(scope="session")
def ngc7793():
    """Files of XMM EPIC-pn of NGC 7793 ULX-4, from the cache."""
    names = ("PN_spectrum_grp20.fits", "PN.rmf", "PN.arf", "PNbackground_spectrum.fits")
    return [data.path(data.EXAMPLE + name) for name in names]


def deviance(counts, mean):
    """Cash's statistic per channel, 0 where both agree."""
    logs = counts * np.log(np.where(counts > 0, counts, 1.0) / mean)
    return 2.0 * (mean - counts + logs)


def smallest(simulator, counts, start):
    """Least C-stat and where it is, by SciPy, from one start."""
    unit = 0.05 * np.abs(start)

    def target(u):
        theta = start + unit * u
        mean = simulator.expected(theta)
        slope = 2.0 * ((1.0 - counts / mean) @ simulator.jacobian(theta)) * unit
        return float(deviance(counts, mean).sum()), slope

    support = np.array([marginal.support for marginal in simulator.prior.marginals.values()])
    bounds = [tuple(pair) for pair in (support - start[:, None]) / unit[:, None]]
    found = minimize(target, np.zeros(len(start)), jac=True, bounds=bounds, method="L-BFGS-B",
                     options={"maxiter": 2000, "maxfun": 4000, "ftol": 1e-13, "gtol": 1e-6})  # fmt: skip
    return float(found.fun), start + unit * found.x


def test_iron_in_mcg_6_30_15_is_a_broad_line_or_partial_covering_alike(iron_band):
    simulator = XraySpectrum("powerlaw", iron_band.response, POWER_LAW, integration="exact")
    counts = iron_band.counts.astype(float)
    plain, theta = smallest(simulator, counts, np.array([1.8, 0.01]))
    line, at_line = smallest(simulator.with_effect(LINE), counts, np.array([*theta, 6.2, 0.6, 7e-5]))
    covered, at_cover = smallest(simulator.with_effect(COVERING), counts, np.array([2.2, 0.028, 41.0, 0.43]))
    assert [plain, line, covered] == pytest.approx([410.07, 189.09, 188.82], abs=0.05)
    assert at_line[2:4] == pytest.approx([6.25, 0.557], abs=0.02)
    assert at_cover[2:] == pytest.approx([41.5, 0.426], abs=0.5)


def test_the_withheld_background_of_ngc_7793_is_worth_one_sigma(ngc7793):
    spectrum = Spectrum.from_ogip(*ngc7793, band=(0.5, 8.0))
    prior = Prior({
        "tbabs_1.nh": LogUniform(0.005, 2.0), "powerlaw_1.alpha": Uniform(0.0, 6.0),
        "powerlaw_1.norm": LogUniform(1e-6, 1e-2), "blackbodyrad_1.kT": Uniform(0.1, 5.0),
        "blackbodyrad_1.norm": LogUniform(1e-4, 10.0),
    })  # fmt: skip
    simulator = XraySpectrum("tbabs*(powerlaw+bbodyrad)", spectrum.response, prior, integration="exact")
    counts, background = spectrum.counts.astype(float), spectrum.background * spectrum.background_scale
    assert background.sum() / counts.sum() == pytest.approx(0.0206, abs=2e-4)
    _, theta = smallest(simulator, counts, np.array([0.094, 2.03, 2.6e-4, 0.74, 0.2]))
    mean = simulator.expected(theta)
    columns = simulator.jacobian(theta) / np.sqrt(mean)[:, None]
    basis = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))[0]
    shape = background / np.sqrt(mean)
    assert np.linalg.norm(shape) == pytest.approx(3.23, abs=0.05)
    assert np.linalg.norm(shape - basis @ (basis.T @ shape)) == pytest.approx(1.15, abs=0.05)


def search(*files, **options):
    """The whole workflow on one spectrum, and the observation that it searched."""
    found = read_observation(*files, **options)
    sources = Sources(found.simulator, found.counts, found.scale, found.redshift, found.names)
    return discover_source(sources, seed=1), found


@pytest.mark.slow
def test_of_what_a_source_may_do_the_search_leaves_the_line_and_the_covering(mcg6):
    """More effective area in the shape of the line fits as well: only calibration can exclude that."""
    pha, rmf, arf, background = mcg6
    found, observation = search(
        pha, model="powerlaw", rmf=rmf, arf=arf, background=background, band=(3.0, 10.0)
    )
    assert found.p_global <= 0.01
    library = observation.simulator.effect_library(observation.simulator.prior.center[None])
    alike = {name for name in found.indistinguishable if name in library and library[name].origin == "source"}
    assert alike == {"emission_line", "partial_covering"}
    gap = found.to_json()["gap"]["held_out"]
    assert gap["after"] < gap["before"] - 0.15


@pytest.mark.slow
def test_the_withheld_background_of_ngc_7793_is_not_named(ngc7793):
    pha, rmf, arf, _ = ngc7793
    found, _ = search(
        pha, model="tbabs*(powerlaw+bbodyrad)", rmf=rmf, arf=arf, background="none", band=(0.5, 8.0)
    )
    assert found.named is None
    assert found.p_global > 0.01
    assert found.candidate("background").p_global > 0.01


@pytest.mark.slow
def test_what_an_imperfect_response_leaves_of_a_hundred_million_counts_is_not_named(shared_file):
    names = ("nicer_unbinned.pha", "nicer.rmf.gz", "nicer.arf")
    pha, rmf, arf = (shared_file(f"data/maxij1820_nicer/{name}") for name in names)
    found, _ = search(
        pha, model="tbabs*(bbodyrad+powerlaw)", rmf=rmf, arf=arf, background="none", band=(0.5, 10.0)
    )
    assert found.p_global <= 0.01
    assert found.named == "unnamed"
    assert found.named_all == ()
