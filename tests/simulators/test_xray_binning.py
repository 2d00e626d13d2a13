"""Channels grouped by resolution: measured in the response, whatever the counts."""

import numpy as np
import pytest

pytest.importorskip("jaxspec")
from gaugeblock.simulators.xray import Response, data
from gaugeblock.simulators.xray.library import scale
from gaugeblock.simulators.xray.reader import grouped, resolution, resolution_grouping

pytestmark = pytest.mark.usefixtures("xray_data")


@pytest.fixture(scope="module")
def pn():
    return Response.from_ogip(*(data.path(data.EXAMPLE + n) for n in ("PN.rmf", "PN.arf")), exposure=1.0)


def test_resolution_is_the_full_width_at_half_maximum():
    from scipy.sparse import csr_array
    from scipy.stats import norm

    edges = np.linspace(0.0, 10.0, 1001)
    fine = np.stack([edges[:-1], edges[1:]], axis=1)
    energies = np.linspace(0.5, 9.5, 300)
    sigma = 0.03 + 0.01 * energies
    matrix = np.diff(norm.cdf(edges[:, None], energies, sigma), axis=0)
    matrix[matrix < 1e-6] = 0.0
    found = resolution(csr_array(matrix), fine)
    inside = (fine[:, 0] > 0.6) & (fine[:, 1] < 9.4)
    expected = 2.3548 * (0.03 + 0.01 * fine.mean(axis=1))
    # Whole channels are counted, of 10 eV.
    assert np.abs(found - expected)[inside].max() < 0.021
    # Of how much there is nothing depends, whether photons or cm2.
    assert np.array_equal(resolution(csr_array(matrix / 4096), fine), found)
    flags = resolution_grouping(csr_array(matrix), fine)
    starts = np.append(np.flatnonzero(flags == 1), 1000)
    widths = edges[starts[1:]] - edges[starts[:-1]]
    wanted = found[starts[:-1]] / 3
    assert np.all(widths[:-1] > wanted[:-1] - 1e-9)
    assert np.all(widths[:-1] < wanted[:-1] + 0.01 + 1e-9)


def test_a_channel_at_exactly_half_the_peak_belongs_to_its_width():
    """By hand, channels of unlike widths; where no photon is recorded, a channel is what it is."""
    from scipy.sparse import csr_array

    edges = np.array([0.0, 1.0, 3.0, 4.0, 6.0, 7.0, 8.0])
    fine, width = np.stack([edges[:-1], edges[1:]], axis=1), np.diff(edges)
    density = np.array([1.2, 1.0, 2.0, 1.0, 0.98, 1.6])
    assert resolution(csr_array((density * width)[:, None]), fine).tolist() == [6.0] * 6
    two = np.stack([density * width, np.eye(6)[5]], axis=1)
    # Straight between the peaks, at 3.5 and 7.5.
    np.testing.assert_allclose(resolution(csr_array(two), fine), [6.0, 6.0, 6.0, 4.125, 2.25, 1.0])
    for matrix in (csr_array((6, 2)), csr_array((np.zeros(2), ([1, 2], [0, 1])), shape=(6, 2))):
        assert resolution(matrix, fine).tolist() == width.tolist()


def test_epic_pn_has_its_resolution(pn):
    found = resolution(pn.redistribution, pn.fine_channels)
    energy = pn.fine_channels.mean(axis=1)
    for line in (1.5, 6.4):
        nearest = int(np.argmin(np.abs(pn.energies.mean(axis=1) - line)))
        weight = pn.redistribution[:, [nearest]].toarray()[:, 0] * (np.abs(energy - line) < 0.25)
        sd = np.sqrt(np.average((energy - line) ** 2, weights=weight))
        assert np.interp(line, energy, found) == pytest.approx(2.3548 * sd, rel=0.1)


def test_flags_group_or_do_not():
    assert not grouped(None)
    assert not grouped(np.ones(4, int))
    assert grouped(np.array([1, -1]))


def test_widths_that_jump_are_smoothed_by_medians_of_five():
    """Bins of so many equal channels around a higher one: medians of five, the ends repeated."""
    from scipy.sparse import csr_array

    channels = np.array([1, 5, 3, 1, 7, 3, 9, 1, 5])
    fine = np.stack([np.arange(90.0), np.arange(1.0, 91.0)], axis=1)
    matrix = np.zeros((90, len(channels)))
    for j, number in enumerate(channels):
        middle = 5 + 10 * j
        matrix[middle - number // 2 : middle + number // 2 + 1, j] = 1.0
        matrix[middle, j] = 1.5
    around = [np.clip(np.arange(j - 2, j + 3), 0, 8) for j in range(9)]
    expected = [np.sort(channels[near])[2] for near in around]
    found = resolution(csr_array(matrix), fine)
    np.testing.assert_allclose(found[5 + 10 * np.arange(9)], expected)
    assert found[10] == pytest.approx((expected[0] + expected[1]) / 2)


def test_energies_of_the_band_and_the_resolution_there():
    """What the library spaces its lines by, of lines whose widths are known."""
    from scipy.sparse import csr_array
    from scipy.stats import norm

    edges, bins = np.linspace(0.0, 10.0, 1001), np.linspace(0.5, 9.5, 301)
    fine = np.stack([edges[:-1], edges[1:]], axis=1)
    middle = 0.5 * (bins[:-1] + bins[1:])
    sigma = 0.03 + 0.01 * middle
    matrix = np.diff(norm.cdf(edges[:, None], middle, sigma), axis=0)
    used = (fine[:, 0] >= 2.0 - 1e-9) & (fine[:, 1] <= 5.0 + 1e-9)
    response = Response(
        "made", np.stack([bins[:-1], bins[1:]], axis=1), fine[used], fine, np.ones(300), csr_array(matrix),
        csr_array(np.eye(1000)[used]), 1.0,
    )  # fmt: skip
    energy, found = scale.resolution(response)
    inside = (middle >= 2.0) & (middle <= 5.0)
    np.testing.assert_allclose(energy, middle[inside], rtol=1e-12)
    # Whole channels are counted, of 10 eV.
    assert np.abs(found - sigma[inside]).max() < 0.021 / 2.3548
    # From 2 to 5 keV there are some 3 keV / 65 eV of them; of few, in the middle of equal shares.
    at = scale.spaced(response, 1000)
    assert len(at) == pytest.approx(np.log(0.08 / 0.05) / 0.01, abs=2)
    np.testing.assert_allclose(np.diff(at) / (0.03 + 0.01 * 0.5 * (at[1:] + at[:-1])), 1.0, atol=0.08)
    few = scale.spaced(response, 4)
    shares = np.log((0.03 + 0.01 * few) / 0.05) / np.log(0.08 / 0.05)
    np.testing.assert_allclose(shares, [0.125, 0.375, 0.625, 0.875], atol=0.02)
