"""What effects do to the photons, against formulas evaluated here once more, bin by bin."""

import numpy as np
import pytest
from scipy.special import erf

from gaugeblock.simulators import Effect, LogUniform, Prior, Uniform

pytest.importorskip("jaxspec")
from gaugeblock.simulators.xray import XraySpectrum, data, double_precision, reference
from gaugeblock.simulators.xray.cross_sections import TBABS, cross_section, table
from gaugeblock.simulators.xray.reference import epic_pn

pytestmark = pytest.mark.usefixtures("xray_data")

INDEX, NORM = 1.8, 1e-3
THETA = np.array([INDEX, NORM])
POINTS = 64


@pytest.fixture(scope="module")
def spectrum():
    """A power law through EPIC-pn, without an absorber."""
    prior = Prior({"powerlaw_1.alpha": Uniform(1, 3), "powerlaw_1.norm": LogUniform(1e-4, 1e-2)})
    return XraySpectrum("powerlaw", epic_pn().with_exposure(1e4), prior)


def folded(response, density):
    """Counts of a photon spectrum, photons/cm2/s/keV, summed over many points in each input bin."""
    low, high = response.energies.T
    step = (high - low) / POINTS
    energy = low[:, None] + (np.arange(POINTS) + 0.5) * step[:, None]
    return response.transfer @ (density(energy).sum(axis=1) * step)


def power_law(energy):
    return NORM * energy**-INDEX


def tbabs(energy):
    """The table's cross-sections, 1e-22 cm2."""
    from astropy.table import Table

    table = Table.read(data.path("xsect_tbabs_wilm.fits"))
    x, y = (np.log(np.asarray(table[name], dtype=float)) for name in ("ENERGY", "SIGMA"))
    return np.exp(np.interp(np.log(energy), x, y))


def gauss(energy, centre, sigma):
    return np.exp(-0.5 * ((energy - centre) / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))


def edges_of_ions(energy, ionisation, depth, at=0.739):
    """Hydrogen- and helium-like ions: threshold, abundance, nuclear charge, electrons, log xi of the peak."""
    ions = [
        (0.490, 2.40e-4, 6, 1, 1.1), (0.667, 7.59e-5, 7, 1, 1.5), (0.739, 4.90e-4, 8, 2, 1.2),
        (0.871, 4.90e-4, 8, 1, 1.9), (1.196, 8.71e-5, 10, 2, 1.6), (1.362, 8.71e-5, 10, 1, 2.2),
        (1.762, 2.51e-5, 12, 2, 1.9), (1.963, 2.51e-5, 12, 1, 2.4), (2.438, 1.86e-5, 14, 2, 2.1),
        (2.673, 1.86e-5, 14, 1, 2.6), (3.224, 1.23e-5, 16, 2, 2.4), (3.494, 1.23e-5, 16, 1, 2.8),
        (8.828, 2.69e-5, 26, 2, 3.4), (9.278, 2.69e-5, 26, 1, 3.9),
    ]  # fmt: skip
    weight = [
        a * (2.4 if n == 2 else 1) / z**2 * np.exp(-2 * (ionisation - peak) ** 2) for _, a, z, n, peak in ions
    ]
    tau = sum(
        w * np.where(energy >= e * at / 0.739, (energy / (e * at / 0.739)) ** -3, 0)
        for w, (e, *_) in zip(weight, ions, strict=True)
    )
    return np.exp(-depth * tau / sum(weight))


def half_space(energy, strength, width, line=6.4):
    edge = 7.112 * line / 6.4
    step = 0.5 * (1 + erf((energy - edge) / width / np.sqrt(2)))
    lost = 0.0239 * (energy * 6.4 / line / 5) ** -2.85 * (1 + 1.03 * step)
    root = np.sqrt(1 - 0.0079824 / (0.0079824 + lost))
    return 1 + strength * ((1 - root) / (1 + root) + 0.15 * line / 6.4 * gauss(energy, line, width))


CASES = {
    "emission_line": (
        {"energy": 2.2, "sigma": 0.03, "norm": 2e-4},
        lambda e: power_law(e) + 2e-4 * gauss(e, 2.2, 0.03),
    ),
    "soft_excess": (
        {"kT": 0.12, "norm": 300.0},
        lambda e: power_law(e) + 300 * 1.0344e-3 * e**2 / np.expm1(e / 0.12),
    ),
    "thermal_continuum": (
        {"kT": 1.5, "norm": 2e-3},
        lambda e: power_law(e) + 2e-3 * np.exp(-e / 1.5) / e,
    ),
    "absorption_line": (
        {"energy": 1.5, "sigma": 0.04, "strength": 0.06},
        lambda e: power_law(e) * np.exp(-0.06 * gauss(e, 1.5, 0.04)),
    ),
    "absorption_edge": (
        {"energy": 1.2003, "depth": 0.8},
        lambda e: power_law(e) * np.where(e >= 1.2003, np.exp(-0.8 * (e / 1.2003) ** -3), 1),
    ),
    "partial_covering": (
        {"nh": 5.0, "fraction": 0.6},
        lambda e: power_law(e) * (0.4 + 0.6 * np.exp(-5 * tbabs(e))),
    ),
    "high_energy_cutoff": (
        {"energy": 3.3, "inverse_folding": 0.4},
        lambda e: power_law(e) * np.where(e > 3.3, np.exp(-(e - 3.3) * 0.4), 1),
    ),
    "effective_area": (
        {"energy": 2.0, "width": 0.1, "depth": -0.3},
        lambda e: power_law(e) * (1 - 0.3 * np.exp(-0.5 * ((e - 2) / 0.1) ** 2)),
    ),
    "ionised_absorber": (
        {"energy": 0.75, "ionisation": 2.0, "depth": 1.2},
        lambda e: power_law(e) * edges_of_ions(e, 2.0, 1.2, 0.75),
    ),
    "reflection": (
        {"energy": 6.4, "width": 0.2, "strength": 2.0},
        lambda e: power_law(e) * half_space(e, 2.0, 0.2),
    ),
    # Off neutral: edge and hump move along with the line, the equivalent width with its energy.
    "reflection, receding": (
        {"energy": 5.2, "width": 0.3, "strength": 1.5},
        lambda e: power_law(e) * half_space(e, 1.5, 0.3, line=5.2),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_the_documented_formula(spectrum, name):
    parameters, density = CASES[name]
    # Free parameters: what is fixed is evaluated before anything is compiled.
    free = {
        key: Uniform(value - 0.2 * abs(value), value + 0.2 * abs(value)) for key, value in parameters.items()
    }
    changed = spectrum.with_effect(Effect(name.partition(",")[0], free)).expected(
        [*THETA, *parameters.values()]
    )
    expected = folded(spectrum.response, density)
    plain = spectrum.expected(THETA)
    # What a factor does within a bin of 5 eV, and two-point integration of an added continuum.
    np.testing.assert_allclose(changed, expected, rtol=4e-4 if name == "thermal_continuum" else 1e-4)
    assert np.abs(changed / plain - 1).max() > 0.05


def test_cross_sections_go_on_beyond_their_table_as_they_end():
    """Power laws through the last two nodes; the same whether energies are known when compiled or not."""
    import jax

    energy, sigma = table(TBABS)
    at = np.array([energy[0] / 3, energy[0], np.sqrt(energy[5] * energy[6]), energy[-1], 3 * energy[-1]])
    first, last = (np.log(sigma[k + 1] / sigma[k]) / np.log(energy[k + 1] / energy[k]) for k in (0, -2))
    expected = [sigma[0] * 3**-first, sigma[0], np.sqrt(sigma[5] * sigma[6]), sigma[-1], sigma[-1] * 3**last]
    np.testing.assert_allclose(cross_section(at, TBABS), expected, rtol=1e-10)
    with double_precision():
        moved = jax.jit(lambda energy, factor: cross_section(energy * factor, TBABS))(at, 1.0)
        np.testing.assert_allclose(np.asarray(moved), expected, rtol=1e-10)
        inside = jax.jit(lambda factor: factor * cross_section(at, TBABS))(1.0)
    np.testing.assert_allclose(np.asarray(inside), expected, rtol=1e-10)


@pytest.mark.parametrize("name", ["absorption_edge", "high_energy_cutoff"])
def test_what_is_sharp_moves_smoothly_through_a_bin(spectrum, name):
    prior = {"energy": Uniform(1, 7)}
    other = {"depth": 1.0} if name == "absorption_edge" else {"inverse_folding": 1.0}
    moving = spectrum.with_effect(Effect(name, {**prior, **other}))
    # From one edge of an input bin to the next: counts change in equal steps, not all at once.
    low, high = spectrum.response.energies[np.searchsorted(spectrum.response.energies[:, 0], 1.5)]
    rows = np.column_stack([np.tile(THETA, (11, 1)), np.linspace(low, high, 11)])
    steps = np.diff(moving.expected(rows).sum(axis=-1))
    assert np.all(steps > 0)
    assert steps.max() < 1.1 * steps.min()


def test_a_strength_is_an_equivalent_width_for_a_shallow_line(spectrum):
    counts = spectrum.expected(THETA)
    line = Effect("absorption_line", {"energy": 4.0, "sigma": 0.05, "strength": 1e-3})
    lost = (counts - spectrum.with_effect(line).expected(THETA)).sum()
    per_kev = (np.diff(spectrum.channels, axis=1).ravel() / counts)[
        np.argmin(np.abs(spectrum.channels.mean(axis=1) - 4.0))
    ]
    assert lost * per_kev == pytest.approx(1e-3, rel=0.1)


def test_reflection_of_strength_one_has_a_line_of_150_ev(spectrum):
    hump = spectrum.with_effect(Effect("reflection", {"energy": 6.4, "width": 0.01, "strength": 1.0}))
    without = folded(
        spectrum.response,
        lambda e: power_law(e) * (half_space(e, 1.0, 0.01) - 0.15 * gauss(e, 6.4, 0.01)),
    )
    line = folded(spectrum.response, lambda e: 0.15 * NORM * 6.4**-INDEX * gauss(e, 6.4, 0.01))
    assert (hump.expected(THETA) - without).sum() == pytest.approx(line.sum(), rel=2e-2)


def test_what_is_added_is_absorbed_and_what_covers_covers_all(spectrum):
    plain = reference(level="bright")
    theta = plain.prior.center
    thick = np.array([0.35, *theta[1:]])
    for name in ("soft_excess", "thermal_continuum"):
        with_more = plain.with_effect(Effect(name, CASES[name][0]))
        thin, less = (with_more.expected(t) - plain.expected(t) for t in (theta, thick))
        assert less[:20].sum() < 0.9 * thin[:20].sum()
    line = Effect("emission_line", {"energy": 1.0, "sigma": 0.02, "norm": 1e-2})
    cover = Effect("partial_covering", {"nh": 50.0, "fraction": 0.5})
    covered = plain.with_effect(line).with_effect(cover).expected(theta)
    other = plain.with_effect(cover).with_effect(line)
    np.testing.assert_allclose(covered, other.expected(theta), rtol=1e-12)
    soft = plain.channels[:, 1] < 1.5
    np.testing.assert_allclose(covered[soft], 0.5 * plain.with_effect(line).expected(theta)[soft], rtol=1e-3)


def test_a_free_published_gain_leaves_the_area_where_it_is(spectrum):
    dip = Effect("effective_area", {"energy": 2.0, "width": 0.2, "depth": -0.9})
    edge = Effect("absorption_edge", {"energy": 4.0, "depth": 3.0})
    free = Effect("published_gain", {"factor": Uniform(0.9, 1.1)})
    both = spectrum.with_effect(dip).with_effect(edge).with_effect(free)
    fixed = (
        spectrum.with_effect(Effect("published_gain", {"factor": 1.05})).with_effect(dip).with_effect(edge)
    )
    counts = both.expected(np.array([*THETA, 1.05]))
    np.testing.assert_allclose(counts, fixed.expected(THETA), rtol=1e-10)
    plain = spectrum.with_effect(Effect("published_gain", {"factor": 1.05})).expected(THETA)
    middle = spectrum.channels.mean(axis=1)
    ratio = counts / plain
    assert middle[np.argmin(np.where(middle < 3, ratio, 1))] == pytest.approx(2.0, abs=0.05)
    below, above = (ratio[np.abs(middle - e) < 0.06].mean() for e in (3.55, 4.15))
    assert below > 0.95
    assert above < 0.2
