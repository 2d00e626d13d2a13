"""Model expressions: what they mean, what they refuse, and agreement with the textbook formulas."""

import math

import mpmath
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import kn

from gaugeblock.core.errors import InputError

pytest.importorskip("jaxspec")
import jax
from astropy.table import Table

from gaugeblock.simulators.xray import data, double_precision
from gaugeblock.simulators.xray.components import COMPONENTS, REFUSED
from gaugeblock.simulators.xray.cross_sections import PHABS, WABS, cross_section, table
from gaugeblock.simulators.xray.expression import (
    Tied,
    leaves,
    parameter_names,
    parse,
    read_source,
    valued,
    with_sources,
    written,
)
from gaugeblock.simulators.xray.folding import photon_flux
from gaugeblock.simulators.xray.gaunt import RYDBERG, gaunt


def flux(expression, low, high, **values):
    """Photons/cm2/s per bin; ``powerlaw_1__alpha=2`` sets ``powerlaw_1.alpha``."""
    named = {name.replace("__", "."): value for name, value in values.items()}
    tree = parse(expression)
    assert set(parameter_names(tree)) == set(named)
    return photons(tree, named, low, high, "jaxspec")


def photons(tree, named, low, high, integration):
    """The same of a tree, compiled as one: operation by operation there would be a hundred programs."""
    with double_precision():
        made = photon_flux(tree, tuple(named), np.asarray(low), np.asarray(high), integration)
        return np.asarray(jax.jit(lambda theta: made(theta, 1))(np.array(list(named.values()))))


def test_case_and_spaces_do_not_matter_and_brackets_multiply():
    tree = parse("tbabs*(powerlaw+bbodyrad)")
    assert parse(" TBabs * ( PowerLaw + BBodyRad ) ") == tree
    assert parse("tbabs(powerlaw+bbodyrad)") == tree
    assert parameter_names(tree) == (
        "tbabs_1.nh", "powerlaw_1.alpha", "powerlaw_1.norm", "blackbodyrad_1.kT", "blackbodyrad_1.norm",
    )  # fmt: skip


@pytest.mark.usefixtures("xray_data")
def test_components_are_counted_from_the_left_and_each_gets_its_own_values():
    expression = "(powerlaw + gauss) + constant*(powerlaw + gauss + gaussian)"
    tree = parse(expression)
    labels = [leaf.bindings[-1][1] for leaf in leaves(tree)]
    assert labels == [
        "powerlaw_1.norm", "gauss_1.norm", "multiplicativeconstant_1.norm",
        "powerlaw_2.norm", "gauss_2.norm", "gauss_3.norm",
    ]  # fmt: skip
    edges = np.linspace(1.0, 8.0, 7001)
    values = {
        "powerlaw_1__alpha": 1.0, "powerlaw_1__norm": 0.0, "powerlaw_2__alpha": 0.0, "powerlaw_2__norm": 3.0,
        "multiplicativeconstant_1__norm": 10.0,
    }  # fmt: skip
    for k, (energy, norm) in enumerate([(2.5, 1.0), (4.5, 2.0), (6.5, 4.0)], start=1):
        values |= {f"gauss_{k}__El": energy, f"gauss_{k}__sigma": 0.01, f"gauss_{k}__norm": norm}
    expected = 30.0 + np.array([0, 1.0, 0, 20.0, 0, 40.0, 0])
    per_kev = flux(expression, edges[:-1], edges[1:], **values).reshape(7, 1000).sum(axis=-1)
    np.testing.assert_allclose(per_kev, expected, rtol=1e-6)


def rings(energy, temperature, norm):
    """Black-body rings of a disc, T = Tin r^(-3/4), summed over r, area 2 pi r dr."""

    def ring(log_r):
        r = math.exp(log_r)
        x = energy / temperature * r**0.75
        return 2.0 * r * r / math.expm1(x) if x < 600.0 else 0.0

    return norm * 1.0344e-3 * energy**2 * quad(ring, 0.0, 12.0, epsabs=0.0, epsrel=1e-9, limit=200)[0]


# Per XSPEC's manual, in photons/keV/cm2/s (emission) or as a factor; k: a value for every parameter.
FORMULAS = {
    "powerlaw": ({"alpha": 1.7, "norm": 2.0}, lambda e: 2.0 * e**-1.7),
    "bbody": ({"kT": 0.7, "norm": 2.0}, lambda e: 2.0 * 8.0525 * e**2 / (0.7**4 * np.expm1(e / 0.7))),
    "bbodyrad": ({"kT": 0.7, "norm": 2.0}, lambda e: 2.0 * 1.0344e-3 * e**2 / np.expm1(e / 0.7)),
    "blackbodyrad": ({"kT": 0.7, "norm": 2.0}, lambda e: 2.0 * 1.0344e-3 * e**2 / np.expm1(e / 0.7)),
    "cutoffpl": ({"alpha": 1.2, "beta": 4.0, "norm": 2.0}, lambda e: 2.0 * e**-1.2 * np.exp(-e / 4.0)),
    "gauss": (
        {"El": 3.0, "sigma": 0.4, "norm": 2.0},
        lambda e: 2.0 / (0.4 * np.sqrt(2 * np.pi)) * np.exp(-((e - 3.0) ** 2) / (2 * 0.4**2)),
    ),
    "zgauss": (
        {"El": 3.0, "sigma": 0.4, "redshift": 0.5, "norm": 2.0},
        lambda e: 2.0 / (1.5 * 0.4 * np.sqrt(2 * np.pi)) * np.exp(-((1.5 * e - 3.0) ** 2) / (2 * 0.4**2)),
    ),
    "lorentz": (
        {"E_l": 3.0, "sigma": 0.4, "norm": 2.0},
        lambda e: 2.0 * 0.4 / (2 * np.pi) / ((e - 3.0) ** 2 + 0.2**2),
    ),
    "grbm": (
        {"alpha1": -1.0, "alpha2": -2.0, "Ec": 3.0, "norm": 2.0},
        lambda e: (
            2.0 * (e / 100) ** -1.0 * np.exp(-e / 3.0)
            if e < 3.0
            else 2.0 * (3.0 / 100) ** 1.0 * (e / 100) ** -2.0 * np.exp(-1.0)
        ),
    ),
    "zpowerlw": ({"alpha": 1.7, "redshift": 0.3, "norm": 2.0}, lambda e: 2.0 * (1.3 * e) ** -1.7),
    "bknpower": (
        {"alpha1": 1.2, "BreakE": 3.0, "alpha2": 2.7, "norm": 2.0},
        lambda e: 2.0 * e**-1.2 if e <= 3.0 else 2.0 * 3.0**1.5 * e**-2.7,
    ),
    "logpar": ({"alpha": 1.7, "beta": 0.6, "norm": 2.0}, lambda e: 2.0 * e ** (-1.7 - 0.6 * math.log10(e))),
    "diskbb": ({"Tin": 0.9, "norm": 2.0}, lambda e: rings(e, 0.9, 2.0)),
    "zbbody": (
        {"kT": 0.7, "redshift": 0.3, "norm": 2.0},
        lambda e: 2.0 * 8.0525 * (1.3 * e) ** 2 / (1.3 * 0.7**4 * np.expm1(1.3 * e / 0.7)),
    ),
    "expabs": ({"Ec": 1.4}, lambda e: math.exp(-1.4 / e)),
    "zhighect": (
        {"Ec": 2.6, "Ef": 3.0, "redshift": 0.3},
        lambda e: math.exp(min((2.6 - 1.3 * e) / 3.0, 0.0)),
    ),
    "edge": ({"Ec": 3.3, "tau": 0.7}, lambda e: math.exp(-0.7 * (3.3 / e) ** 3) if e >= 3.3 else 1.0),
    "zedge": (
        {"Ec": 3.9, "tau": 0.7, "redshift": 0.3},
        lambda e: math.exp(-0.7 * (3.0 / e) ** 3) if e >= 3.0 else 1.0,
    ),
    "gabs": (
        {"El": 3.0, "sigma": 0.02, "strength": 0.04},
        lambda e: math.exp(
            -0.04 / (0.02 * math.sqrt(2 * math.pi)) * math.exp(-(((e - 3.0) / 0.02) ** 2) / 2)
        ),
    ),
    "cyclabs": (
        {"depth0": 0.8, "E0": 2.0, "width0": 0.5},
        lambda e: math.exp(-0.8 * (0.5 * e / 2.0) ** 2 / ((e - 2.0) ** 2 + 0.5**2)),
    ),
    "constant": ({"norm": 0.3}, lambda e: 0.3),
    "expfac": ({"A": 2.0, "f": 0.5, "E_c": 2.0}, lambda e: 1.0 + 2.0 * np.exp(-0.5 * e) * (e > 2.0)),
    "highecut": ({"Ec": 2.0, "Ef": 3.0}, lambda e: np.exp((2.0 - e) / 3.0) if e > 2.0 else 1.0),
}
FORMULAS["gaussian"] = FORMULAS["gauss"]
ELSEWHERE = {"bremss", "zbremss", "cflux", "zashift"}
"""Held against something else, below."""
ABSORBERS = {"tbabs": "xsect_tbabs_wilm", "phabs": "xsect_phabs_aspl", "wabs": "xsect_wabs_angr"}
TABLES = {
    "tbabs": ("tbabs", {"nh": 0.2}),
    "tbpcf": ("tbabs", {"nh": 0.2, "f": 0.3}),
    "ztbabs": ("tbabs", {"nh": 0.2, "z": 0.4}),
    "phabs": ("phabs", {"nh": 0.2}),
    "zphabs": ("phabs", {"nh": 0.2, "redshift": 0.4}),
    "pcfabs": ("phabs", {"nh": 0.2, "f": 0.3}),
    "zpcfabs": ("phabs", {"nh": 0.2, "f": 0.3, "redshift": 0.4}),
    "wabs": ("wabs", {"nh": 0.2}),
    "zwabs": ("wabs", {"nh": 0.2, "redshift": 0.4}),
}
"""The table that each absorber reads, and a value for every parameter."""


def spectrum_of(name, parameters, low, high):
    """The component alone, or times a flat spectrum of one photon/keV/cm2/s."""
    entry = COMPONENTS[name]
    values = {f"{entry.component.lower()}_1__{key}": value for key, value in parameters.items()}
    if entry.additive:
        return flux(name, low, high, **values)
    return flux(f"{name}*powerlaw", low, high, powerlaw_1__alpha=0.0, powerlaw_1__norm=1.0, **values)


def test_every_component_has_a_formula_to_be_held_against():
    assert set(FORMULAS) | set(TABLES) | ELSEWHERE == set(COMPONENTS)


@pytest.mark.parametrize("name", sorted(FORMULAS))
def test_a_component_is_what_xspec_says_it_is(name):
    parameters, formula = FORMULAS[name]
    entry = COMPONENTS[name]
    assert tuple(parameters) == tuple(p for p in entry.parameters if p not in entry.fixed)
    edges = np.linspace(1.0, 6.0, 2001)
    ours = spectrum_of(name, parameters, edges[:-1], edges[1:])
    chosen = slice(3, None, 97)
    theirs = [quad(formula, a, b)[0] for a, b in zip(edges[:-1][chosen], edges[1:][chosen], strict=True)]
    # Bins of 2.5 eV integrated from their two ends; exact where the component has an integral.
    np.testing.assert_allclose(ours[chosen], theirs, rtol=1e-4, atol=1e-9)


@pytest.mark.usefixtures("xray_data")
@pytest.mark.parametrize("name", sorted(TABLES))
def test_an_absorber_reads_its_own_table_at_the_photons_own_energy(name):
    of, parameters = TABLES[name]
    assert tuple(parameters) == COMPONENTS[name].parameters
    table = Table.read(data.path(f"{ABSORBERS[of]}.fits"))
    edges = np.linspace(1.0, 6.0, 2001)
    middle = 0.5 * (edges[1:] + edges[:-1]) * (1.0 + parameters.get("redshift", parameters.get("z", 0.0)))
    sigma = np.interp(middle, np.asarray(table["ENERGY"]), np.asarray(table["SIGMA"]))
    ours = spectrum_of(name, parameters, edges[:-1], edges[1:]) / np.diff(edges)
    covered = parameters.get("f", 1.0)
    expected = covered * np.exp(-parameters["nh"] * sigma) + 1.0 - covered
    # Away from edges the table is smooth; at one, a bin is averaged over both sides.
    assert np.quantile(np.abs(ours / expected - 1), 0.98) < 2e-3


MORRISON_MCCAMMON = [
    (0.284, 78.1, 18.8, 4.3), (0.4, 71.4, 66.8, -51.4), (0.532, 95.5, 145.8, -61.1),
    (0.707, 308.9, -380.6, 294.0), (0.867, 120.6, 169.3, -47.7), (1.303, 141.3, 146.8, -31.5),
    (1.84, 202.7, 104.7, -17.0), (2.471, 342.7, 18.7, 0.0), (3.21, 352.2, 18.7, 0.0),
    (4.038, 433.9, -2.4, 0.75), (7.111, 629.0, 30.9, 0.0), (8.331, 701.2, 25.2, 0.0),
]  # fmt: skip
"""Lower energy and coefficients of Morrison & McCammon 1983 (ApJ 270, 119), table 2: 1e-24 cm2 x keV^3."""


@pytest.mark.usefixtures("xray_data")
def test_the_table_of_wabs_is_that_of_morrison_and_mccammon():
    energy, sigma = table(WABS)
    starts, *coefficients = np.array(MORRISON_MCCAMMON).T
    inside = (energy > 0.284) & (energy < 10.0)
    energy, sigma = energy[inside], sigma[inside]
    c0, c1, c2 = (c[np.searchsorted(starts, energy, side="right") - 1] for c in coefficients)
    expected = 0.01 * (c0 + c1 * energy + c2 * energy**2) / energy**3
    off = np.abs(sigma / expected - 1.0)
    near = np.min(np.abs(energy[:, None] / starts - 1.0), axis=1) < 5e-3
    assert off[~near].max() < 2e-3
    # Below the table nothing passes, above it everything.
    energy, _ = table(WABS)
    below, above = cross_section(np.array([energy[0] / 2, energy[-1] * 2]), WABS)
    assert (below > 1e8, above) == (True, 0.0)


# Asplund et al. 2009: log10 of atoms per 1e12 hydrogen atoms.
ASPLUND = {
    "H": 12.0, "He": 10.93, "C": 8.43, "N": 7.83, "O": 8.69, "Ne": 7.93, "Na": 6.24, "Mg": 7.60, "Al": 6.45,
    "Si": 7.51, "S": 7.12, "Cl": 5.5, "Ar": 6.40, "Ca": 6.34, "Cr": 5.64, "Fe": 7.50, "Co": 4.99, "Ni": 6.22,
}  # fmt: skip


@pytest.mark.usefixtures("xray_data")
def test_the_table_of_phabs_is_that_of_the_elements():
    """Their photoelectric cross-sections are Elam's; the authors of both give theirs 5 to 10 per cent."""
    xraydb = pytest.importorskip("xraydb")
    energy = np.array([0.35, 0.45, 0.62, 0.8, 1.1, 1.6, 2.2, 3.0, 5.0, 6.8, 7.5, 9.0])
    total = np.zeros(len(energy))
    for element, log in ASPLUND.items():
        grams = xraydb.atomic_mass(element) / 6.02214e23
        total += 10.0 ** (log - 12.0) * xraydb.mu_elam(element, 1e3 * energy, kind="photo") * grams
    np.testing.assert_allclose(np.interp(energy, *table(PHABS)), 1e22 * total, rtol=0.08)


def sommerfeld(lower, photon):
    """Free-free Gaunt factor of an electron left with energy `lower`, in Z^2 Ry; Biedenharn 1956's form."""
    fast, slow = 1 / mpmath.sqrt(lower + photon), 1 / mpmath.sqrt(lower)
    x = -4 * fast * slow / (fast - slow) ** 2
    slope = mpmath.diff(lambda y: abs(mpmath.hyp2f1(1j * fast, 1j * slow, 1, y)) ** 2, x)
    down = (mpmath.exp(2 * mpmath.pi * fast) - 1) * (1 - mpmath.exp(-2 * mpmath.pi * slow))
    return float(mpmath.sqrt(3) * mpmath.pi * x / down * slope)


@pytest.mark.parametrize(("energy", "kT"), [(0.5, 0.2), (2.0, 1.5), (0.3, 8.0), (40.0, 30.0)])
def test_bremsstrahlung_has_the_exact_gaunt_factor(energy, kT):
    def mean(charge):
        rydberg = charge**2 * 0.0136056931
        # x^2 for x: the integrand is smooth but for a logarithm at 0.
        t, w = np.polynomial.legendre.leggauss(24)
        s = 0.5 * (t + 1.0) * 5.5
        values = [sommerfeld(x * x * kT / rydberg, energy / rydberg) * 2 * x * np.exp(-x * x) for x in s]
        return float(np.dot(0.5 * 5.5 * w, values))

    expected = 2.0 * (mean(1) + 0.34 * mean(2)) * np.exp(-energy / kT) / (energy * np.sqrt(kT))
    low, high = np.array([energy * 0.9999]), np.array([energy * 1.0001])
    ours = flux("bremss", low, high, bremss_1__kT=kT, bremss_1__norm=2.0) / (high - low)
    np.testing.assert_allclose(ours, expected, rtol=1e-4)
    redshifted = flux(
        "zbremss", low / 1.5, high / 1.5, zbremss_1__kT=kT, zbremss_1__redshift=0.5, zbremss_1__norm=2.0
    )
    np.testing.assert_allclose(1.5 * redshifted / (high - low), ours, rtol=1e-9)


def test_a_born_gaunt_factor_is_the_limit_of_high_temperature():
    """sqrt(3) / pi e^(u/2) K0(u/2), as Z^2 Ry / kT goes to 0."""
    with double_precision():
        ours = np.array([float(gaunt(u * 400.0, 400.0, 1)) for u in (0.01, 0.3, 2.0, 8.0)])
    u = np.array([0.01, 0.3, 2.0, 8.0])
    np.testing.assert_allclose(ours, np.sqrt(3) / np.pi * np.exp(u / 2) * kn(0, u / 2), rtol=0.02)


def test_a_gaunt_factor_beyond_its_table_is_that_at_its_end():
    def at(log_charge, log_energy):
        """By the logarithms of 4 Ry / kT, for helium, and of energy over kT."""
        kT = 4 * RYDBERG / 10.0**log_charge
        return float(gaunt(10.0**log_energy * kT, kT, 2))

    with double_precision():
        for inside, end, beyond in (
            ((-1.0, -3.9), (-1.0, -4.0), (-1.0, -6.0)),
            ((-1.0, 1.4), (-1.0, 1.5), (-1.0, 2.5)),
            ((-4.0, 0.0), (-4.5, 0.0), (-6.0, 0.0)),
            ((0.4, 0.0), (0.5, 0.0), (2.0, 0.0)),
        ):
            assert at(*beyond) == pytest.approx(at(*end), rel=1e-6)
            assert at(*inside) != pytest.approx(at(*end), rel=1e-5)


BAND = np.linspace(0.5, 8.0, 1501)


def test_a_given_flux_is_what_the_model_has_in_its_band():
    edges = np.geomspace(2.0, 10.0, 8001)
    centre = 0.5 * (edges[1:] + edges[:-1])
    text = "cflux(Emin=2, Emax=10)*(edge*(powerlaw+gauss))"
    values = {"cflux_1__lg10Flux": -11.3, "powerlaw_1__alpha": 1.4, "gauss_1__El": 6.4,
              "gauss_1__sigma": 0.01, "gauss_1__norm": 0.05, "edge_1__Ec": 4.0,
              "edge_1__tau": 0.8}  # fmt: skip
    found = flux(text, edges[:-1], edges[1:], **values)
    assert (found * centre).sum() * 1.602176634e-9 == pytest.approx(10**-11.3, rel=2e-5)
    # The shape is that of what it acts on, a fixed number times it, inside the band and out.
    bare = {key: value for key, value in values.items() if "cflux" not in key} | {"powerlaw_1__norm": 1.0}
    ratio = flux(text, BAND[:-1], BAND[1:], **values) / flux(
        "edge*(powerlaw+gauss)", BAND[:-1], BAND[1:], **bare
    )
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-9)


def test_a_redshift_moves_all_that_it_acts_on_with_its_edges():
    inner = {"gauss_1__El": 6.4, "gauss_1__sigma": 0.1, "gauss_1__norm": 0.5, "powerlaw_1__alpha": 1.7,
             "powerlaw_1__norm": 2.0, "edge_1__Ec": 4.0, "edge_1__tau": 0.8}  # fmt: skip
    low, high = BAND[:-1], BAND[1:]
    ours = flux("zashift*edge*(powerlaw+gauss)", low, high, zashift_1__redshift=0.3, **inner)
    rest = flux("edge*(powerlaw+gauss)", 1.3 * low, 1.3 * high, **inner)
    # Energies over 1 + z, and one more factor 1 / (1 + z).
    np.testing.assert_allclose(ours, rest / 1.3, rtol=1e-9)


NARROW = {
    "zgauss": {"El": 3.93, "sigma": 0.002, "redshift": 0.31, "norm": 2.0},
    "lorentz": {"E_l": 3.02, "sigma": 0.002, "norm": 2.0},
    "bknpower": {"alpha1": 0.5, "BreakE": 3.03, "alpha2": 4.0, "norm": 2.0},
    "gabs": {"El": 3.02, "sigma": 0.002, "strength": 0.01},
    "zedge": {"Ec": 3.98, "tau": 1.5, "redshift": 0.31},
    "zhighect": {"Ec": 3.98, "Ef": 0.4, "redshift": 0.31},
    "zphabs": {"nh": 1.0, "redshift": 0.31},
}


@pytest.mark.usefixtures("xray_data")
@pytest.mark.parametrize("name", NARROW)
def test_lines_and_edges_may_be_narrower_than_a_bin(name):
    coarse, fine = np.linspace(1.0, 8.0, 71), np.linspace(1.0, 8.0, 7001)
    values = {f"{name}_1.{key}": value for key, value in NARROW[name].items()}
    if not COMPONENTS[name].additive:
        values |= {"powerlaw_1.alpha": 0.0, "powerlaw_1.norm": 1.0}
    tree = parse(name if COMPONENTS[name].additive else f"{name}*powerlaw")
    whole, parts = (photons(tree, values, edges[:-1], edges[1:], "exact") for edges in (coarse, fine))
    # Where bins are cut wrongly they are off by as much as an edge is deep.
    np.testing.assert_allclose(whole, parts.reshape(70, 100).sum(axis=1), rtol=1e-3, atol=1e-12)


@pytest.mark.parametrize(
    ("short", "long"),
    [
        ("phabs*po", "phabs*powerlaw"),
        ("TBabs<1>*(pow<2> + ga<3>)", "tbabs*(powerlaw+gaussian)"),
        ("wa(bb)", "wabs*bbody"),
        ("const*tba*cutoff", "constant*tbabs*cutoffpl"),
        ("zpha*zpo+zga", "zphabs*zpowerlw+zgauss"),
        ("tbabs*cflux*(diskb+bkn)", "tbabs*cflux*(diskbb(norm=1.0)+bknpower)"),
        ("gauss_2+gauss_1", "gaussian_2+gaussian"),
        ("tbabs(nH=0.02)*po", "tbabs(nh=0.02)*powerlaw"),
        (
            "po+ga(El=6.4, norm=powerlaw_1.norm/4+0.5)",
            "powerlaw+gaussian(El=6.4, norm=0.25*powerlaw_1.norm+0.5)",
        ),
        ("ga+ga(sigma=gauss_1.sigma)", "gaussian+gaussian(sigma=gauss_1.sigma)"),
        ("logpar(pivotE=3)", "logpar(pivotE=3.0)"),
        ("(tbabs*cflux)*po", "tbabs*cflux*powerlaw(norm=1.0)"),
        ("(tbabs*cflux)(po)", "tbabs*cflux*powerlaw(norm=1.0)"),
        ("(cflux*po)*tbabs", "(cflux*powerlaw(norm=1.0))*tbabs"),
        ("((cflux*po)*edge)*tbabs", "(cflux*powerlaw(norm=1.0))*edge*tbabs"),
        ("(cflux*po)(tbabs)", "(cflux*powerlaw(norm=1.0))*tbabs"),
        ("(tbabs*edge)*po", "tbabs*edge*powerlaw"),
        ("tbabs*(po+(bb+ga))*edge", "tbabs*(powerlaw+(bbody+gaussian))*edge"),
        ("ga+ga(El=2*gauss_1.El-1)", "gaussian+gaussian(El=2.0*gauss_1.El-1.0)"),
        ("tbabs*(edge*po)", "tbabs*(edge*powerlaw)"),
        ("zas*edge*po", "zashift*edge*powerlaw"),
        ("cflux*po(norm=3)", "cflux*powerlaw(norm=3.0)"),
    ],
)
def test_short_and_long_are_the_same_model_and_come_back(short, long):
    tree = parse(short)
    assert written(tree) == long
    assert parse(long) == tree


def test_numbers_and_ties_follow_each_other():
    model = with_sources(
        "tbabs*(po+ga+ga)",
        {
            "tbabs_1.nh": 0.02,
            "gauss_2.El": "= 1.1*gauss_1.El + 0.01",
            "gauss_1.El": 6.4,
            "gauss_2.sigma": "gauss_1.sigma",
        },
    )
    assert parameter_names(parse(model)) == (
        "powerlaw_1.alpha", "powerlaw_1.norm", "gauss_1.sigma", "gauss_1.norm", "gauss_2.norm",
    )  # fmt: skip
    assert dict(leaves(parse(model))[3].bindings)["El"] == pytest.approx(7.05)
    chained = parse("ga+ga(El=2*gauss_1.El)+ga(El=gauss_2.El-1)")
    assert dict(leaves(chained)[2].bindings)["El"] == Tied("gauss_1.El", 2.0, -1.0)
    chained = parse("ga+ga(El=2*gauss_1.El+3)+ga(El=0.25*gauss_2.El-1)")
    assert dict(leaves(chained)[2].bindings)["El"] == Tied("gauss_1.El", 0.5, -0.25)
    edges = np.linspace(5.0, 8.0, 61)
    free = {"powerlaw_1__alpha": 1.5, "powerlaw_1__norm": 0.1, "gauss_1__norm": 0.3, "gauss_2__norm": 0.2}
    ours = flux("po+ga+ga(El=1.1*gauss_1.El, sigma=gauss_1.sigma)", edges[:-1], edges[1:],
                gauss_1__El=6.4, gauss_1__sigma=0.05, **free)  # fmt: skip
    theirs = flux("po+ga+ga", edges[:-1], edges[1:], gauss_1__El=6.4, gauss_1__sigma=0.05, gauss_2__El=7.04,
                  gauss_2__sigma=0.05, **free)  # fmt: skip
    np.testing.assert_allclose(ours, theirs, rtol=1e-12)


@pytest.mark.parametrize(
    "line",
    [
        "3", "-2.5", "2*3 - 1/4", "{}", "-{}", "1 - {}", "{} - 1", "2*({} + 1)", "({} - 1)*-2 + 0.5",
        "({} + 1)/4 - 3", "= 2*3*{}/4", "-(2*{} - 1)", "1 + (2 - 3*{})",
    ],
)  # fmt: skip
def test_a_straight_line_is_what_python_makes_of_it(line):
    source = read_source(line.format("gauss_1.El"))
    for value in (0.7, -5.3):
        assert valued(source, {"gauss_1.El": value}.__getitem__) == pytest.approx(
            eval(line.lstrip("= ").format(f"({value})"))
        )


@pytest.mark.parametrize(
    "line", ["{}*{}", "1/{}", "{}/{}", "{}/0", "{} + {}", "{} - {}", "{}**2", "a", "[1]"]
)
def test_what_is_no_straight_line_is_refused(line):
    with pytest.raises(InputError, match="neither a number nor a parameter"):
        read_source(line.replace("{}", "gauss_1.El"))


@pytest.mark.parametrize(
    ("expression", "words"),
    [
        ("tbabs*powerline", r"did you mean zpowerlw or powerlaw or bknpower\?$"),
        # One letter begins nothing, even where one component alone has it.
        ("w*powerlaw", "unknown component 'w'"),
        ("p", "unknown component 'p'"),
        ("tbabs*(powrlaw+bbodyrad)", "unknown component 'powrlaw'; did you mean powerlaw"),
        ("tbabs*zzz", "there are bbody"),
        ("power_law", "unknown component 'power_law'"),
        ("tbabs*apec", "comes in as a table: atable"),
        ("gsmooth*ga", "free sigma"),
        ("exp*po", "'exp' begins expabs, expfac; write one of them"),
        ("tbabs*cflux", "acts on what stands to its right"),
        ("cflux*tbabs", "no emission to its right"),
        ("cflux", "no emission"),
        ("po(index=2)", "po has no index; it has alpha, norm"),
        ("po(alpha=beta)", "neither a number nor a parameter"),
        ("po(alpha=True)", "'True' is neither a number nor a parameter"),
        ("po(alpha=ga_1.El)", "tied to ga_1.El, which is not among powerlaw_1.alpha"),
        ("ga(El=gauss_2.El)+ga(El=gauss_1.El)", "tied to itself"),
        ("gauss_1+gauss_1", "stands in it twice"),
        ("po(**{})", "only component names"),
        ("(tbabs*po)(alpha=2)", "not a component"),
        ("tbabs*(powerlaw", "not an expression"),
        ("", "not an expression"),
        ("tbabs powerlaw", "not an expression"),
        ("tbabs", "no emission"),
        ("tbabs+powerlaw", "adds emission to a factor"),
        ("powerlaw*bbody", "multiplies emission by emission"),
        ("powerlaw-bbody", "only component names"),
        ("powerlaw/2", "only component names"),
        ("2*powerlaw", "only component names"),
        ("powerlaw.__class__", "only component names"),
        ("tbabs(powerlaw, bbody)", "only component names"),
        ("tbabs()*powerlaw", "only component names"),
        ("__import__('os').system('true')", "only component names"),
        ("powerlaw\x00", "not an expression"),
    ],
)
def test_what_is_no_model_is_one_line(expression, words):
    with pytest.raises(InputError, match=words) as caught:
        parse(expression)
    assert "\n" not in str(caught.value)


def test_a_very_deep_expression_is_one_line_too():
    with pytest.raises(InputError, match="not an expression"):
        parse("(" * 5000 + "powerlaw" + ")" * 5000)


def test_no_component_is_both_offered_and_refused():
    assert not set(COMPONENTS) & set(REFUSED)
