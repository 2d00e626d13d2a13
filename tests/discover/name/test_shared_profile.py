"""Shared amplitudes with every source fitted anew: no bias at either sign, redshifts, intervals."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name.shared import Term, fit_held, share
from gaugeblock.discovery.name.shared_profile import profile_shared
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators import Effect


def hidden(power_law, n, seed, effect, *, redshift=None, bright=2000.0):
    rng = np.random.default_rng(seed)
    simulator = power_law()
    theta = np.column_stack([rng.uniform(0.2, 1.0, n) * bright, rng.uniform(1.0, 2.5, n)])
    shift = np.zeros(n) if redshift is None else redshift
    rows = []
    for one, z in zip(theta, shift, strict=True):
        moved = {
            k: v / (1 + z) if k == "energy" and effect.name == "line" else v
            for k, v in effect.parameters.items()
        }
        rows.append(simulator.with_effect(Effect(effect.name, moved)).simulate(one[None], rng)[0])
    return Sources.of(simulator, np.array(rows), redshift=shift)


@pytest.mark.parametrize("depth", [0.4, -0.4])
def test_large_amplitudes_of_either_sign_are_read_without_bias(power_law, depth):
    sources = hidden(power_law, 80, 1, Effect("dip", {"energy": 2.0, "depth": depth}))
    entry = sources.simulator.effect_library(np.array([[1000.0, 2.0]]))["dip"]
    found = profile_shared([sources], Term(entry, {"energy": 2.0}))
    low, high = found.interval(0.999)
    assert found.converged
    assert low < depth < high
    assert found.standard_error < 0.02
    assert found.gain == pytest.approx(found.z**2 / 2, rel=0.5)


def test_intervals_cover(power_law):
    # Of 40 intervals of 90%, 29 or fewer cover in fewer than one of a thousand.
    covered = 0
    for seed in range(40):
        sources = hidden(power_law, 12, 100 + seed, Effect("dip", {"energy": 2.0, "depth": 0.1}))
        entry = sources.simulator.effect_library(np.array([[1000.0, 2.0]]))["dip"]
        low, high = profile_shared([sources], Term(entry, {"energy": 2.0})).interval(0.9)
        covered += low < 0.1 < high
    assert covered >= 30


def test_a_line_is_shared_in_the_rest_frame(power_law):
    redshift = np.linspace(0.0, 0.8, 30)
    effect = Effect("line", {"energy": 4.0, "counts": 150.0})
    sources = hidden(power_law, 30, 2, effect, redshift=redshift, bright=500.0)
    entry = sources.simulator.effect_library(np.array([[500.0, 2.0]]))["line"]
    rest = profile_shared([sources], Term(entry, {"energy": 4.0}))
    low, high = rest.interval(0.999)
    assert low < 150.0 < high
    still = Sources.of(sources.simulator, sources.counts)
    assert profile_shared([still], Term(entry, {"energy": 4.0})).gain < 0.7 * rest.gain


def test_nuisances_are_fitted_beside(power_law):
    sources = hidden(power_law, 60, 3, Effect("dip", {"energy": 3.0, "depth": 0.1}))
    entry = sources.simulator.effect_library(np.array([[1000.0, 2.0]]))["dip"]
    near = Term(entry, {"energy": 3.0}, sd=np.inf)
    alone = profile_shared([sources], Term(entry, {"energy": 2.7}))
    beside = profile_shared([sources], Term(entry, {"energy": 2.7}), [near])
    assert abs(alone.z) > 5
    assert abs(beside.z) < 3.5
    assert beside.phi[1] == pytest.approx(0.1, abs=0.1)
    with pytest.raises(InputError, match="knows nothing of dip beside its nuisances"):
        profile_shared([sources], Term(entry, {"energy": 3.0}), [near])


def test_several_groups_are_one_catalogue(power_law):
    sources = hidden(power_law, 40, 4, Effect("dip", {"energy": 2.0, "depth": 0.1}))
    entry = sources.simulator.effect_library(np.array([[1000.0, 2.0]]))["dip"]
    whole = profile_shared([sources], Term(entry, {"energy": 2.0}))
    halves = [sources.select(slice(0, 15)), sources.select(slice(15, 40))]
    parts = profile_shared(halves, Term(entry, {"energy": 2.0}))
    assert parts.value == pytest.approx(whole.value, abs=0.05 * whole.standard_error)


def test_fits_with_amplitudes_held_at_neutral_are_plain_fits(power_law):
    sources = hidden(power_law, 10, 5, Effect("dip", {"energy": 2.0, "depth": 0.0}))
    library = sources.simulator.effect_library(np.array([[1000.0, 2.0]]))
    plain = fit(sources.simulator, sources.counts)
    for name in ("dip", "line"):
        shared = share(sources.simulator, [Term(library[name], {"energy": 2.0})])
        held = fit_held(shared, sources, shared.neutral, plain.theta)
        np.testing.assert_allclose(held.objective, plain.objective, atol=2e-3)
        assert held.theta.shape == plain.theta.shape
        assert held.jacobian.shape == plain.jacobian.shape
