"""What people write in papers, and what happens with each: evaluated, or refused in words that help."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import Prior

pytest.importorskip("jaxspec")
import jax

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


SINGLE = [expression for expression in EVALUATED if "<" in expression or "_1" in expression]
SEVERAL = [expression for expression in EVALUATED if expression not in SINGLE]
# Several in one model, which is compiled once. Those with numbers in them would mean other components there.
TOGETHER = [*([one] for one in SINGLE), *(SEVERAL[k::7] for k in range(7))]


@pytest.mark.usefixtures("xray_data")
@pytest.mark.parametrize("expressions", TOGETHER, ids=lambda group: group[0])
def test_they_are_evaluated(expressions):
    """One after the other, with the norms of all others zero."""
    for expression in expressions:
        assert len(parameter_names(parse(expression))) == EVALUATED[expression], expression
    tree = parse("+".join(f"({expression})" for expression in expressions))
    names = parameter_names(tree)
    edges = np.geomspace(0.4, 10.0, 61)
    shapes = {
        source: SHAPES[leaf.component].get(parameter)
        for leaf in leaves(tree)
        for parameter, source in leaf.bindings
        if isinstance(source, str)
    }
    usual = [USUAL.get(name.split(".")[1]) for name in names]
    theta = np.array(
        [
            Prior({name: shapes[name]}).from_unit_cube(np.full(1, 0.5))[0] if value is None else value
            for name, value in zip(names, usual, strict=True)
        ]
    )
    emits = np.array([_emits(tree, name) for name in names])
    fluxes = np.array([name.endswith(".lg10Flux") for name in names])
    whose = np.repeat(np.arange(len(expressions)), [EVALUATED[expression] for expression in expressions])
    with double_precision():
        photons = photon_flux(tree, names, edges[:-1], edges[1:], "exact")
        compiled = jax.jit(lambda row: photons(row, 1))
        for k, expression in enumerate(expressions):
            alone = np.where((whose != k) & emits, 0.0, np.where((whose != k) & fluxes, -400.0, theta))
            flux = np.asarray(compiled(alone))
            assert np.isfinite(flux).all(), expression
            assert (flux >= 0).all(), expression
            assert flux.max() > 0, expression
            if "cflux" not in expression:
                doubled = np.asarray(compiled(np.where(emits, 2.0 * alone, alone)))
                np.testing.assert_allclose(doubled, 2.0 * flux, rtol=1e-9, atol=1e-300, err_msg=expression)


def _emits(tree, name):
    return name.endswith(".norm") and any(
        additive(leaf) and dict(leaf.bindings).get("norm") == name for leaf in leaves(tree)
    )


@pytest.mark.parametrize("expression", REFUSED)
def test_it_is_refused_in_one_line_that_names_the_remedy(expression):
    with pytest.raises(InputError, match=REFUSED[expression]) as caught:
        parse(expression)
    assert "\n" not in str(caught.value)
