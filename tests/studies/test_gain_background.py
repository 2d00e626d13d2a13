"""Gains in spectra with a background in the model: its parts against the simulator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

pytest.importorskip("jaxspec")
from studies.gain.behind import LEVEL, WithRegion, background
from studies.gain.models import AREA_ENERGIES, AREA_WIDTH, Spectrum, table
from studies.gain.pools import GainPool, score, simulator_of
from studies.gain.sweep import pools

from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name.shared_score import SharedScores
from gaugeblock.discovery.name.stacked import stack
from gaugeblock.simulators import Effect
from gaugeblock.simulators.xray import data

pytestmark = pytest.mark.usefixtures("xray_data")
REGION = WithRegion()


def test_the_background_is_the_measured_one_fifty_times_as_bright():
    from astropy.io import fits

    with fits.open(data.path(data.EXAMPLE + "PNbackground_spectrum.fits")) as file:
        header, table_ = file["SPECTRUM"].header, file["SPECTRUM"].data
        # Channels of 5 eV each: those of 0.5 to 8 keV.
        counts = np.asarray(table_["COUNTS"])[100:1600].sum()
    with fits.open(data.path(data.EXAMPLE + "PN_spectrum_grp20.fits")) as file:
        ratio = file["SPECTRUM"].header["BACKSCAL"] / header["BACKSCAL"]
    rate = background().shape.rate(background().prior.center).sum()
    assert rate == pytest.approx(LEVEL * counts * ratio / header["EXPOSURE"], rel=0.05)


def test_the_background_is_as_bright_as_the_page_says():
    pool = pools(REGION)["bright_clean_small"]
    expected = REGION.simulator.expected(pool.draw(0, 77)[0])
    behind = (expected[:, 102:] * background().scale).sum(axis=1)
    share = behind / expected[:, :102].sum(axis=1)
    assert np.median(share) == pytest.approx(1 / 5, abs=0.03)
    assert np.mean(share > 0.5) == pytest.approx(1 / 6, abs=0.05)


def test_what_is_fitted_is_what_is_drawn():
    rng = np.random.default_rng(1)
    theta = REGION.simulator.prior.sample(5, rng)
    assert REGION.fitted.prior.names == REGION.simulator.prior.names
    exact = REGION.simulator.expected(theta)
    np.testing.assert_allclose(REGION.fitted.expected(theta), exact, rtol=2e-6)
    np.testing.assert_allclose(
        REGION.fitted.jacobian(theta), REGION.simulator.jacobian(theta), rtol=2e-4, atol=1e-5 * exact.max()
    )


def test_a_gain_moves_the_source_alone():
    theta = REGION.simulator.prior.sample(3, np.random.default_rng(2))
    plain = REGION.simulator.expected(theta)
    shifted = simulator_of(REGION, "gain_slope", 1.01).expected(theta)
    alone = Spectrum("exact")
    moved = simulator_of(alone, "gain_slope", 1.01).expected(theta[:, :5]) - table(alone).expected(
        theta[:, :5]
    )
    np.testing.assert_allclose(shifted[:, :102] - plain[:, :102], moved, atol=2e-5 * plain.max())
    np.testing.assert_array_equal(shifted[:, 102:], plain[:, 102:])
    template = REGION.over(moved)
    np.testing.assert_array_equal(template, np.concatenate([moved, np.zeros((3, 102))], axis=1))


def test_scores_are_those_of_one_linear_model_of_both_regions():
    """Against least squares of all data at once: a slope, an offset and a bump in the area."""
    pool = pools(REGION, part=0.001)["bright_gain_slope_1.005_small"]
    found, counts = score(pool, 0, 5, 2), pool.draw(0, 5)[1][:2]
    fitted = fit(pool.model, counts, seed=0)
    source = fitted.theta[:, :5]

    def difference(name, step):
        ends = [table(REGION.source, name, *at).expected(source) for at in step]
        return ends[1] - ends[0]

    slope, offset = pool.steps["gain_slope"], pool.steps["gain_offset"]
    bump = {"energy": AREA_ENERGIES[0], "width": AREA_WIDTH * AREA_ENERGIES[0], "depth": 0.02}
    dimmer = REGION.source.simulator.with_effect(Effect("effective_area", bump)).expected(source)
    changes = np.stack(
        [
            difference("gain_slope", [(1 - slope,), (1 + slope,)]) / (2 * slope),
            difference("gain_offset", [(-offset,), (offset,)]) / (2 * offset),
            (dimmer - table(REGION.source).expected(source)) / 0.02,
        ]
    )
    for k in range(2):
        theta = fitted.theta[k][None]
        mean, own = pool.model.expected(theta)[0], pool.model.jacobian(theta)[0]
        root = np.sqrt(mean)
        templates = np.concatenate([changes[:, k], np.zeros((3, 102))], axis=1).T / root[:, None]
        own = own / root[:, None]
        left = templates - own @ np.linalg.lstsq(own, templates)[0]
        products, seen = left.T @ left, left.T @ ((counts[k] - mean) / root)
        near = {"rel": 2e-3}
        assert found["information"][k, 1] == pytest.approx(products[0, 0], **near)
        assert found["cross"][k, 1, 1:3] == pytest.approx(products[0, 1:], **near)
        information = found["nuisance_information"][k, 1:3, 1:3]
        np.testing.assert_allclose(information, products[1:, 1:], rtol=1e-2)
        assert found["score"][k, 1] == pytest.approx(seen[0], rel=1e-2, abs=0.5)
        assert found["nuisance_score"][k, 1:3] == pytest.approx(seen[1:], rel=1e-2, abs=0.5)


def test_without_a_gain_scores_are_centred_and_with_one_they_are_not():
    planned = pools(REGION, part=0.015)
    z = {}
    for name in ("bright_clean_small", "bright_gain_slope_1.005_small"):
        found = SharedScores(*(values.astype(float) for values in score(planned[name], 0, 7, 60).values()))
        z[name] = float(stack(found.with_templates([1]).with_nuisances([]), []).z[0])
    # 60 sources: a slope of 0.5% is expected at some 27 sqrt(60 / 2000) = 4.7 without a background.
    assert abs(z["bright_clean_small"]) < stats.norm.ppf(1 - 5e-5)
    assert 1.5 < z["bright_gain_slope_1.005_small"] < 9.0


def test_other_pools_are_as_they_were():
    pool = GainPool("bright", "", 0.0, 10)
    assert pool.model is table(pool.spectrum)
    templates = np.ones((2, 3, 102))
    assert pool.spectrum.over(templates) is templates
    assert pool.spectrum.source is pool.spectrum
