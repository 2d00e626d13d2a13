"""Nested sampling: the right evidence and posterior, and no trace left in the host program."""

import logging
import warnings

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import Prior, Uniform, build_simulator

pytest.importorskip("ultranest")

from gaugeblock.estimators.nested_sampling import LOWEST, NestedSampling
from gaugeblock.validate.evidence.bootstrap import thread_bootstrap


@pytest.fixture(scope="module")
def simulator():
    return build_simulator("linear_gaussian")


@pytest.fixture(scope="module")
def x(simulator):
    return simulator.simulate(simulator.prior.sample(2, np.random.default_rng(80)), np.random.default_rng(81))


@pytest.fixture(scope="module")
def run(simulator, x):
    return NestedSampling(simulator, live_points=200).run(x[0], np.random.default_rng(82))


def test_evidence_is_the_analytic_one(simulator, x, run):
    # Within 3 of its errors, as UltraNest states them: a false alarm for 3 seeds in 1,000.
    assert abs(run.log_evidence - simulator.log_evidence(x)[0]) < 3 * run.log_evidence_error
    assert 0.02 < run.log_evidence_error < 0.5


def test_posterior_moments_are_the_analytic_ones(simulator, x, run):
    draws = run.resample(4000, np.random.default_rng(83))
    exact = simulator.posterior_sample(x[:1], 20_000, np.random.default_rng(84))[0]
    effective = 1 / np.sum(np.exp(2 * run.log_weight))
    assert effective > 300
    # 4.5 standard errors of ten numbers (errors of the run's own volumes included): 1 seed in 10,000.
    sd = exact.std(axis=0)
    assert np.all(np.abs(draws.mean(axis=0) - exact.mean(axis=0)) < 4.5 * sd * 1.5 / np.sqrt(effective))
    assert np.all(np.abs(draws.std(axis=0) / sd - 1) < 4.5 * 1.5 / np.sqrt(2 * effective))


def test_the_run_records_what_was_evaluated(simulator, x, run):
    np.testing.assert_allclose(
        run.theta, simulator.prior.from_unit_cube(run.unit_cube), rtol=1e-12, atol=1e-12
    )
    np.testing.assert_allclose(run.log_likelihood, simulator.log_likelihood(run.theta, x[0]), rtol=1e-12)
    assert np.exp(run.log_weight).sum() == pytest.approx(1.0, abs=1e-9)
    assert run.calls >= len(run.theta)


def test_a_run_keeps_what_its_evidence_error_follows_from(simulator, x, run):
    # Pull below 4: 1 seed in 16,000. UltraNest states its bootstrap's largest deviation, not the sd.
    evidence = thread_bootstrap(run, rng=np.random.default_rng(95))
    assert abs(evidence.value - simulator.log_evidence(x)[0]) < 4 * evidence.error
    assert 0.4 < evidence.error / run.log_evidence_error < 1
    from_prior = np.isneginf(run.birth_log_likelihood)
    assert np.count_nonzero(from_prior) == 200
    born_on = run.birth_log_likelihood[~from_prior]
    assert np.isin(born_on, run.log_likelihood).all()
    assert np.all(run.log_likelihood > run.birth_log_likelihood)


@pytest.mark.parametrize("epidemic_rates", [(0.3, 0.12)])
def test_evidence_of_the_epidemic_agrees_with_its_grid(epidemic_rates):
    simulator = build_simulator("epidemic", nodes=129)
    x = simulator.simulate([epidemic_rates], np.random.default_rng(85))
    run = NestedSampling(simulator, live_points=100).run(x[0], np.random.default_rng(86))
    # Within 3 of its errors: a false alarm for 3 seeds in 1,000.
    assert abs(run.log_evidence - simulator.log_evidence(x)[0]) < 3 * run.log_evidence_error
    draws = simulator.prior.to_unit_cube(run.resample(1000, np.random.default_rng(87)))
    exact = simulator.prior.to_unit_cube(simulator.posterior_sample(x, 1000, np.random.default_rng(88))[0])
    assert np.all(np.abs(draws.mean(axis=0) - exact.mean(axis=0)) < 0.3 * exact.std(axis=0))
    np.testing.assert_allclose(draws.std(axis=0), exact.std(axis=0), rtol=0.25)


def test_batches_are_powers_of_two_and_padding_changes_nothing(simulator, x):
    sizes = []

    class Recording:
        prior = simulator.prior

        def log_likelihood(self, theta, data):
            sizes.append(len(theta))
            return simulator.log_likelihood(theta, data)

    sampler = NestedSampling(Recording())
    theta = simulator.prior.sample(100, np.random.default_rng(89))
    for n in (1, 2, 3, 5, 64, 65, 100):
        np.testing.assert_array_equal(
            sampler.evaluated_log_likelihood(theta[:n], x[0]), simulator.log_likelihood(theta[:n], x[0])
        )
    assert sizes == [1, 2, 4, 8, 64, 128, 128]


class Awkward:
    """Likelihood that is -inf on half the prior, or worse where `value` says so."""

    prior = Prior({"a": Uniform(0.0, 1.0), "b": Uniform(0.0, 1.0)})

    def __init__(self, value):
        self.value = value

    def log_likelihood(self, theta, x):
        inside = -50 * np.sum((np.asarray(theta) - 0.75) ** 2, axis=-1)
        return np.where(np.asarray(theta)[..., 0] > 0.5, inside, self.value)


def test_impossible_regions_are_allowed():
    sampler = NestedSampling(Awkward(-np.inf), live_points=100)
    assert sampler.evaluated_log_likelihood(np.array([[0.1, 0.1]]), np.zeros(1))[0] == LOWEST
    run = sampler.run(np.zeros(1), np.random.default_rng(90))
    assert np.all(run.resample(500, np.random.default_rng(91))[:, 0] > 0.5)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_likelihood_that_is_no_number_is_named(value):
    sampler = NestedSampling(Awkward(value), live_points=100)
    with pytest.raises(InputError, match=f"log_likelihood is {value} at theta") as caught:
        sampler.run(np.zeros(1), np.random.default_rng(92))
    assert "\n" not in str(caught.value)


def test_the_host_s_state_survives_even_a_failure(caplog):
    logger = logging.getLogger("ultranest")
    caplog.set_level(logging.ERROR, logger="ultranest")
    handlers, disabled = list(logger.handlers), logger.disabled
    np.random.seed(3)  # noqa: NPY002
    expected = np.random.random(4)  # noqa: NPY002
    np.random.seed(3)  # noqa: NPY002
    with pytest.raises(InputError):
        NestedSampling(Awkward(np.nan)).run(np.zeros(1), np.random.default_rng(93))
    np.testing.assert_array_equal(np.random.random(4), expected)  # noqa: NPY002
    assert (logger.handlers, logger.level, logger.disabled) == (handlers, logging.ERROR, disabled)


def test_no_files_are_written(simulator, x, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    NestedSampling(build_simulator("linear_gaussian", parameters=1, data=2), live_points=50).run(
        np.zeros(2), np.random.default_rng(94)
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: NestedSampling(object()), "object has no log_likelihood"),
        (lambda: NestedSampling(Awkward(0.0), live_points=3), "live_points >= 40"),
        (lambda: NestedSampling(Awkward(0.0), dlogz=0.0), "dlogz > 0"),
    ],
)
def test_misuse_is_one_clear_line(make, words):
    with pytest.raises(InputError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "heard"), [("Sampling from region seems inefficient (0/9)", False), ("x", True)]
)
def test_advice_on_efficiency_stays_inside_and_other_warnings_do_not(simulator, x, text, heard):
    class Warns:
        prior = simulator.prior

        def log_likelihood(self, theta, data):
            warnings.warn(text, UserWarning, stacklevel=1)
            return simulator.log_likelihood(theta, data)

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        NestedSampling(Warns(), live_points=60, dlogz=3.0, min_effective_draws=20).run(
            x[0], np.random.default_rng(85)
        )
    assert any(str(warning.message) == text for warning in caught) is heard
