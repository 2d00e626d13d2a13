"""What people write in papers, and what happens with each: evaluated, or refused in words that help."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import Prior

pytest.importorskip("jaxspec")
from gaugeblock.simulators.xray import double_precision
from gaugeblock.simulators.xray.default_priors import SHAPES
from gaugeblock.simulators.xray.expression import additive, leaves, parameter_names, parse
from gaugeblock.simulators.xray.folding import photon_flux

EVALUATED = {
    "po": 2,
    "phabs*po": 3,
    "wabs*po": 3,
    "TBabs*pow": 3,
    "tbabs*powerlaw": 3,
    "wabs(po+ga)": 6,
    "phabs*(po+gauss)": 6,
    "tbabs*(diskbb+po)": 5,
    "TBabs*(diskbb+powerlaw+gaussian)": 8,
    "phabs*(diskbb+bbody)": 5,
    "tbabs*(bbodyrad+po)": 5,
    "phabs*bb": 3,
    "tbabs*bbodyrad": 3,
    "phabs*bremss": 3,
    "wabs*(bremss+ga)": 6,
    "tbabs*bknpower": 5,
    "const*tbabs*cutoffpl": 5,
    "constant*phabs*zphabs*po": 6,
    "tbabs*zphabs*(zpowerlw+zgauss)": 10,
    "tbabs*ztbabs*zpowerlw": 6,
    "tbabs*ztbabs(z=0.7)*po": 4,
    "phabs*zwabs*zpow": 6,
    "phabs*pcfabs*po": 5,
    "tbabs*zpcfabs*zpowerlw": 7,
    "tbabs*tbpcf*(po+ga)": 8,
    "phabs*logpar": 4,
    "tbabs*logpar": 4,
    "tbabs*cflux*po": 3,
    "tbabs*cflux(Emin=2, Emax=10)*(diskbb+po)": 5,
    "phabs*zashift*(po+ga)": 7,
    "tbabs*edge*po": 5,
    "tbabs*zedge*zpowerlw": 7,
    "phabs*highecut*po": 5,
    "wabs*gabs*highecut*po": 8,
    "phabs*cyclabs*highecut*po": 8,
    "tbabs*expabs*po": 4,
    "tbabs*(po+lorentz)": 6,
    "const*tbabs*(po+bb+ga+ga)": 12,
    "tbabs*(zbbody+zpowerlw)": 7,
    "phabs*grbm": 5,
    "tbabs*gabs*(diskbb+bbodyrad)": 8,
    "phabs*(po+zbremss)": 6,
    "TBabs<1>(powerlaw<2> + bbodyrad<3>)": 5,
    "tbabs(nh=0.02)*(po + ga(El=6.4) + ga(El=7.06, norm=0.13*gauss_1.norm))": 5,
}
"""Expression and how many parameters it leaves free."""

REFUSED = {
    "tbabs*apec": "atable",
    "phabs*vapec": "atable",
    "wabs*mekal": "atable",
    "tbabs*(nthcomp+diskbb)": "atable",
    "tbabs*relxill": "atable",
    "phabs*pexrav": "atable",
    "tbabs*(apec+apec)": "atable",
    "tbabs*simpl*diskbb": "atable",
    "phabs*zxipcf*po": "mtable",
    "tbabs*gsmooth*apec": "zgauss",
    "tbabs*diskpbb": "diskbb",
    "tbabs*comptt": "atable",
    "tbabs*kerrbb": "atable",
    "phabs*xillver": "atable",
}
"""Expression and what the line that refuses it names instead."""

USUAL = {"redshift": 0.1, "z": 0.1, "El": 2.0, "sigma": 0.1, "lg10Flux": -11.0, "norm": 0.01}


def test_the_table_is_long_enough_and_most_of_it_is_evaluated():
    assert len(EVALUATED) + len(REFUSED) >= 36
    assert len(EVALUATED) / (len(EVALUATED) + len(REFUSED)) > 0.7


@pytest.mark.usefixtures("xray_data")
@pytest.mark.parametrize("expression", EVALUATED)
def test_it_is_evaluated(expression):
    tree = parse(expression)
    names = parameter_names(tree)
    assert len(names) == EVALUATED[expression]
    edges = np.geomspace(0.4, 10.0, 61)
    shapes = {
        source: SHAPES[leaf.component].get(parameter)
        for leaf in leaves(tree)
        for parameter, source in leaf.bindings
        if isinstance(source, str)
    }
    theta = []
    for name in names:
        marginal, usual = shapes[name], USUAL.get(name.split(".")[1])
        theta.append(
            usual if usual is not None else Prior({name: marginal}).from_unit_cube(np.full(1, 0.5))[0]
        )
    with double_precision():
        flux = np.asarray(photon_flux(tree, names, edges[:-1], edges[1:], "exact")(np.array(theta), 1))
        twice = np.array(theta) * np.array([2.0 if _emits(tree, name) else 1.0 for name in names])
        doubled = np.asarray(photon_flux(tree, names, edges[:-1], edges[1:], "exact")(twice, 1))
    assert np.isfinite(flux).all()
    assert (flux >= 0).all()
    assert flux.max() > 0
    if "cflux" not in expression:
        np.testing.assert_allclose(doubled, 2.0 * flux, rtol=1e-9, atol=1e-300)


def _emits(tree, name):
    return name.endswith(".norm") and any(
        additive(leaf) and dict(leaf.bindings).get("norm") == name for leaf in leaves(tree)
    )


@pytest.mark.parametrize("expression", REFUSED)
def test_it_is_refused_in_one_line_that_names_the_remedy(expression):
    with pytest.raises(InputError, match=REFUSED[expression]) as caught:
        parse(expression)
    assert "\n" not in str(caught.value)
