"""Posterior SBC on a conjugate Gaussian: exact size at any effective sample size, power near the observation.

theta ~ N(0, 1), x ~ N(theta, 1): p(theta | x) = N(x / 2, 1/2), p(theta | x, x_obs) = N((x + x_obs) / 3, 1/3).
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rows
from gaugeblock.validate import (
    NotChecked,
    Outcome,
    judge,
    make_policy,
    make_trials,
    read_trials,
    trials_tree,
    write_trials,
)
from gaugeblock.validate.local.posterior_sbc import (
    IDS,
    pool_weights,
    posterior_sbc,
    posterior_sbc_findings,
    weighted_pit,
)
from gaugeblock.validate.marginal.half_widths import bias_finding, half_width_scores, log_width_finding
from gaugeblock.validate.marginal.sbc import uniform_finding
from gaugeblock.validate.prepared import Prepared

SD = np.sqrt(0.5)
POLICY = make_policy({"required": ["posterior_sbc.bias", "posterior_sbc.log_width"]}, source="test")
OBSERVED = 4.0  # 2.8 sd from the centre of the prior predictive distribution


def around(n, draws, *, seed, ratio=None, dimensions=1, truths=None):
    """Truths of p(theta | x_obs), draws of q(theta | x'), log likelihood of x_obs at draws and truth.

    `ratio` is the width of q over the true one, as a function of its data ``(n, dimensions)``.
    """
    rng = np.random.default_rng(seed)
    theta = OBSERVED / 2 + SD * rng.normal(size=(n, dimensions)) if truths is None else truths
    x = theta + rng.normal(size=theta.shape)
    width = np.ones_like(x) if ratio is None else ratio(x)
    sampled = (x / 2)[:, None] + SD * width[:, None] * rng.normal(size=(n, draws, theta.shape[1]))
    likelihood, true = (-0.5 * ((OBSERVED - value) ** 2).sum(axis=-1) for value in (sampled, theta))
    return theta, sampled, likelihood, true


def narrow_nearby(x):
    """Exact, but for data within 2 of the observation: there 0.6 times as wide as it should be."""
    return np.where(np.abs(x - OBSERVED) < 2, 0.6, 1.0)


def findings(arrays, seed=1):
    names = tuple(f"p{k}" for k in range(arrays[0].shape[1]))
    return {finding.id: finding for finding in posterior_sbc_findings(*arrays, names, seed=seed)}


@pytest.mark.parametrize("draws", [2, 10, 100])
def test_ranks_are_exact_at_any_number_of_draws(draws):
    """40,000 trials: uniform by Kolmogorov-Smirnov at p = 1e-4."""
    theta, sampled, likelihood, true = around(40_000, draws, seed=draws)
    weight = pool_weights(likelihood, true)
    u = weighted_pit(theta, sampled, weight, np.random.default_rng(1))[:, 0]
    assert stats.kstest(u, "uniform").pvalue > 1e-4


def test_the_order_of_draws_says_nothing():
    """Bias and width are of the truth's weight among those of its draws, wherever these stand."""
    theta, sampled, likelihood, true = around(300, 40, seed=8)
    turned = (theta, sampled[:, ::-1], likelihood[:, ::-1], true)
    one, other = findings((theta, sampled, likelihood, true)), findings(turned)
    for name in ("posterior_sbc.bias[p0]", "posterior_sbc.log_width[p0]"):
        np.testing.assert_allclose(one[name].estimate, other[name].estimate, rtol=1e-6)
        np.testing.assert_allclose(one[name].standard_error, other[name].standard_error, rtol=1e-6)


def test_and_where_the_weights_collapse():
    """Data sets of 20 dimensions: some 2 effective draws of 50, and ranks as uniform as ever (p = 1e-4)."""
    arrays = around(10_000, 50, seed=2, dimensions=20)
    weight = pool_weights(*arrays[2:])
    assert np.median(1 / (weight**2).sum(axis=1)) < 6
    u = weighted_pit(*arrays[:2], weight, np.random.default_rng(3))
    assert min(stats.kstest(column, "uniform").pvalue for column in u.T) > 1e-4 / 20
    found = findings(tuple(a[:200] for a in arrays))
    assert found["posterior_sbc.ess"].estimate[0] < 0.2
    assert "fewer than 10 effective draws: they stay" in found["posterior_sbc.bias[p3]"].caveats[0]
    assert found["posterior_sbc.bias[p3]"].n_trials == 200


def test_effective_draws_where_they_are_known():
    """The weights of N(x/2, 1/2) under the likelihood: their second moments are Gaussian integrals."""
    _, _, likelihood, true = around(2000, 4000, seed=4)
    weight = pool_weights(likelihood, true)
    # E[w]^2 / E[w^2] at distance d = x / 2 - x_obs, for variance s = 1/2.
    theta, sampled, _, _ = around(2000, 4000, seed=4)
    d, s = sampled.mean(axis=1)[:, 0] - OBSERVED, 0.5
    first = np.exp(-0.5 * d**2 / (1 + s)) / np.sqrt(1 + s)
    second = np.exp(-(d**2) / (1 + 2 * s)) / np.sqrt(1 + 2 * s)
    measured = 1 / (weight[:, 1:] ** 2).sum(axis=1) * weight[:, 1:].sum(axis=1) ** 2 / 4000
    np.testing.assert_allclose(np.median(measured / (first**2 / second)), 1, atol=0.02)
    assert theta.shape == (2000, 1)


def test_weights_of_a_pool():
    weight = pool_weights([[-1000.0, -1001.0], [-np.inf, -np.inf]], [-1000.0, -np.inf])
    np.testing.assert_allclose(weight[0], np.array([1, 1, np.exp(-1)]) / (2 + np.exp(-1)))
    np.testing.assert_array_equal(weight[1], [1, 0, 0])
    for wrong in (np.nan, np.inf):
        with pytest.raises(InputError, match=r"NaN or \+inf at 1 draw\(s\), first in trial 1"):
            pool_weights([[0.0, 0.0], [0.0, wrong]], [0.0, 0.0])


def test_ties_are_broken_at_random():
    """A posterior on three values, one draw: ranks uniform over 20,000 trials (p = 1e-4)."""
    rng = np.random.default_rng(5)
    prior, tilt = np.array([0.2, 0.3, 0.5]), np.array([1.0, 4.0, 2.0])
    draws = rng.choice(3, p=prior, size=(20_000, 4))
    truth = rng.choice(3, p=prior * tilt / (prior @ tilt), size=20_000)
    weight = pool_weights(np.log(tilt)[draws], np.log(tilt)[truth])
    u = weighted_pit(truth[:, None], draws[..., None], weight, rng)
    assert stats.kstest(u[:, 0], "uniform").pvalue > 1e-4


def test_size_of_every_p_value():
    """300 exact audits of 100 trials x 30 draws: rejections at 5% within the 0.9995 binomial limits.

    That of the width is Bonferroni's over three levels.
    """
    p = {name: [] for name in IDS[:3]}
    for replicate in range(300):
        found = findings(around(100, 30, seed=[7, replicate]), seed=replicate)
        for name in p:
            p[name].append(found[f"{name}[p0]"].p_value)
    rejected = {name: np.count_nonzero(np.array(values) <= 0.05) for name, values in p.items()}
    assert rejected["posterior_sbc.uniform"] <= stats.binom.ppf(0.9995, 300, 0.05)
    assert max(rejected.values()) <= stats.binom.ppf(0.9995, 300, 0.055)
    assert rejected["posterior_sbc.bias"] >= stats.binom.ppf(0.0005, 300, 0.04)


def test_a_fault_near_the_observation_is_seen():
    """Too narrow, for data within 2 of the observation: blocked with 1,000 trials x 200 draws.

    Half of the x' lie there; the width ratio over all is 0.79, 2.3 simultaneous errors beyond tolerance.
    """
    found = findings(around(1000, 200, seed=8, ratio=narrow_nearby))
    assert found["posterior_sbc.uniform[p0]"].p_value < 1e-4
    gates = {gate.id: gate for gate in judge(list(found.values()), [], POLICY, seed=1).gates}
    assert gates["posterior_sbc.log_width[p0]"].outcome is Outcome.FAIL
    assert set(gates) == {"posterior_sbc.log_width[p0]", "posterior_sbc.bias[p0]"}


def test_an_exact_estimator_passes_there():
    found = findings(around(4000, 200, seed=8))
    assert judge(list(found.values()), [], POLICY, seed=1).outcome is Outcome.PASS


def test_the_same_fault_hides_among_all_trials(marginal_findings):
    """Over the whole prior it concerns 8% of data: SBC of 8,000 trials passes the default policy."""
    rng = np.random.default_rng(9)
    theta = rng.normal(size=(8000, 1))
    x = theta + rng.normal(size=(8000, 1))
    draws = (x / 2)[:, None] + SD * narrow_nearby(x)[:, None] * rng.normal(size=(8000, 100, 1))
    found = marginal_findings("p0", theta, draws)
    policy = make_policy({"required": ["sbc"]}, source="test")
    assert judge(found, [], policy, seed=1).outcome is Outcome.PASS


def test_reweighting_the_draws_at_the_observation_would_see_nothing():
    """Why draws come from q at x': truths and draws of one q(theta | x_obs), weighted by the likelihood of
    x', are exchangeable whatever q is. Here q is three times too narrow and off by 2 sd. (p = 1e-4)
    """
    rng = np.random.default_rng(10)
    q = OBSERVED / 2 + SD * (2 + rng.normal(size=(4000, 100, 1)) / 3)
    theta, sampled = q[:, 0], q[:, 1:]
    x = theta + rng.normal(size=theta.shape)
    likelihood, true = (-0.5 * ((x[:, None] - v) ** 2)[..., 0] for v in (sampled, theta[:, None]))
    u = weighted_pit(theta, sampled, pool_weights(likelihood, true[:, 0]), rng)
    assert stats.kstest(u[:, 0], "uniform").pvalue > 1e-4


def group(arrays, **extra):
    theta, sampled, likelihood, true = arrays
    largest = likelihood.max(axis=1)
    names = [f"p{k}" for k in range(theta.shape[1])]
    made = make_trials(theta, sampled, names, weight=np.exp(likelihood - largest[:, None]), **extra)
    return made.assign(weight_true=("trial", np.exp(true - largest)))


def test_the_group_of_a_tree_gives_the_same_as_the_arrays(gaussian_trials, tmp_path):
    arrays = around(300, 50, seed=11, dimensions=2)
    main = gaussian_trials(50, 20, 2, seed=1)
    path = write_trials(trials_tree(main, posterior=group(arrays)), tmp_path / "trials.nc")
    found = posterior_sbc(Prepared(read_trials(path), 1))
    plain = findings(arrays)
    assert [finding.id for finding in found] == list(plain)
    for finding in found:
        assert finding.population == "posterior"
        assert finding.claim
        np.testing.assert_allclose(finding.estimate, plain[finding.id].estimate, rtol=1e-9, atol=1e-12)


def test_draws_that_are_not_finite_are_said(gaussian_trials):
    arrays = around(100, 20, seed=12)
    arrays[1][:, 1::2] = arrays[1][:, ::2]
    arrays[1][3, 4, 0] = np.nan
    tree = trials_tree(gaussian_trials(50, 20, 1, seed=1), posterior=group(arrays))
    found = posterior_sbc(Prepared(tree, 1))
    assert {finding.n_trials for finding in found} == {99}
    assert any("1 of 100 trials have NaN" in caveat for caveat in found[0].caveats)
    assert any("draws depend on their order" in caveat for caveat in found[0].caveats)


def test_circular_parameters_are_cut_open(gaussian_trials):
    """A posterior across the seam of the circle: ranks as on the line (p = 1e-4)."""
    rng = np.random.default_rng(13)
    pool = rng.vonmises(np.pi, 4.0, size=(2000, 20, 1))
    made = make_trials(pool[:, 0], pool[:, 1:], ["p0"], weight=np.ones((2000, 19)), circular=["p0"])
    made = made.assign(weight_true=("trial", np.ones(2000)))
    found = posterior_sbc(Prepared(trials_tree(gaussian_trials(50, 20, 1, seed=1), posterior=made), 1))
    spread = {finding.id: finding for finding in found}["posterior_sbc.uniform[p0]"]
    assert spread.p_value > 1e-4


@pytest.mark.parametrize(
    ("drop", "words"),
    [(None, "trials.observation"), (["weight"], "lack weight:"), (["weight_true"], "lack weight_true:")],
)
def test_what_is_missing_is_said(gaussian_trials, drop, words):
    further = {} if drop is None else {"posterior": group(around(50, 20, seed=14)).drop_vars(drop)}
    said = posterior_sbc(Prepared(trials_tree(gaussian_trials(50, 20, 1, seed=1), **further), 1))
    assert all(isinstance(item, NotChecked) and words in item.why for item in said)
    assert tuple(item.id for item in said) == IDS


def test_a_single_trial_is_too_few(gaussian_trials):
    made = group(around(1, 20, seed=15))
    said = posterior_sbc(Prepared(trials_tree(gaussian_trials(50, 20, 1, seed=1), posterior=made), 1))
    assert all(isinstance(item, NotChecked) and "1 trial(s)" in item.why for item in said)


def test_weighted_ranks_by_a_loop():
    rng = np.random.default_rng(21)
    truth, draws = rng.integers(0, 4, (8, 2)) * 1.0, rng.integers(0, 4, (8, 5, 2)) * 1.0
    weight = rng.dirichlet(np.full(6, 0.5), size=8)
    found = weighted_pit(truth, draws, weight, np.random.default_rng(22))
    lot = np.random.default_rng(22).random((8, 2))
    for trial, k in np.ndindex(8, 2):
        below = weight[trial, 1:][draws[trial, :, k] < truth[trial, k]].sum()
        equal = weight[trial, 1:][draws[trial, :, k] == truth[trial, k]].sum() + weight[trial, 0]
        assert found[trial, k] == pytest.approx(below + equal * lot[trial, k])


def test_findings_are_those_of_the_weighted_scores():
    """One trial has all its weight at the truth, three have fewer than ten effective draws; by number."""
    theta, sampled, likelihood, true = around(40, 30, seed=23, dimensions=2)
    likelihood[3], likelihood[5, 1:], likelihood[6, 9:] = -np.inf, -np.inf, -np.inf
    number = np.random.default_rng(24).permutation(40)
    found = posterior_sbc_findings(
        theta, sampled, likelihood, true, ("a", "b"), seed=6, trial=number, caveats=("said",)
    )
    assert [one.id for one in found] == [
        *(f"posterior_sbc.{what}[{name}]" for name in "ab" for what in ("bias", "log_width", "uniform")),
        "posterior_sbc.ess",
    ]  # fmt: skip
    weight = pool_weights(likelihood, true)
    shares = weight[:, 1:]
    squares = (shares**2).sum(axis=1)
    effective = np.divide(shares.sum(axis=1) ** 2, squares, out=np.zeros(40), where=squares > 0)
    few = int((effective < 10).sum())
    assert 3 <= few < 40
    caveats = (
        "said",
        f"{few} of 40 trials have fewer than 10 effective draws: they stay, but can hardly show a fault; "
        "more draws would help",
    )
    u = weighted_pit(theta, sampled, weight, Rows(6, "posterior ranks", number))
    shares = np.where(np.arange(40)[:, None] == 3, 1.0, shares)
    scores = np.concatenate(half_width_scores(theta, sampled, weight=shares, own=weight[:, 0]), axis=-1)
    for k, name in enumerate("ab"):
        wanted = (
            bias_finding(name, scores[:, k], u[:, k]),
            log_width_finding(name, scores[:, k], u[:, k], draws=float(effective.mean())),
            uniform_finding(name, u[:, k], trial=number),
        )
        for one, other in zip(found[3 * k : 3 * k + 3], wanted, strict=True):
            np.testing.assert_allclose(one.estimate, other.estimate, rtol=1e-9)
            np.testing.assert_allclose(one.standard_error, other.standard_error, rtol=1e-9)
            assert one.p_value == pytest.approx(other.p_value, rel=1e-9)
            assert (one.caveats[: len(caveats)], one.population, one.n_trials) == (caveats, "posterior", 40)
            assert one.claim == f"around the observation: {other.claim}"
    ess = found[-1]
    np.testing.assert_allclose(ess.values[0], effective / 30)
    np.testing.assert_allclose(ess.details["ess"], effective / 30)
    assert ess.details["trial"].values.tolist() == number.tolist()
    assert ess.estimate[0] == pytest.approx(np.sort(effective / 30)[19])
    assert (ess.sense, ess.quantity, ess.caveats) == ("at-least", "", caveats)
    assert "fraction of 30 draws" in ess.claim


def test_a_group_s_own_numbers_caveat_and_circles(gaussian_trials):
    arrays = around(40, 30, seed=25)
    made = group(arrays).assign_coords(trial=np.arange(40)[::-1]).assign_attrs(caveat="of a chain")
    made["draws"][7, 2] = np.nan
    made["weight"][5] = 0.0
    tree = trials_tree(gaussian_trials(50, 20, 1, seed=1), posterior=made)
    found = posterior_sbc(Prepared(tree, 9))
    kept = np.delete(np.arange(40), 7)
    with np.errstate(divide="ignore"):
        log = np.log(made["weight"].values[kept]), np.log(made["weight_true"].values[kept])
    wanted = posterior_sbc_findings(
        arrays[0][kept], arrays[1][kept], *log, ("p0",), seed=9, trial=np.arange(40)[::-1][kept]
    )
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one.estimate, other.estimate)
        assert one.p_value == other.p_value or np.isnan(one.p_value)
    assert found[0].caveats[:2] == (
        "of a chain", "1 of 40 trials have NaN or infinite draws; left out here",
    )  # fmt: skip
    two = trials_tree(gaussian_trials(50, 20, 1, seed=1), posterior=made.isel(trial=[0, 1]))
    assert {one.n_trials for one in posterior_sbc(Prepared(two, 9))} == {2}
