"""Exact bin integration: against far finer grids, at edges, under gains, and what it must not change."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.stats import norm

from gaugeblock.core.errors import InputError
from gaugeblock.core.precision import double_precision
from gaugeblock.simulators import Effect, Prior, Uniform

pytest.importorskip("jaxspec")
import jax

from gaugeblock.simulators.xray import Response, XraySpectrum, build, reference
from gaugeblock.simulators.xray.components import COMPONENTS
from gaugeblock.simulators.xray.cross_sections import table, table_breaks
from gaugeblock.simulators.xray.expression import leaves, parameter_names, parse
from gaugeblock.simulators.xray.integration import Pieces, evaluator

pytestmark = pytest.mark.usefixtures("xray_data")


def refined(response, times):
    """The same instrument with every input bin cut into equal parts."""
    low, high = response.energies.T
    edges = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, times + 1)
    return replace(
        response,
        energies=np.stack([edges[:, :-1].ravel(), edges[:, 1:].ravel()], axis=1),
        area=np.repeat(response.area, times),
        redistribution=response.redistribution.tocsc()[:, np.repeat(np.arange(len(low)), times)].tocsr(),
    )


def counter(low, high):
    """An instrument of 1 cm2 and 1 s whose channels are its input bins."""
    energies = np.stack([low, high], axis=1)
    eye = csr_array(np.eye(len(low)))
    return Response("counter", energies, energies, energies, np.ones(len(low)), eye, eye, 1.0)


@pytest.fixture(scope="module")
def coarse():
    return reference(level="bright")


@pytest.fixture(scope="module")
def exact():
    return reference(level="bright", integration="exact")


@pytest.fixture(scope="module")
def theta(coarse):
    return coarse.prior.sample(32, np.random.default_rng(0))


@pytest.fixture(scope="module")
def truth(coarse, theta):
    return XraySpectrum(coarse.model, refined(coarse.response, 16), coarse.prior).expected(theta)


def test_expected_counts_are_those_of_a_grid_16_times_finer(coarse, exact, theta, truth):
    error = np.abs(exact.expected(theta) - truth)
    assert np.max(error / truth) < 1e-5
    assert np.max(error / np.sqrt(truth)) < 1e-3
    # What the option is for: jaxspec's rule is off by a thousandth beside the oxygen edge.
    assert np.max(np.abs(coarse.expected(theta) / truth - 1.0)) > 1e-3


def test_same_bits_whatever_the_batch(exact, theta):
    together = exact.expected(np.concatenate([theta] * 5))
    np.testing.assert_array_equal(together[-len(theta) :], exact.expected(theta))
    np.testing.assert_array_equal(exact.expected(theta[7]), together[7])


def test_a_free_gain_at_its_fixed_value_gives_the_same(exact, theta):
    for factor in (1.0, 0.97):
        fixed = exact.with_effect(Effect("published_gain", {"factor": factor}))
        free = exact.with_effect(Effect("published_gain", {"factor": Uniform(0.9, 1.1)}))
        there = np.concatenate([theta, np.full((len(theta), 1), factor)], axis=1)
        np.testing.assert_allclose(free.expected(there), fixed.expected(theta), rtol=1e-10)


def test_the_effect_of_a_gain_is_in_proportion_to_it_down_to_a_ten_thousandth(coarse, exact, theta):
    """The part of the change that no source parameter can copy: its power over the squared step is constant.

    What changes between 0.01% and 1% is the curvature of the effect, 5%. By jaxspec's rule it is 30-fold.
    """
    gain = Effect("published_gain", {"factor": Uniform(0.9, 1.1)})

    def powers(simulator):
        free = simulator.with_effect(gain)
        start = np.concatenate([theta, np.ones((len(theta), 1))], axis=1)
        mean, jacobian = free.expected(start), free.jacobian(start)
        weighted = jacobian[..., :5] / np.sqrt(mean)[..., None]
        basis = np.linalg.qr(weighted / np.linalg.norm(weighted, axis=1, keepdims=True))[0]

        def power(change):
            scaled = change / np.sqrt(mean)
            rest = scaled - np.einsum("ncp,ndp,nd->nc", basis, basis, scaled)
            return np.sum(rest**2, axis=1)

        derivative = power(jacobian[..., 5])
        steps = [1e-4, 1e-3, 3e-3]
        return [power(free.expected(start + np.eye(6)[5] * h) - mean) / h**2 / derivative for h in steps]

    for ratio in powers(exact):
        np.testing.assert_allclose(ratio, 1.0, atol=0.1)
    assert not any(np.median(np.abs(ratio - 1.0)) < 0.1 for ratio in powers(coarse))


def test_counts_change_with_the_gain_as_those_of_the_fine_grid_do(coarse, exact, theta):
    fine = XraySpectrum(coarse.model, refined(coarse.response, 16), coarse.prior)
    with_gain = [s.with_effect(Effect("published_gain", {"factor": 1.001})) for s in (exact, fine)]
    change, expected = (
        s.expected(theta) - p.expected(theta) for s, p in zip(with_gain, (exact, fine), strict=True)
    )
    np.testing.assert_allclose(change, expected, atol=2e-2 * np.abs(expected).max())


WINDOWS = np.r_[
    0.52:0.58:0.01, 0.7:0.73:0.01, 1.84:1.86:0.01, 2.0:2.1:0.02, 2.34:2.36:0.01, 2.99:3.01:0.01, 7.1:7.16:0.02
]
"""Lower edges of bins 10 eV wide, with gaps: around the tables' edges, and those of PARAMETERS.

A fine bin is off unless a jump is in its middle, so that is where `E_c` is."""

PARAMETERS = {
    "alpha": 1.3, "beta": 4.0, "norm": 0.7, "kT": 0.8, "El": 2.05, "sigma": 0.05, "redshift": 0.01,
    "E_l": 2.0, "alpha1": -0.5, "alpha2": -2.0, "Ec": 2.996, "nh": 0.1, "f": 0.4, "z": 0.15, "A": 0.5,
    "E_c": 2.34 + 0.01 * 256.5 / 512, "Ef": 5.0,
}  # fmt: skip
EMISSION = "+".join(sorted({name for name, entry in COMPONENTS.items() if entry.additive and not entry.ours}))
FACTORS = "*".join(
    sorted({name for name, entry in COMPONENTS.items() if entry.kind == "factor" and not entry.ours})
)


@pytest.mark.parametrize("model", [EMISSION, FACTORS + "*powerlaw"], ids=["emission", "factors"])
def test_every_component_is_integrated_as_on_a_grid_512_times_finer(model):
    response = counter(WINDOWS, WINDOWS + 0.01)
    names = parameter_names(parse(model))
    values = np.array([PARAMETERS[name.split(".")[1]] for name in names])
    prior = Prior(
        {name: Uniform(value - 0.1, value + 0.1) for name, value in zip(names, values, strict=True)}
    )
    exact = XraySpectrum(model, response, prior, integration="exact").expected(values)
    truth = XraySpectrum(model, refined(response, 512), prior).expected(values)
    np.testing.assert_allclose(exact, truth, rtol=5e-5)


def test_an_edge_that_theta_moves_is_followed():
    """Smoothly: a step of 0.01% in 1 + z moves the edge by a hundredth of a bin."""
    low = np.arange(0.43, 0.5, 0.01)
    response = counter(low, low + 0.01)
    names = ("ztbabs_1.nh", "ztbabs_1.z", "powerlaw_1.alpha", "powerlaw_1.norm")
    prior = Prior({name: Uniform(0.0, 3.0) for name in names})
    simulator = XraySpectrum("ztbabs*powerlaw", response, prior, integration="exact")
    center = np.array([0.8, 0.2, 1.5, 1e5])
    truth = XraySpectrum("ztbabs*powerlaw", refined(response, 512), prior).expected(center)
    np.testing.assert_allclose(simulator.expected(center), truth, rtol=5e-5)
    step = np.array([0.0, 1e-4, 0.0, 0.0])
    difference = (simulator.expected(center + step) - simulator.expected(center - step)) / 2e-4
    derivative = simulator.jacobian(center)[:, 1]
    np.testing.assert_allclose(difference, derivative, atol=0.02 * np.abs(derivative).max())


def test_gaps_between_input_bins_hold_no_photons():
    edges = np.arange(0.5, 2.0, 0.05)
    whole = counter(edges[:-1], edges[1:])
    keep = np.r_[0:5, 9:20, 21 : len(edges) - 1]
    parts = counter(edges[:-1][keep], edges[1:][keep])
    prior = reference().prior
    theta = prior.sample(4, np.random.default_rng(2))
    for effects in ((), (Effect("published_gain", {"factor": Uniform(0.9, 1.1)}),)):
        at = theta if not effects else np.concatenate([theta, np.full((4, 1), 1.02)], axis=1)
        one, other = (
            XraySpectrum(reference().model, r, prior, effects=effects, integration="exact").expected(at)
            for r in (whole, parts)
        )
        np.testing.assert_allclose(other, one[:, keep], rtol=1e-10)


def test_a_table_breaks_at_the_edges_of_oxygen_iron_and_silicon():
    energies = table_breaks("xsect_tbabs_wilm.fits")
    for edge in (0.543, 0.708, 1.846, 7.124):
        assert np.min(np.abs(energies / edge - 1.0)) < 2e-3


@pytest.mark.parametrize("file", ["xsect_tbabs_wilm.fits", "xsect_wabs_angr.fits"])
def test_a_table_breaks_wherever_it_has_bent_by_one_and_across_ramps_in_steps(file):
    """Node by node: bends in the logarithms add up, less where the cross-section is below 1e-23 cm2."""
    energy, sigma = table(file)
    x, y = np.log(energy), np.log(sigma)
    expected, bent = set(), 0.0
    for i in range(len(energy) - 1):
        rise = y[i + 1] - y[i]
        if abs(rise) > 0.15:
            parts = int(np.ceil(abs(rise) / 0.15))
            expected |= {energy[i] + (energy[i + 1] - energy[i]) * k / parts for k in range(parts + 1)}
        if i:
            before = bent
            change = rise / (x[i + 1] - x[i]) - (y[i] - y[i - 1]) / (x[i] - x[i - 1])
            bent += abs(change) * min(10 * sigma[i], 1.0)
            if np.floor(bent) > np.floor(before):
                expected.add(energy[i])
    found = table_breaks(file)
    assert np.all(np.diff(found) > 0)
    np.testing.assert_allclose(
        np.unique(np.round(found, 9)), np.unique(np.round(sorted(expected), 9)), rtol=1e-8
    )


def test_the_default_is_jaxspec_s_and_keeps_its_identity(coarse, exact):
    assert coarse.integration == "jaxspec"
    assert "integration" not in coarse.describe()
    assert exact.describe() == {**coarse.describe(), "integration": "exact"}
    built = build(level="bright", integration="exact")
    assert built.with_effect(Effect("gain_slope", {"slope": 1.01})).integration == "exact"
    assert built.with_exposure(5.0).describe()["integration"] == "exact"


def test_bad_input_in_one_line(coarse):
    with pytest.raises(InputError, match="integration: there are jaxspec and exact, got 'fine'"):
        reference(integration="fine")
    low = np.array([1.0, 1.1, 1.2])
    overlapping = XraySpectrum(coarse.model, counter(low, low + 0.15), coarse.prior, integration="exact")
    with pytest.raises(InputError, match="input bins overlap"):
        overlapping.expected([0.2, 2.0, 1e-3, 1.0, 0.1])


def test_tables_are_looked_up_once_where_energies_are_known(exact):
    """A program that looks them up again for every batch compiles three times as long."""
    theta = exact.prior.sample(1, np.random.default_rng(0))[0]
    moving = XraySpectrum(
        "zashift*(tbabs*powerlaw)", exact.response,
        Prior({"zashift_1.redshift": Uniform(0.0, 0.1), "tbabs_1.nh": Uniform(0.0, 1.0),
               "powerlaw_1.alpha": Uniform(1.0, 3.0), "powerlaw_1.norm": Uniform(0.0, 1.0)}),
    )  # fmt: skip
    for spectrum, values, searches in ((exact, theta, False), (moving, np.full(4, 0.05), True)):
        with double_precision():
            program = str(jax.make_jaxpr(spectrum.expected_jax)(values))
        assert ("searchsorted" in program) is searches
        assert ("gather" in program) is searches


@pytest.mark.parametrize("known", [True, False])
def test_a_line_has_its_photons_and_their_energy_in_every_piece(known):
    """By the normal distribution's own moments: photons at two nodes stand for all of a straight emission."""
    edges = np.linspace(5.0, 7.0, 41)
    leaf = next(iter(leaves(parse("gauss"))))
    values = {"El": 6.1, "sigma": 0.4, "norm": 3.0}
    with double_precision():
        ends = (edges[:-1], edges[1:]) if known else tuple(map(jax.numpy.asarray, (edges[:-1], edges[1:])))
        pieces = Pieces(*ends)
        photons, energies = np.asarray(evaluator(leaf)(values, pieces)), np.asarray(pieces.nodes)
    line = norm(values["El"], values["sigma"])
    share, height = np.diff(line.cdf(edges)), np.diff(line.pdf(edges))
    np.testing.assert_allclose(photons.sum(axis=0), 3.0 * share, rtol=1e-12)
    whole = 3.0 * (values["El"] * share - values["sigma"] ** 2 * height)
    np.testing.assert_allclose((photons * energies).sum(axis=0), whole, rtol=1e-6)
    # What is exact of straight emission is far better than all photons in the middle.
    middle = 3.0 * share * 0.5 * (edges[1:] + edges[:-1])
    assert np.abs((photons * energies).sum(axis=0) - whole).max() < 0.02 * np.abs(middle - whole).max()
