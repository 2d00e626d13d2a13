"""sbi's SBC: ties, discrete ranks, data that are dropped, and a density that costs 10,000 draws a look."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy import stats

from gaugeblock.auditing.collect import collect
from gaugeblock.auditing.samples import Plan
from gaugeblock.core.errors import InputError
from gaugeblock.estimators.exact import Exact
from gaugeblock.simulators import build_simulator
from gaugeblock.validate import judge, make_trials, read_policy, run_validators
from gaugeblock.validate.marginal.discrete_ranks import rank_ecdf_test
from gaugeblock.validate.ranks import randomised_ranks

TRIALS, DRAWS = 1000, 100
PLAN = Plan(
    number=30,
    draws=10,
    block=30,
    importance_number=0,
    importance_draws=0,
    joint_number=0,
    joint_draws=0,
    seed=1,
)


class Given:
    """A posterior whose draws ``(draw, trial, parameter)`` are a function of x."""

    def __init__(self, draws):
        self.draws = draws

    def sample_batched(self, shape, x, show_progress_bars):
        return self.draws(x)


@pytest.fixture(scope="module")
def their_ranks(peer):
    """Ranks from `sbi.diagnostics.run_sbc`, for truths and draws as in our Trials."""
    diagnostics, torch = peer("sbi.diagnostics"), peer("torch")

    def ranks(truth, draws, x=None):
        theta, sampled = (torch.as_tensor(a, dtype=torch.float32) for a in (truth, draws))
        data = torch.zeros(len(theta), 1) if x is None else torch.as_tensor(x, dtype=torch.float32)
        given = Given(lambda kept: sampled.transpose(0, 1)[:, : len(kept)])
        size = sampled.shape[1]
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Number of posterior samples")
            return diagnostics.run_sbc(
                theta, data, given, num_posterior_samples=size, show_progress_bar=False
            )[0]

    return ranks


@pytest.fixture(scope="module")
def their_p_value(peer):
    check = peer("sbi.diagnostics.sbc").check_uniformity_frequentist
    return lambda ranks, draws: float(check(ranks, draws)[0])


def our_p_value(truth, draws, seed=0):
    rng = np.random.default_rng(seed)
    return rank_ecdf_test(randomised_ranks(truth, draws, rng)[:, 0], draws.shape[1], rng).p_value


def exchangeable(seed, values, draws):
    """Truths and draws of an exact posterior of a parameter that takes `values` values; 0: continuous."""
    rng = np.random.default_rng(seed)
    size = (TRIALS, draws + 1, 1)
    pool = rng.integers(0, values, size).astype(float) if values else rng.normal(size=size)
    return pool[:, 0], pool[:, 1:]


def test_theirs_rejects_an_exact_posterior_with_ties(their_ranks, their_p_value):
    truth, draws = exchangeable(1, 2, DRAWS)
    assert their_p_value(their_ranks(truth, draws), DRAWS) < 1e-12


def test_ours_breaks_ties_at_random():
    """False-alarm rate 1e-3."""
    assert our_p_value(*exchangeable(1, 2, DRAWS)) > 1e-3


def test_theirs_rejects_exact_posteriors_with_few_draws(their_ranks, their_p_value):
    """Ranks among 20 draws are discrete; against a continuous uniform nearly all of them are rejected."""
    problems = [exchangeable(seed, 0, 20) for seed in range(40)]
    rejected = [their_p_value(their_ranks(*problem), 20) <= 0.05 for problem in problems]
    assert np.mean(rejected) > 0.8


def test_ours_rejects_as_often_as_it_says():
    """At most as many of 40 as a test of size 5% exceeds with probability 1e-3."""
    rejected = [our_p_value(*exchangeable(seed, 0, 20), seed) <= 0.05 for seed in range(40)]
    assert sum(rejected) <= stats.binom.ppf(0.999, 40, 0.05)


def with_missing_data():
    """An exact posterior of N(0, 1) and N(theta, 1), and x that is NaN in every tenth trial."""
    rng = np.random.default_rng(3)
    theta = rng.normal(size=(TRIALS, 1))
    x = theta + rng.normal(size=theta.shape)
    draws = (x / 2)[:, None] + np.sqrt(0.5) * rng.normal(size=(TRIALS, DRAWS, 1))
    draws[::10] = np.nan
    x[::10] = np.nan
    return theta, draws, x


def test_theirs_drops_trials_whose_data_are_nan(their_ranks):
    theta, draws, x = with_missing_data()
    kept = np.isfinite(x[:, 0])
    with pytest.warns(UserWarning, match="100 NaNs and 0 Infs in the data. These will be ignored"):
        ranks = their_ranks(theta, np.concatenate([draws[kept], draws[~kept]]), x)
    assert len(ranks) == 900


def test_ours_blocks_an_estimator_that_cannot_answer():
    theta, draws, _ = with_missing_data()
    findings, not_checked = run_validators(make_trials(theta, draws, ["a"]), seed=1)
    finite = next(finding for finding in findings if finding.id == "draws.finite")
    assert finite.estimate[0] == 100 * DRAWS
    assert judge(findings, not_checked, read_policy("default"), seed=1).outcome.name == "FAIL"


def test_ours_refuses_a_simulator_that_gives_nan(tmp_path):
    _, _, x = with_missing_data()
    simulator = build_simulator("linear_gaussian", parameters=1, data=1)

    class Broken:
        prior = simulator.prior

        def simulate(self, theta, rng):
            return x[: len(theta)]

    with pytest.raises(InputError, match="NaN or infinite data for trial 0"):
        collect(Broken(), Exact(simulator), PLAN, tmp_path)


def test_theirs_draws_ten_thousand_for_each_look_at_the_density(peer):
    """Expected coverage as the documentation has it: `reduce_fns=posterior.log_prob`."""
    diagnostics, torch, nets = peer("sbi.diagnostics"), peer("torch"), peer("sbi.neural_nets")
    posteriors, utils = peer("sbi.inference"), peer("sbi.utils")
    torch.manual_seed(0)
    prior = utils.BoxUniform(-torch.ones(2), torch.ones(2))
    theta = 0.1 * prior.sample((200,))
    x = theta + 0.1 * torch.randn(200, 2)
    flow = nets.posterior_nn("mdn")(theta, x)
    posterior = posteriors.DirectPosterior(flow, prior)
    drawn = []
    sample = flow.sample
    flow.sample = lambda shape, *a, **k: drawn.append(int(np.prod(shape))) or sample(shape, *a, **k)
    trials, draws = 2, 10
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        diagnostics.run_sbc(
            theta[:trials], x[:trials], posterior, reduce_fns=posterior.log_prob,
            num_posterior_samples=draws, show_progress_bar=False,
        )  # fmt: skip
    # Twice a trial: once for the draws, once for the truth.
    assert sum(drawn) >= 2 * trials * 10_000


def test_ours_records_the_density_once(tmp_path):
    """One log density a draw and one a truth; validators read them from the trials."""
    simulator = build_simulator("linear_gaussian", parameters=2, data=3)
    seen = {"drawn": 0, "looked": 0}

    class Counted(Exact):
        def sample(self, x, n, rng):
            seen["drawn"] += len(x) * n
            return super().sample(x, n, rng)

        def log_prob(self, theta, x):
            seen["looked"] += int(np.prod(np.shape(theta)[:-1]))
            return super().log_prob(theta, x)

    tree = collect(simulator, Counted(simulator), PLAN, tmp_path)
    findings, _ = run_validators(tree, seed=1, select=["joint"])
    assert "joint.hpd" in {finding.id for finding in findings}
    assert seen == {"drawn": 300, "looked": 330}
