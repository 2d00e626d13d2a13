"""Wrong joints with right marginals, from draws alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import judge, make_policy
from gaugeblock.validate.joint.pool import make_pool
from gaugeblock.validate.joint.projections import directions, pairs, projected_pit, projections_finding
from gaugeblock.validate.marginal.coverage import central_finding
from gaugeblock.validate.ranks import randomised_pit

NAMES = list("abcde")
POLICY = make_policy({"required": ["joint"]}, source="test")


def correlated(rng, n, rho, *, one_pair=False):
    """Standard normal parameters, ``(n, 5)``, of which all pairs, or one, have the correlation rho."""
    matrix = np.full((5, 5), 0.0 if one_pair else rho)
    matrix[:2, :2] = rho
    np.fill_diagonal(matrix, 1)
    return rng.normal(size=(n, 5)) @ np.linalg.cholesky(matrix).T


def finding(truth, draws, rng):
    return projections_finding(projected_pit(make_pool(truth, draws), rng), NAMES)


def dropped(seed, *, rho, one_pair=False, n=4000, draws=250):
    """Truths with correlations, draws with the same marginals and none."""
    rng = np.random.default_rng(seed)
    truth = correlated(rng, n, rho, one_pair=one_pair)
    return truth, rng.normal(size=(n, draws, 5)), rng


def verdict(found):
    return judge([found], [], POLICY, seed=1).outcome.value


@pytest.mark.parametrize(
    ("rho", "one_pair"), [(0.8, False), (0.8, True), (0.3, False), (0.3, True), (-0.3, True)]
)
def test_dropped_correlations_are_blocked(rho, one_pair):
    """4,000 trials x 250 draws, five parameters; the marginals, of the same trials, are exact."""
    truth, draws, rng = dropped(1, rho=rho, one_pair=one_pair)
    found = finding(truth, draws, rng)
    assert verdict(found) == "FAIL"
    marginal = central_finding(randomised_pit(truth, draws, rng), NAMES)
    assert np.abs(marginal.estimate / marginal.standard_error).max() < 4
    at = dict(zip(found.components, found.estimate, strict=True))
    # P(a b < 0) = arccos(rho) / pi for standard normals: half of the draws, and this share of truths.
    assert at["lower tail of a*b @ 0.5"] == pytest.approx(np.arccos(rho) / np.pi - 0.5, abs=0.03)


def test_power_at_the_weak_correlation():
    """Correlation 0.3 dropped in one pair of five parameters: 10 of 10 audits of 2,000 x 100 have |z| > 5."""
    for seed in range(10):
        found = finding(*dropped(100 + seed, rho=0.3, one_pair=True, n=2000, draws=100))
        assert np.abs(found.estimate / found.standard_error).max() > 5


def test_reversed_correlations_are_blocked():
    rng = np.random.default_rng(2)
    truth = correlated(rng, 2000, 0.5, one_pair=True)
    draws = correlated(rng, 2000 * 100, -0.5, one_pair=True).reshape(2000, 100, 5)
    assert verdict(finding(truth, draws, rng)) == "FAIL"


def test_a_thin_direction_that_is_three_times_too_wide_is_seen():
    """Correlation 0.99 against 0.91: in the parameters' own units no random direction would show it."""
    rng = np.random.default_rng(3)
    truth = correlated(rng, 2000, 0.99, one_pair=True)
    draws = correlated(rng, 2000 * 100, 0.91, one_pair=True).reshape(2000, 100, 5)
    found = finding(truth, draws, rng)
    assert found.components[int(np.abs(found.estimate).argmax())].startswith("projection ")
    assert verdict(found) == "FAIL"


@pytest.mark.parametrize("draws", [6, 40])
def test_exact_posteriors_of_any_shape_keep_the_level(draws):
    """60 audits of 1,000 skewed, correlated posteriors: mean z of each of 94 components within 4.5 errors
    (94 x 7e-6), and the largest |z| of an audit above 4.5 at most once (94 x 7e-6 each)."""
    rng = np.random.default_rng(draws)
    z = []
    for _ in range(60):
        pool = np.exp(correlated(rng, 1000 * (draws + 1), 0.6)).reshape(1000, draws + 1, 5)
        found = finding(pool[:, 0], pool[:, 1:], rng)
        z.append(found.estimate / found.standard_error)
    z = np.array(z)
    assert (np.abs(z.mean(axis=0)) < 4.5 / np.sqrt(60)).all()
    assert (np.abs(z).max(axis=1) > 4.5).sum() <= 1
    assert 0.9 < z.std() < 1.1


def test_components_have_names_and_stay_few():
    rng = np.random.default_rng(4)
    found = finding(rng.normal(size=(100, 5)), rng.normal(size=(100, 20, 5)), rng)
    assert found.components[2] == "projection 1 @ 0.8"
    assert found.components[-1] == "lower tail of d*e @ 0.8"
    assert len(found.components) == 16 * 4 + 10 * 3
    assert found.influence.shape == (94, 100)
    assert (found.kind, found.quantity, found.population) == ("mean", "joint", "trials")


def test_many_parameters_have_some_of_their_pairs_and_say_so():
    assert len(pairs(7)) == 21
    assert len(set(pairs(20))) == 21
    rng = np.random.default_rng(5)
    names = [f"p{k}" for k in range(9)]
    pit = projected_pit(make_pool(rng.normal(size=(50, 9)), rng.normal(size=(50, 40, 9))), rng)
    assert projections_finding(pit, names).caveats == ("products of 21 of 36 pairs of parameters",)


def test_directions_are_fixed_and_all_over_the_sphere():
    np.testing.assert_array_equal(directions(5), directions(5))
    assert np.linalg.eigvalsh(directions(5).T @ directions(5)).min() > 0.5


def test_structure_beyond_pairs_that_no_direction_shows_is_a_blind_spot():
    """The sign of a product of three standard normals fixed: every pair independent, products uninformative.

    Documented: projections of three parameters change in their third moment alone, by little.
    """
    rng = np.random.default_rng(6)
    truth = rng.normal(size=(4000, 5))
    truth[:, 0] = np.abs(truth[:, 0]) * np.sign(truth[:, 1] * truth[:, 2])
    found = finding(truth, rng.normal(size=(4000, 100, 5)), rng)
    products = [k for k, name in enumerate(found.components) if "*" in name]
    assert np.abs(found.estimate / found.standard_error)[products].max() < 4
    assert stats.kstest(stats.norm.cdf(truth[:, 0]), "uniform").pvalue > 1e-3


@pytest.mark.parametrize("parameters", [1, 2, 9])
def test_ranks_are_of_projections_then_of_products(parameters):
    """By a loop, in single precision; a single parameter has neither."""
    rng = np.random.default_rng(41)
    truth, draws = rng.normal(size=(5, parameters)), rng.normal(size=(5, 30, parameters))
    pool = make_pool(truth, draws)
    number, chosen = len(directions(parameters)), pairs(parameters)
    found = projected_pit(pool, np.random.default_rng(42))
    assert number == (0 if parameters == 1 else 16)
    assert found.shape == (5, number + len(chosen))
    lot = np.random.default_rng(42).random(found.shape)
    np.testing.assert_allclose((directions(parameters) ** 2).sum(axis=1), 1)
    for k in range(5):
        white = pool.whitening[k] @ pool.members[k]
        rows = [d @ white for d in directions(parameters)]
        rows += [pool.members[k, a] * pool.members[k, b] for a, b in chosen]
        for q, row in enumerate(rows):
            assert found[k, q] == pytest.approx((np.sum(row[1:] < row[0]) + lot[k, q]) / 31)


def test_gaps_of_projections_are_central_and_of_products_lowest():
    u = np.random.default_rng(43).random((60, 17))
    found = projections_finding(u, ["a", "b"], caveats=("said",))
    wanted = [np.mean(abs(u[:, k] - 0.5) <= at / 2) - at for k in range(16) for at in (0.3, 0.5, 0.8, 0.95)]
    wanted += [np.mean(u[:, 16] <= at) - at for at in (0.2, 0.5, 0.8)]
    np.testing.assert_allclose(found.estimate, wanted)
    assert found.components[:4] == tuple(f"projection 1 @ {at}" for at in (0.3, 0.5, 0.8, 0.95))
    assert found.components[60:64] == tuple(f"projection 16 @ {at}" for at in (0.3, 0.5, 0.8, 0.95))
    assert found.components[64:] == tuple(f"lower tail of a*b @ {at}" for at in (0.2, 0.5, 0.8))
    np.testing.assert_array_equal(found.details["direction"], directions(2))
    assert found.details["projection"].values.tolist() == list(range(1, 17))
    assert (found.caveats, found.n_trials) == (("said",), 60)
