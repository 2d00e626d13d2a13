"""jaxspec's rule with each energy asked for once, against jaxspec's own models."""

import numpy as np
import pytest

pytest.importorskip("jaxspec")
import jax
import mpmath
from jaxspec.model.additive import Band, Blackbody, Blackbodyrad, Cutoffpl, Gauss, Powerlaw
from jaxspec.model.multiplicative import Expfac, MultiplicativeConstant, Phabs, Tbabs, Tbpcf, Wabs, zTbabs

from gaugeblock.simulators.xray import double_precision
from gaugeblock.simulators.xray.expression import parameter_names, parse
from gaugeblock.simulators.xray.folding import photon_flux

pytestmark = pytest.mark.usefixtures("xray_data")

EDGES = np.geomspace(0.3, 12.0, 300)
ROW = EDGES[:-1], EDGES[1:]
LONGER = np.geomspace(0.3, 12.0, 340)
GAP = np.delete(np.stack([LONGER[:-1], LONGER[1:]]), slice(100, 140), axis=1)
APART = np.stack([EDGES[:-1], EDGES[1:] * (1 - 1e-7)])
OVERLAPPING = np.stack([LONGER[:299], LONGER[2:301]])
BACKWARDS = np.stack(ROW)[:, ::-1]
MODELS = {
    "powerlaw": (lambda: Powerlaw(), {}),
    "tbabs*(powerlaw+bbodyrad)": (lambda: Tbabs() * (Powerlaw() + Blackbodyrad()), {}),
    "tbpcf*(ztbabs*bbody+wabs*bbodyrad+phabs*powerlaw)": (
        lambda: Tbpcf() * (zTbabs() * Blackbody() + Wabs() * Blackbodyrad() + Phabs() * Powerlaw()),
        {},
    ),
    "tbabs*expfac*cutoffpl+constant*gauss": (
        lambda: Tbabs() * Expfac() * Cutoffpl() + MultiplicativeConstant() * Gauss(),
        {"gauss_1.El": 6.4, "gauss_1.sigma": 0.03},
    ),
}


@pytest.mark.parametrize(
    ("low", "high", "factor"),
    [
        (*ROW, 1), (*ROW, 1.02), (*GAP, 1.02), (*APART, 1.02), (*OVERLAPPING, 1.02), (*BACKWARDS, 1.02),
        (*np.stack(ROW)[:, :1], 1.02),
    ],
    ids=["row", "row times a factor", "gap", "apart", "overlapping", "backwards", "one bin"],
)  # fmt: skip
@pytest.mark.parametrize("expression", MODELS)
def test_every_bin_is_what_jaxspec_says(expression, low, high, factor):
    make, given = MODELS[expression]
    tree = parse(expression)
    rng = np.random.default_rng(1)
    values = {name: given.get(name, rng.uniform(0.6, 1.9)) for name in parameter_names(tree)}
    with double_precision():
        found = photon_flux(tree, tuple(values), low, high, "jaxspec")(np.array([*values.values()]), factor)
        expected = make().photon_flux(low * factor, high * factor, params=values)
    np.testing.assert_allclose(found, expected, rtol=1e-10)


@pytest.mark.parametrize("end", [2.001, 2.4, 50.0])
@pytest.mark.parametrize("alpha", [-1.0, 0.9999, 1 - 1e-7, 1 - 5e-9, 1.0, 1 + 2e-8, 1.7, 5.0])
def test_a_power_law_is_its_integral(alpha, end):
    """To the last digits, where the difference of two powers has lost half of them."""
    tree = parse("powerlaw")
    with double_precision():
        flux = photon_flux(tree, parameter_names(tree), np.array([2.0]), np.array([end]), "jaxspec")
        found, slope = map(float, jax.value_and_grad(lambda a: flux((a, 3.0), 1)[0])(alpha))
    with mpmath.workdps(40):
        true = 3 * mpmath.quad(lambda e: e ** -mpmath.mpf(alpha), [mpmath.mpf(2.0), mpmath.mpf(end)])
        steep = -3 * mpmath.quad(
            lambda e: mpmath.log(e) * e ** -mpmath.mpf(alpha), [mpmath.mpf(2.0), mpmath.mpf(end)]
        )
    # The logarithm of edges that agree to three digits keeps thirteen.
    assert found == pytest.approx(float(true), rel=1e-12)
    assert slope == pytest.approx(float(steep), rel=1e-6)


def test_an_energy_is_asked_for_once(monkeypatch):
    asked = []
    plain = Band.continuum
    monkeypatch.setattr(
        Band, "continuum", lambda self, energy: asked.append(energy.size) or plain(self, energy)
    )
    with double_precision():
        tree = parse("grbm")
        photon_flux(tree, parameter_names(tree), *ROW, "jaxspec")(np.ones(4), 1)
    assert asked == [len(EDGES)]
