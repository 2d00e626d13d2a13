"""The reach of a catalogue: errors against the number of sources, and what unmodelled nuisances fake."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.name.floor import reach
from gaugeblock.discovery.name.shared_score import SharedScores, shared_scores
from gaugeblock.discovery.name.stacked import stack


@pytest.fixture(scope="module")
def scores():
    """Forty sources of random whitened templates: one effect, three nuisances, no parameters of their own."""
    rng = np.random.default_rng(0)
    common = rng.normal(size=(4, 30))
    common[1:] += common[0]
    every = common + 0.5 * rng.normal(size=(40, 4, 30))
    gram = np.einsum("nic,njc->nij", every, every)
    noise = np.einsum("nic,nc->ni", every, rng.normal(size=(40, 30)))
    return SharedScores(
        noise[:, :1], gram[:, 0, :1], gram[:, 0, :1], noise[:, 1:], gram[:, :1, 1:], gram[:, 1:, 1:]
    )


def test_the_error_is_the_stacks_own_and_falls_as_the_root(scores):
    found = reach(scores, np.inf, number=[10, 40, 4000])
    assert found.standard_error[1] == pytest.approx(stack(scores, np.inf).standard_error)
    assert found.standard_error[1] / found.standard_error[2] == pytest.approx(10.0)
    assert found.floor == pytest.approx([0.0])


def test_priors_help_few_sources_and_not_many(scores):
    free, held = (reach(scores, sd, number=[1, 100_000]).standard_error[:, 0] for sd in (np.inf, 0.02))
    assert held[0] < 0.9 * free[0]
    assert held[1] == pytest.approx(free[1], rel=1e-2)


def test_the_floor_is_the_spread_of_estimates_from_endless_data(scores):
    sd = np.array([np.inf, 0.3, 0.2])
    modelled = np.array([True, False, False])
    found = reach(scores, sd, number=[40], modelled=modelled)
    rng = np.random.default_rng(1)
    drawn = np.concatenate([np.zeros((4000, 1)), rng.normal(0, sd[1:], (4000, 2))], axis=1)
    cross, products = scores.cross.sum(axis=0)[0], scores.nuisance_information.sum(axis=0)
    score, nuisance = drawn @ cross, drawn @ products[:, 0]
    weight = cross[0] / products[0, 0]
    own = scores.information.sum() - weight * cross[0]
    fakes = (score - weight * nuisance) / own
    assert found.floor[0] == pytest.approx(fakes.std(), rel=0.05)


def test_an_unmodelled_nuisance_needs_a_size(scores):
    with pytest.raises(InputError, match="an unmodelled nuisance needs a finite sd"):
        reach(scores, np.inf, number=[1], modelled=[True, True, False])


def test_without_nuisances_there_is_no_floor(power_law):
    rng = np.random.default_rng(2)
    from gaugeblock.discovery.fitting import fit

    simulator = power_law()
    counts = simulator.simulate(np.array([[1000.0, 2.0]] * 3), rng)
    fitted = fit(simulator, counts)
    found = reach(shared_scores(counts, fitted, rng.normal(size=(3, 1, 60))), (), number=[3])
    assert found.floor == pytest.approx([0.0])
    assert np.isfinite(found.standard_error).all()
