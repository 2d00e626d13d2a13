"""Against the exact posterior of the extended simulator, by every engine. Seeds are fixed."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.extend import Refit, refit
from gaugeblock.discovery.extend.refitting import ENGINES

NEEDS = {"nested_sampling": "ultranest", "nuts": "numpyro"}
OPTIONS = {"nested_sampling": {"live_points": 150}, "nuts": {"warmup": 200, "parallel": 8}}


@pytest.fixture(scope="module", params=sorted(ENGINES))
def found(request, line, parabola, bent, data, exact_density):
    if request.param in NEEDS:
        pytest.importorskip(NEEDS[request.param])
    estimator = {"importance": exact_density(line), "flow": exact_density(bent)}.get(request.param)
    return refit(
        line, parabola, data, by=request.param, rng=np.random.default_rng(1), estimator=estimator,
        **OPTIONS.get(request.param, {}),
    )  # fmt: skip


def test_draws_follow_the_extended_posterior(found, bent, data):
    assert found.names == bent.prior.names
    assert found.draws.shape == (2, 2000, 3)
    exact = bent.posterior_sample(data, 100_000, np.random.default_rng(2))
    # Worth at least 250 independent draws: 4.5 standard errors, six means and six standard deviations.
    sd = exact.std(axis=1)
    np.testing.assert_array_less(np.abs(found.draws.mean(axis=1) - exact.mean(axis=1)), 4.5 * sd / 250**0.5)
    np.testing.assert_array_less(np.abs(found.draws.std(axis=1) / sd - 1.0), 4.5 / (2 * 250) ** 0.5)


def test_the_evidence_is_the_extended_simulator_s(found, bent, data):
    if found.by == "nuts":
        assert found.log_evidence is None
        return
    error = np.maximum(found.log_evidence_error, 1e-9)
    assert np.all(error < 0.35)
    np.testing.assert_array_less(np.abs(found.log_evidence - bent.log_evidence(data)), 4.0 * error)


def test_every_engine_says_how_it_went(found):
    good = {
        "nested_sampling": lambda d: d["insertion_order_converged"].all() and (d["calls"] > 500).all(),
        "nuts": lambda d: (d["rhat"] < 1.05).all() and (d["divergences"] < 20).all(),
        "importance": lambda d: (d["khat"] < 0.5).all() and (d["effective_draws"] > 8000).all(),
        "flow": lambda d: (d["khat"] < 0.5).all() and (d["effective_draws"] > 1999).all(),
    }
    assert good[found.by](found.diagnostics)


def test_the_amplitude_is_read_by_name(found, bent, data):
    interval = found.interval("bend_1.amplitude", level=0.9)
    assert interval.shape == (2, 3)
    assert np.all(np.diff(interval, axis=1) > 0)
    exact = bent.posterior_sample(data, 20_000, np.random.default_rng(4))[..., 2]
    inside = (exact > interval[:, :1]) & (exact < interval[:, 2:])
    # The ends of an interval from 250 independent draws are good to 0.014 each.
    np.testing.assert_allclose(inside.mean(axis=1), 0.9, atol=0.08)
    np.testing.assert_array_equal(found.of("bend_1.amplitude"), found.draws[..., 2])
    with pytest.raises(InputError, match=r"no parameter bend; there are level, slope, bend_1\.amplitude"):
        found.of("bend")


def test_one_row_of_data_may_come_without_its_axis(line, parabola, data, exact_density):
    one = refit(
        line, parabola, data[0], by="importance", rng=np.random.default_rng(3), estimator=exact_density(line)
    )
    assert one.draws.shape == (1, 2000, 3)


def test_the_seed_decides(line, parabola, data, exact_density):
    first, again, other = (
        refit(line, parabola, data, by="importance", rng=np.random.default_rng(seed), draws=50,
              estimator=exact_density(line)).draws
        for seed in (1, 1, 2)
    )  # fmt: skip
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_proposals_that_miss_the_posterior_are_refused(line, parabola, data, exact_density):
    # Fitted without the bend, level and slope lie many standard deviations from where they belong.
    with pytest.raises(InputError, match=r"k-hat of source \d is \d\.\d+ > 0\.7.*nested_sampling"):
        refit(
            line, parabola, data, by="importance", rng=np.random.default_rng(1), rounds=0,
            estimator=exact_density(line),
        )  # fmt: skip


def test_a_flow_without_evidence_where_its_weights_fail(line, parabola, bent, data, exact_density):
    class Narrow(exact_density):
        def sample(self, x, n, rng):
            draws = super().sample(x, n, rng)
            center = draws.mean(axis=1, keepdims=True)
            return center + 0.3 * (draws - center)

        def log_prob(self, theta, x):
            center = theta.mean(axis=1, keepdims=True)
            return super().log_prob(center + (theta - center) / 0.3, x) - 3 * np.log(0.3)

    found = refit(line, parabola, data, by="flow", rng=np.random.default_rng(1), estimator=Narrow(bent))
    assert np.all(found.diagnostics["khat"] > 0.7)
    assert np.all(np.isnan(found.log_evidence))


def test_chains_in_two_modes_are_refused():
    pytest.importorskip("numpyro")
    from gaugeblock.simulators import Effect, Prior, Uniform

    class Twofold:
        """The data know the square of the effect's parameter only."""

        prior = Prior({"level": Uniform(-5.0, 5.0)})

        def with_effect(self, effect):
            other = Twofold()
            other.prior = self.prior * effect.prior("turn_1")
            return other

        def log_likelihood_jax(self, theta, x):
            return -0.5 * ((x[0] - theta[1] ** 2) / 0.1) ** 2 - 0.5 * ((x[1] - theta[0]) / 0.1) ** 2

    turn = Effect("turn", {"angle": Uniform(-3.0, 3.0)})
    with pytest.raises(InputError, match=r"disagree on turn_1\.angle \(R-hat .*nested_sampling"):
        refit(
            Twofold(), turn, [4.0, 0.0], by="nuts", rng=np.random.default_rng(6), draws=200, warmup=100,
            starts=1,
        )  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"by": "magic"}, "by must be one of nested_sampling, nuts, importance, flow"),
        ({"by": "flow"}, "give the trained estimator"),
        ({"by": "nested_sampling", "estimator": object()}, "takes no estimator"),
        ({"by": "importance", "estimator": object()}, "object has no log_prob"),
    ],
)
def test_what_cannot_be_done_is_said(line, parabola, data, changes, words):
    with pytest.raises(InputError, match=words):
        refit(line, parabola, data, rng=np.random.default_rng(1), **changes)


def test_a_flow_that_does_not_say_what_it_draws_is_taken_at_its_word(line, parabola, bent, data):
    class Nameless:
        """Exact draws, without a prior and without a density."""

        def sample(self, x, n, rng):
            return bent.posterior_sample(x, n, rng)

    found = refit(
        line, parabola, data, by="flow", rng=np.random.default_rng(2), draws=50, estimator=Nameless()
    )
    np.testing.assert_array_equal(found.draws, bent.posterior_sample(data, 50, np.random.default_rng(2)))
    assert found.log_evidence is found.log_evidence_error is None
    assert found.diagnostics == {}


def test_estimators_of_other_parameters_are_refused(line, parabola, bent, data, exact_density):
    rng = np.random.default_rng(1)
    words = "draws level, slope; the extended simulator has level, slope, bend_1.amplitude: train one for it"
    with pytest.raises(InputError, match=words):
        refit(line, parabola, data, by="flow", rng=rng, estimator=exact_density(line))
    with pytest.raises(InputError, match="simulator without the effects"):
        refit(line, parabola, data, by="importance", rng=rng, estimator=exact_density(bent))
    with pytest.raises(InputError, match="rounds >= 0, proposals >= 100"):
        refit(line, parabola, data, by="importance", rng=rng, proposals=10, estimator=exact_density(line))


def test_an_interval_is_of_quantiles_of_each_source(bent):
    draws = np.random.default_rng(8).permuted(np.arange(606.0).reshape(2, 101, 3), axis=1)
    made = Refit(bent, "flow", draws)
    assert made.names == ("level", "slope", "bend_1.amplitude")
    for name, k in (("level", 0), ("bend_1.amplitude", 2)):
        at = np.sort(draws[..., k], axis=1)
        np.testing.assert_allclose(made.interval(name), at[:, [5, 50, 95]])
        np.testing.assert_allclose(made.interval(name, level=0.5), at[:, [25, 50, 75]])
