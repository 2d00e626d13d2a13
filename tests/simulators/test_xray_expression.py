"""Model expressions: what they mean, what they refuse, and agreement with the textbook formulas."""

import numpy as np
import pytest
from scipy.integrate import quad

from gaugeblock.core.errors import InputError

pytest.importorskip("jaxspec")
from gaugeblock.simulators.xray import double_precision
from gaugeblock.simulators.xray.components import COMPONENTS, REFUSED
from gaugeblock.simulators.xray.expression import build, leaves, parameter_names, parse


def flux(expression, low, high, **values):
    """Photons/cm2/s per bin; ``powerlaw_1__alpha=2`` sets ``powerlaw_1.alpha``."""
    named = {name.replace("__", "."): value for name, value in values.items()}
    with double_precision():
        model, sources = build(parse(expression))
        assert {source for _, source in sources} == set(named)
        parameters = {path: named[source] for path, source in sources}
        return np.asarray(model.photon_flux(np.asarray(low), np.asarray(high), params=parameters))


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
    "constant": ({"norm": 0.3}, lambda e: 0.3),
    "expfac": ({"A": 2.0, "f": 0.5, "E_c": 2.0}, lambda e: 1.0 + 2.0 * np.exp(-0.5 * e) * (e > 2.0)),
    "highecut": ({"Ec": 2.0, "Ef": 3.0}, lambda e: np.exp((2.0 - e) / 3.0) if e > 2.0 else 1.0),
}
FORMULAS["gaussian"] = FORMULAS["gauss"]
TABLES = {
    "tbabs": ({"nh": 0.2}, lambda s: np.exp(-0.2 * s)),
    "wabs": ({"nh": 0.2}, lambda s: np.exp(-0.2 * s)),
    "phabs": ({"nh": 0.2}, lambda s: np.exp(-0.2 * s)),
    "tbpcf": ({"nh": 0.2, "f": 0.3}, lambda s: 0.3 * np.exp(-0.2 * s) + 0.7),
    "ztbabs": ({"nh": 0.2, "z": 0.0}, lambda s: np.exp(-0.2 * s)),
}


def spectrum_of(name, parameters, low, high):
    """The component alone, or times a flat spectrum of one photon/keV/cm2/s."""
    entry = COMPONENTS[name]
    values = {f"{entry.component.lower()}_1__{key}": value for key, value in parameters.items()}
    if entry.additive:
        return flux(name, low, high, **values)
    return flux(f"{name}*powerlaw", low, high, powerlaw_1__alpha=0.0, powerlaw_1__norm=1.0, **values)


def test_every_component_has_a_formula_to_be_held_against():
    assert set(FORMULAS) | set(TABLES) == set(COMPONENTS)


@pytest.mark.parametrize("name", sorted(FORMULAS))
def test_a_component_is_what_xspec_says_it_is(name):
    parameters, formula = FORMULAS[name]
    assert tuple(parameters) == COMPONENTS[name].parameters
    edges = np.linspace(1.0, 6.0, 2001)
    ours = spectrum_of(name, parameters, edges[:-1], edges[1:])
    chosen = slice(3, None, 97)
    theirs = [quad(formula, a, b)[0] for a, b in zip(edges[:-1][chosen], edges[1:][chosen], strict=True)]
    # Bins of 2.5 eV integrated from their two ends; exact where the component has an integral.
    np.testing.assert_allclose(ours[chosen], theirs, rtol=1e-4, atol=1e-9)


@pytest.mark.usefixtures("xray_data")
@pytest.mark.parametrize("name", sorted(TABLES))
def test_an_absorber_reads_its_own_table(name):
    from astropy.table import Table

    from gaugeblock.simulators.xray import data
    from gaugeblock.simulators.xray.components import TABLES as FILES

    table = Table.read(data.path(FILES[COMPONENTS[name].component]))
    parameters, formula = TABLES[name]
    edges = np.linspace(1.0, 6.0, 2001)
    middle = 0.5 * (edges[1:] + edges[:-1])
    sigma = np.interp(middle, np.asarray(table["ENERGY"]), np.asarray(table["SIGMA"]))
    ours = spectrum_of(name, parameters, edges[:-1], edges[1:]) / np.diff(edges)
    # Away from edges the table is smooth; at one, a bin is averaged over both sides.
    assert np.quantile(np.abs(ours / formula(sigma) - 1), 0.98) < 2e-3


@pytest.mark.parametrize(
    ("expression", "words"),
    [
        ("tbabs*(powrlaw+bbodyrad)", "unknown component 'powrlaw'; did you mean powerlaw"),
        ("tbabs*zzz", "there are bbody"),
        ("bremss", "thermal_continuum"),
        ("tbabs*diskbb", "0.5 to 10 keV"),
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
