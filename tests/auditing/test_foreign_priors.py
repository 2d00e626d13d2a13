"""An audit with somebody else's prior runs, judges what can be judged and says what is missing, by name."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.auditing.collect import collect, fingerprint
from gaugeblock.auditing.identity import identity, lasting
from gaugeblock.auditing.samples import Plan
from gaugeblock.core.errors import InputError
from gaugeblock.estimators import build_estimator
from gaugeblock.simulators import Discrete, MultivariateNormal, Normal, Prior, Uniform, as_prior
from gaugeblock.validate import NotChecked, run_validators
from gaugeblock.validate.ranks import randomised_ranks

PLAN = Plan(
    number=200,
    draws=60,
    block=100,
    importance_number=20,
    importance_draws=100,
    joint_number=50,
    joint_draws=20,
    seed=5,
)
SD = 0.5


class Noisy:
    """Every parameter plus normal noise."""

    def __init__(self, prior):
        self.prior = as_prior(prior)

    def simulate(self, theta, rng):
        return rng.normal(theta, SD)

    def log_likelihood(self, theta, x):
        return stats.norm.logpdf(x, theta, SD).sum(axis=-1)

    def describe(self):
        return {"simulator": "noisy", "prior": self.prior.describe()}


class Weighing:
    """The posterior by resampling draws of the prior."""

    def __init__(self, simulator):
        self.simulator = simulator

    def sample(self, x, n, rng):
        proposed = self.simulator.prior.sample(4000, rng)
        weight = np.exp(self.simulator.log_likelihood(proposed, x[:, None]))
        chosen = [rng.choice(4000, n, p=row / row.sum()) for row in weight]
        return np.stack([proposed[rows] for rows in chosen])

    def log_prob(self, theta, x):
        """Of draws of a sampler that has no density, taken as normal."""
        return stats.norm.logpdf(theta, x[:, None], SD).sum(axis=-1)

    def describe(self):
        return {"estimator": "weighing"}


def draws_alone(n, rng):
    return rng.normal(size=(n, 2))


def judged(simulator, tmp_path):
    trees = [collect(simulator, Weighing(simulator), PLAN, tmp_path / str(k)) for k in range(2)]
    np.testing.assert_array_equal(trees[0]["draws"].values, trees[1]["draws"].values)
    said = run_validators(trees[0], seed=1)
    return [each for part in said for each in (part if isinstance(part, tuple | list) else [part])]


def test_a_prior_that_can_only_be_drawn_from(tmp_path):
    said = judged(Noisy(draws_alone), tmp_path)
    missing = {each.id: each.why for each in said if isinstance(each, NotChecked)}
    assert "draws_alone of theta_1, theta_2 has no density" in missing["importance.ess"]
    found = [each for each in said if not isinstance(each, NotChecked)]
    assert {"sbc", "coverage", "joint"} <= {each.validator for each in found}


@pytest.mark.parametrize(
    "prior", [{"k": stats.poisson(3.0)}, {"k": Discrete((0.0, 1.0), (0.3, 0.7)), "a": Normal(0.0, 1.0)}]
)
def test_discrete_parameters(prior, tmp_path):
    # Ranks of draws that tie with the truth are randomised. Kolmogorov-Smirnov at 1e-4: 1 seed in 10,000.
    simulator = Noisy(prior)
    missing = {each.id: each.why for each in judged(simulator, tmp_path) if isinstance(each, NotChecked)}
    assert "k takes few values" in missing["density.normalisation"]
    rng = np.random.default_rng(7)
    theta = simulator.prior.sample(400, rng)
    draws = Weighing(simulator).sample(simulator.simulate(theta, rng), 60, rng)
    u = (randomised_ranks(theta, draws, rng) + rng.random(theta.shape)) / 61
    assert stats.kstest(u[:, 0], "uniform").pvalue > 1e-4


def test_a_correlated_and_a_sample_prior_are_part_of_the_identity():
    one = Noisy({("a", "b"): MultivariateNormal([0, 0], [[1.0, 0.5], [0.5, 1.0]])})
    other = Noisy({("a", "b"): MultivariateNormal([0, 0], [[1.0, 0.4], [0.4, 1.0]])})
    keys = [fingerprint(each, Weighing(each), PLAN) for each in (one, one, other)]
    assert keys[0] == keys[1] != keys[2]
    assert lasting(identity(one))


def test_what_cannot_be_told_apart_is_never_resumed():
    scale = 2.0
    closing = Noisy(lambda n, rng: scale * rng.normal(size=(n, 1)))
    assert not lasting(identity(closing))
    assert fingerprint(closing, Weighing(closing), PLAN) != fingerprint(closing, Weighing(closing), PLAN)


@pytest.mark.parametrize(
    ("name", "options", "prior", "says"),
    [
        (
            "nested_sampling",
            {},
            draws_alone,
            r"quantile function \(unit cube\); the .*draws_alone of theta_1",
        ),
        (
            "nested_sampling",
            {},
            stats.dirichlet([1, 1]),
            r"unit cube\); the dirichlet of theta_1, theta_2 has none",
        ),
        ("nuts", {}, stats.poisson(2.0), "estimator nuts needs the prior's bijection"),
        ("conformal", {"seed": 1}, stats.poisson(2.0), "estimator conformal needs the prior's bijection"),
        ("importance_refined", {}, draws_alone, "estimator importance_refined needs the prior's density"),
    ],
)
def test_estimators_that_need_more_say_so(name, options, prior, says):
    if name in ("nuts", "nested_sampling"):
        pytest.importorskip({"nuts": "numpyro", "nested_sampling": "ultranest"}[name])
    simulator = Noisy(prior)
    simulator.log_likelihood_jax = simulator.log_likelihood
    if name in ("conformal", "importance_refined"):
        options = {**options, "base": Weighing(simulator)}
    with pytest.raises(InputError, match=says) as caught:
        build_estimator(name, simulator, **options)
    assert "\n" not in str(caught.value)


def test_a_flow_s_prior_must_be_one_that_its_folder_can_say(tmp_path):
    pytest.importorskip("sbi")
    from gaugeblock.estimators.npe import TrainingConfig, train

    config = TrainingConfig.build({"simulator": {"name": "own:noisy"}})
    with pytest.raises(InputError, match="estimator npe needs the prior's bijection"):
        train(Noisy(stats.poisson(2.0)), config, folder=tmp_path / "a")
    histogram = stats.rv_histogram(np.histogram(np.random.default_rng(0).normal(size=500), bins=20))
    with pytest.raises(InputError, match="could not say what the prior is"):
        train(Noisy(histogram), config, folder=tmp_path / "b")


def test_the_zoo_s_prior_and_nested_sampling_with_a_quantile_function(tmp_path):
    simulator = Noisy({"k": stats.randint(0, 4), "a": Uniform(-1.0, 1.0)})
    wrong = build_estimator("broken", simulator, fault="prior", base=Weighing(simulator))
    assert wrong.sample(np.zeros((3, 2)), 20, np.random.default_rng(1)).shape == (3, 20, 2)
    pytest.importorskip("ultranest")
    nested = build_estimator("nested_sampling", simulator, live_points=60, min_effective_draws=100)
    draws = nested.sample(np.array([[2.0, 0.3]]), 50, np.random.default_rng(1))
    assert set(np.unique(draws[..., 0])) <= {0.0, 1.0, 2.0, 3.0}
    assert isinstance(simulator.prior, Prior)
