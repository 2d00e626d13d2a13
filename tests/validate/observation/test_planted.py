"""What is planted is what it is called; the ladder finds the smallest rung."""

import numpy as np
import pytest

from gaugeblock.validate.observation.generic import compared, log_likelihood
from gaugeblock.validate.observation.ladder import RUNGS, smallest_seen
from gaugeblock.validate.observation.planted import DISCREPANCIES, Scale, possible

X = np.random.default_rng(1).normal([0.0, 5.0, -2.0, 1.0] * 10, [1.0, 3.0, 0.5, 2.0] * 10, (4000, 40))
SCALE = Scale.of(X)


def planted(name, size, seed=2):
    return DISCREPANCIES[name](X, size, SCALE, np.random.default_rng(seed))


def test_spreads_are_those_of_the_simulations():
    assert np.allclose(SCALE.spread, [1.0, 3.0, 0.5, 2.0] * 10, rtol=0.1)
    assert np.allclose(SCALE.middle, [0.0, 5.0, -2.0, 1.0] * 10, atol=0.25)


@pytest.mark.parametrize("name", sorted(DISCREPANCIES))
def test_nothing_is_planted_at_size_0(name):
    assert np.allclose(planted(name, 0.0), X)


def test_each_is_what_it_is_called():
    assert np.allclose(planted("shift", 2.0), X + 2 * SCALE.spread)
    assert np.allclose(planted("scale", 0.5).std(axis=0), 1.5 * X.std(axis=0))
    assert np.allclose(planted("gain", 0.5), 1.5 * X)
    drift = planted("drift", 0.5) / X
    assert np.allclose(drift[0, [0, -1]], [0.5, 1.5])
    assert np.allclose(planted("noise", 1.0).std(axis=0), X.std(axis=0) * 2**0.5, rtol=0.1)
    moved = planted("outliers", 3.0) - X
    assert (np.count_nonzero(np.abs(moved) > 1e-9, axis=1) == 2).all()
    assert np.allclose(np.abs(moved).max(axis=0) / SCALE.spread, 3.0)
    assert (moved > 0).any()
    assert (moved < 0).any()
    bump = (planted("component", 1.0) - X) / SCALE.spread
    assert 0.9 < np.median(bump.max(axis=1)) <= 1.0 + 1e-9
    assert 2 < np.median((bump > 0.5).sum(axis=1)) < 10
    ramp = np.tile(np.arange(40.0), (2, 1))
    assert np.allclose(DISCREPANCIES["stretch"](ramp, 0.25, SCALE, np.random.default_rng(0)), ramp / 1.25)


def test_counts_stay_counts_and_stray_upward():
    counts = np.random.default_rng(3).poisson(2.0, (500, 20))
    scale = Scale.of(counts)
    assert scale.counts
    for name, one in DISCREPANCIES.items():
        made = one(counts, 0.7, scale, np.random.default_rng(4))
        assert (made >= 0).all(), name
        assert (made == np.round(made)).all(), name
    assert (DISCREPANCIES["outliers"](counts, 3.0, scale, np.random.default_rng(5)) >= counts).all()


def test_a_number_alone_has_no_axis():
    assert set(possible((), ladder=True)) == {"shift", "scale", "noise", "outliers"}
    assert "stretch" in possible((7,), ladder=False)
    assert "stretch" not in possible((2,), ladder=False)


@pytest.mark.parametrize("least", RUNGS)
def test_the_ladder_finds_the_smallest_rung(least):
    assert smallest_seen("shift", "", lambda size: 0.95 if size >= least else 0.5).smallest == least


def test_what_is_never_seen_has_no_rung():
    assert smallest_seen("shift", "", lambda _: 0.89).smallest is None


def test_effects_are_compared_by_their_likelihood():
    rng = np.random.default_rng(6)

    def at(name, amplitude):
        shift = {"gain": [amplitude, 0.0], "shift": [0.0, amplitude]}[name]
        return rng.normal(size=(4000, 2)) + shift, 0.5

    observed = np.array([[0.1, 2.0]])
    found = compared([("gain", True), ("shift", True)], at, observed, rng.normal(size=(4000, 2)))
    assert [one.name for one in found] == ["shift", "gain"]
    assert found[0].amplitude == 2.0
    assert found[0].gain == pytest.approx(2.0, abs=0.3)
    exact = -0.5 * (0.01 + 4.0)
    assert log_likelihood(observed, rng.normal(size=(20000, 2))) == pytest.approx(exact, abs=0.15)
