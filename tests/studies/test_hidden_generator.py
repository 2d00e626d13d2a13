"""The generator of hidden effects: code of its own, and yet the same physics as the simulators'."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("astropy")
pytest.importorskip("jaxspec")

from studies.hidden.case import drawn
from studies.hidden.detector import blurred, relabelled
from studies.hidden.draws import DRAWN, sized, theta
from studies.hidden.engine import library
from studies.hidden.hidden_effects import LIBRARY
from studies.hidden.setups import laboratory, simulator
from studies.hidden.strata import CATALOGUES, STRATA, Stratum
from studies.hidden.truth import ALL
from studies.hidden.unlisted import COMPOSED, NUISANCE, UNLISTED

from gaugeblock.simulators import Effect

FOLDER = Path(__file__).resolve().parents[2] / "studies" / "hidden"

OWN = (
    "instrument",
    "spectrum",
    "detector",
    "hidden_effects",
    "unlisted",
    "truth",
    "draws",
    "strata",
    "case",
)
"""The files that data are made by."""

EDGES = np.linspace(0.0, 10.0, 2001)


@pytest.fixture(scope="module")
def lab(xray_data):
    return laboratory()


def sigma(mean, other):
    """Root of the Poisson deviance between two expectations."""
    return np.sqrt(2 * (mean * np.log(mean / other) - mean + other).sum())


def test_the_generator_imports_nothing_of_ours():
    for name in OWN:
        for node in ast.walk(ast.parse((FOLDER / f"{name}.py").read_text())):
            modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom):
                modules.append(node.module)
            for module in modules:
                root, _, rest = module.partition(".")
                assert root != "gaugeblock", f"{name} imports {module}"
                if root == "studies":
                    assert rest.removeprefix("hidden.") in OWN, f"{name} imports {module}"


def test_without_an_effect_both_expect_the_same_counts(lab):
    """Within 2.5e-3 in every group (where an edge lies in an input bin) and 0.1 sigma at 10,000 counts."""
    rng = np.random.default_rng(1)
    for setup, names in (("two", 5), ("one", 3)):
        designs = [drawn(Stratum("s", "nothing", setup, 1), (), rng) for _ in range(20)]
        truths = [design.truths((), 1.0)[0] for design in designs]
        mine = np.array([lab.mean(truth) for truth in truths])
        theirs = simulator(setup).expected(np.array([truth.theta for truth in truths]))
        assert theirs.shape == (20, 102)
        assert simulator(setup).prior.size == names
        np.testing.assert_allclose(mine, theirs, rtol=2.5e-3)
        assert np.abs(mine / theirs - 1).mean() < 2e-4
        assert max(map(sigma, mine, theirs)) < 0.1


@pytest.mark.parametrize("name", LIBRARY)
def test_an_effect_means_the_same_to_both(lab, name):
    """The generator's change and the simulator's: within 2% of the change, or 0.1 sigma at 10,000 counts."""
    rng = np.random.default_rng(2)
    design = drawn(Stratum("s", "listed", "two", 1), (name,), rng)
    truth, plain = design.truths((0.4,), 1.0)[0], design.truths((0.0,), 1.0)[0]
    effect = Effect(name, dict(truth.hidden[0][1]))
    mine, theirs = lab.mean(truth), simulator("two").with_effect(effect).expected(np.array(truth.theta))
    change = sigma(mine, lab.mean(plain))
    assert change > 0.3
    assert sigma(mine, theirs) < max(0.02 * change, 0.1)


def test_size_zero_is_no_effect(lab):
    for name in DRAWN:
        design = drawn(Stratum("s", "unlisted", "two", 1), (name,), np.random.default_rng(3))
        plain = drawn(Stratum("s", "nothing", "two", 1), (), np.random.default_rng(3))
        np.testing.assert_allclose(
            lab.mean(design.truths((0.0,), 1.0)[0]), lab.mean(plain.truths((), 1.0)[0]), rtol=1e-9
        )


@pytest.mark.parametrize("setup", ["two", "one"])
def test_nothing_is_drawn_where_the_library_does_not_look(lab, setup):
    rng = np.random.default_rng(4)
    entries = library(setup).entries
    assert set(entries) >= set(LIBRARY)
    for name in LIBRARY:
        supports = {key: marginal.support for key, marginal in entries[name].parameters.items()}
        for _ in range(50):
            values = sized(name, rng, theta(rng, surface=setup == "two", edge=False))(0.95)
            outside = {k: v for k, v in values.items() if not supports[k][0] <= v <= supports[k][1]}
            assert not outside, f"{name}: {outside}"


def test_a_gain_moves_counts_and_loses_none():
    counts = np.exp(-0.5 * ((EDGES[:-1] + 0.0025 - 6.0) / 0.1) ** 2)
    centres = 0.5 * (EDGES[1:] + EDGES[:-1])
    moved = relabelled(counts, EDGES, lambda energy: 1.02 * energy + 0.01)
    assert moved.sum() == pytest.approx(counts.sum())
    assert (moved @ centres) / moved.sum() == pytest.approx(1.02 * 6.0 + 0.01, abs=1e-6)
    np.testing.assert_allclose(relabelled(counts, EDGES, lambda energy: energy), counts, atol=1e-12)
    with pytest.raises(ValueError, match="increase"):
        relabelled(counts, EDGES, lambda energy: -energy)


def test_a_blur_adds_its_variance():
    counts = np.zeros(2000)
    counts[1200] = 1.0
    centres = 0.5 * (EDGES[1:] + EDGES[:-1])
    spread = blurred(counts, EDGES, lambda energy: 0.08)
    assert spread.sum() == pytest.approx(1.0, abs=1e-6)
    variance = spread @ (centres - centres[1200]) ** 2
    assert variance == pytest.approx(0.08**2 + 0.005**2 / 12, rel=1e-4)


def test_every_effect_is_drawn_and_hidden_somewhere():
    assert set(DRAWN) == set(LIBRARY) | set(UNLISTED)
    assert set(ALL) == {*LIBRARY, *UNLISTED, *NUISANCE}
    assert len(UNLISTED) >= 8
    assert {name for pair in COMPOSED.values() for name in pair} <= set(LIBRARY)
    for kind, every in (("listed", LIBRARY), ("unlisted", UNLISTED)):
        hidden = {name for stratum in STRATA if stratum.kind == kind for name in stratum.hidden}
        assert hidden == set(every)


def test_the_strata_are_large_enough():
    """400 cases without an effect: a true rate of 5% is called missed above 31."""
    sizes = dict.fromkeys(("listed", "unlisted", "nothing", "pair"), 0)
    for stratum in STRATA:
        sizes[stratum.kind] += stratum.cases * max(1, len(stratum.hidden))
    assert sizes["nothing"] >= 400
    assert sizes["listed"] >= 400
    assert sizes["unlisted"] >= 110
    assert all(stratum.sources > 1 for stratum in CATALOGUES)
