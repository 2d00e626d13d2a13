"""The thread bootstrap against repeated runs of a perfect sampler, exact evidences and published errors."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from scipy import special

from gaugeblock.core.errors import InputError
from gaugeblock.validate.evidence.bootstrap import (
    LogEvidence,
    evidence_difference,
    evidence_sum,
    log_evidence_of_threads,
    thread_bootstrap,
)
from gaugeblock.validate.evidence.nested_threads import split_threads
from gaugeblock.validate.evidence.perfect_runs import perfect_run

# Higson's Gaussian: likelihood of sd 1, prior of sd 10, ten dimensions.
EXACT = -5 * np.log(2 * np.pi * 101)
# Mean log likelihood over the posterior, less the log evidence.
INFORMATION = -5 * np.log(2 * np.pi) - 5 * 100 / 101 - EXACT


def higson(log_volume):
    return -5 * np.log(2 * np.pi) - 100 * special.gammaincinv(5, np.exp(log_volume))


@pytest.fixture(scope="module")
def repeated():
    """Log evidences of 1,000 runs with 50 live points, and the errors of every tenth."""
    rng = np.random.default_rng(0)
    values, errors = [], []
    for number in range(1000):
        run = perfect_run(higson, live_points=50, depth=33, rng=rng)
        values.append(log_evidence_of_threads(run, np.ones(len(run.thread)))[0])
        if number % 10 == 0:
            errors.append(thread_bootstrap(run, rng=rng, replicates=100).error)
    return np.array(values), np.array(errors)


def test_errors_are_the_spread_of_repeated_runs(repeated):
    """Mean error over the sd of 1,000 runs, known to 2.2%: three times that fails, 3 seeds in 1,000."""
    values, errors = repeated
    np.testing.assert_allclose(errors.mean(axis=0) / values.std(ddof=1), 1, atol=3 * 0.023 + 0.01)


def test_errors_are_those_of_theory(repeated):
    """sqrt(H / live points) within 4%: 100 errors have a mean known to 0.8%, a bootstrap is 1% low."""
    np.testing.assert_allclose(repeated[1].mean(axis=0), np.sqrt(INFORMATION / 50), rtol=0.04)


def test_values_are_unbiased(repeated):
    """Within 3 standard errors of the mean of 1,000 runs: 3 seeds in 1,000."""
    values, _ = repeated
    assert abs(values.mean() - EXACT) < 3 * values.std() / np.sqrt(1000)


def test_error_is_the_published_one():
    """100 live points: the sd of 100 runs is 0.402 +- 0.029 (demo of perfectns, Higson 2018); 2.5 of them."""
    rng = np.random.default_rng(1)
    errors = [
        thread_bootstrap(
            perfect_run(higson, live_points=100, depth=33, rng=rng), rng=rng, replicates=200
        ).error
        for _ in range(10)
    ]
    assert np.mean(errors) == pytest.approx(0.402, abs=2.5 * 0.029)


def test_live_points_that_grow_inside_make_the_error_smaller():
    """20 threads from the prior, 80 from log volume -15 on, as in a dynamic run: within 12% of theory.

    Var(log Z) is the integral over log volume of the share of the posterior still inside, squared, over the
    live points there.
    """
    rng = np.random.default_rng(2)
    contour = float(higson(np.array(-15.0)))
    found = []
    for _ in range(20):
        outer = perfect_run(higson, live_points=20, depth=33, rng=rng)
        inner = perfect_run(lambda log_volume: higson(log_volume - 15), live_points=80, depth=18, rng=rng)
        birth = np.where(np.isneginf(inner.birth_log_likelihood), contour, inner.birth_log_likelihood)
        run = split_threads(
            np.concatenate([outer.log_likelihood, inner.log_likelihood]),
            np.concatenate([outer.birth_log_likelihood, birth]),
        )
        assert np.count_nonzero(np.isfinite(run.start)) == 80
        found.append(thread_bootstrap(run, rng=rng, replicates=200).error)
    log_volume = np.linspace(-40, 0, 40_001)
    mass = np.exp(higson(log_volume) + log_volume - EXACT)
    inside = np.cumsum(mass) * 1e-3
    live = np.where(log_volume > -15, 20, 100)
    assert np.mean(found) == pytest.approx(np.sqrt(np.sum(inside**2 / live) * 1e-3), rel=0.12)


def test_a_plateau_adds_the_error_of_its_size():
    """Half the prior has likelihood 0: Var(log Z) = 1 / points + H / live points, within 10%; no bias.

    80 runs: their mean within 3.5 of its standard errors fails 1 seed in 2,000.
    """
    rng = np.random.default_rng(9)
    found = []
    for _ in range(80):
        outside = rng.binomial(200, 0.5)
        inner = perfect_run(higson, live_points=200 - outside, depth=33, rng=rng)
        run = split_threads(
            np.concatenate([np.full(outside, -1e100), inner.log_likelihood]),
            np.concatenate([np.full(outside, -np.inf), inner.birth_log_likelihood]),
        )
        evidence = thread_bootstrap(run, rng=rng, replicates=100)
        found.append((evidence.value, evidence.error))
    values, errors = np.array(found).T
    expected = np.sqrt(1 / 200 + INFORMATION / 100)
    assert errors.mean() == pytest.approx(expected, rel=0.1)
    assert abs(values.mean() - EXACT - np.log(0.5)) < 3.5 * expected / np.sqrt(80)


def test_one_evidence_by_hand():
    """Two points from the prior: volumes e^-1/2 and e^-3/2; trapezoids between, rectangles at the ends."""
    threads = split_threads([0.0, 1.0], [-np.inf, -np.inf])
    outer, inner = np.exp(-0.5), np.exp(-1.5)
    exact = (1 - outer) * 1 + (outer - inner) * (1 + np.e) / 2 + inner * np.e
    assert log_evidence_of_threads(threads, np.ones(2))[0] == pytest.approx(np.log(exact), rel=1e-12)


def test_points_that_count_nothing_might_as_well_not_be_there():
    rng = np.random.default_rng(3)
    run = perfect_run(higson, live_points=10, depth=33, rng=rng)
    counts = np.array([0, 1, 2, 0, 0, 1, 3, 1, 0, 2])[run.thread]
    here = counts > 0
    alone = split_threads(run.log_likelihood[here], run.birth_log_likelihood[here])
    np.testing.assert_allclose(
        log_evidence_of_threads(run, counts), log_evidence_of_threads(alone, counts[here]), rtol=1e-12
    )


def test_enormous_likelihoods_do_no_harm():
    rng = np.random.default_rng(4)
    run = perfect_run(higson, live_points=30, depth=33, rng=rng)
    for shift in (-1e6, 1e6):
        moved = split_threads(run.log_likelihood + shift, run.birth_log_likelihood + shift)
        one, two = (thread_bootstrap(r, rng=np.random.default_rng(5), replicates=50) for r in (run, moved))
        np.testing.assert_allclose(two.replicates - shift, one.replicates, atol=1e-6)


def test_the_size_of_chunks_changes_no_bit(monkeypatch):
    run = perfect_run(higson, live_points=30, depth=33, rng=np.random.default_rng(6))
    whole = thread_bootstrap(run, rng=np.random.default_rng(7), replicates=50)
    # The package's attribute of this name is the function.
    module = sys.modules["gaugeblock.validate.evidence.bootstrap"]
    monkeypatch.setattr(module, "VALUES", 7 * len(run.thread))
    pieces = thread_bootstrap(run, rng=np.random.default_rng(7), replicates=50)
    np.testing.assert_array_equal(whole.replicates, pieces.replicates)


def test_errors_of_sums_and_differences_add_in_quadrature():
    """Ten pairs, 1,000 replicates: within 10%, where the error of the sd is 2.2%."""
    rng = np.random.default_rng(8)
    runs = [
        thread_bootstrap(perfect_run(higson, live_points=30, depth=33, rng=rng), rng=rng) for _ in range(20)
    ]
    expected = np.sqrt(sum(run.error**2 for run in runs))
    difference = evidence_difference(runs[:10], runs[10:])
    assert difference.error == pytest.approx(expected, rel=0.1)
    assert abs(difference.value) < 4 * difference.error
    total = evidence_sum(runs)
    assert total.error == pytest.approx(expected, rel=0.1)
    assert total.value == pytest.approx(sum(run.value for run in runs))


def test_misuse_is_one_clear_line():
    run = split_threads([0.0, 1.0], [-np.inf, -np.inf])
    one = LogEvidence(value=0.0, error=1.0, replicates=np.zeros(3))
    other = LogEvidence(value=0.0, error=1.0, replicates=np.zeros(4))
    rng = np.random.default_rng(0)
    for call, words in (
        (lambda: thread_bootstrap(run, rng=rng, replicates=1), "at least 2 are needed"),
        (lambda: evidence_sum([]), "at least one"),
        (lambda: evidence_sum([one, other]), "same number of replicates"),
        (lambda: evidence_sum([one], coefficients=[1.0, 2.0]), "coefficients for 1"),
        (lambda: evidence_difference([one], []), "1 of the first, 0 of the second"),
    ):
        with pytest.raises(InputError, match=words) as caught:
            call()
        assert "\n" not in str(caught.value)


def test_evidences_by_a_loop_over_points_that_count():
    """Volumes shrink by 1 / live points; trapezoids between points that count, the rest is the last one's."""
    rng = np.random.default_rng(10)
    run = perfect_run(higson, live_points=6, depth=12, rng=rng)
    counts = rng.integers(0, 3, size=(4, len(run.start)))[:, run.thread]
    counts[0] = 1
    found = log_evidence_of_threads(run, counts)
    for row, value in zip(counts, found, strict=True):
        live = run.live_points(row)
        log_volume, before, total = 0.0, None, -np.inf
        for point in np.flatnonzero(row):
            now = log_volume - row[point] / live[point]
            here = run.log_likelihood[point]
            before = here if before is None else before
            shell = np.log(np.exp(log_volume) - np.exp(now))
            total = np.logaddexp(total, shell + np.logaddexp(here, before) - np.log(2))
            log_volume, before = now, here
        assert value == pytest.approx(np.logaddexp(total, log_volume + before), rel=1e-10)
    shrunk = log_evidence_of_threads(run, counts[:1], rng=np.random.default_rng(11))
    gamma = np.random.default_rng(11).standard_gamma(counts[:1].astype(float))[0] / run.live_points(counts[0])
    log_volume = np.concatenate([[0.0], -np.cumsum(gamma)])
    values = np.exp(run.log_likelihood - run.log_likelihood.max())
    pairs = (values + np.concatenate([values[:1], values[:-1]])) / 2
    exact = -np.diff(np.exp(log_volume)) @ pairs + np.exp(log_volume[-1]) * values[-1]
    assert shrunk[0] == pytest.approx(np.log(exact) + run.log_likelihood.max())


def test_threads_are_drawn_with_replacement_by_where_they_start():
    """Those from the prior among themselves, those from inside among themselves, one replicate at a time."""
    run = split_threads(np.arange(1.0, 9.0), [-np.inf, -np.inf, -np.inf, 1.0, 1.0, 2.0, 2.0, 5.0])
    inside = np.isfinite(run.start)
    assert 0 < inside.sum() < len(run.start)
    found = thread_bootstrap(run, rng=np.random.default_rng(12), replicates=20)
    lot, counts = np.random.default_rng(12), np.zeros((20, len(run.start)), dtype=int)
    for group in (np.flatnonzero(~inside), np.flatnonzero(inside)):
        for row in counts:
            for which in np.floor(lot.random(len(group)) * len(group)).astype(int):
                row[group[which]] += 1
    np.testing.assert_allclose(found.replicates, log_evidence_of_threads(run, counts[:, run.thread]))
    assert found.error == pytest.approx(found.replicates.std(ddof=1))
    assert found.value == pytest.approx(log_evidence_of_threads(run, np.ones(8))[0])
    assert len(thread_bootstrap(run, rng=lot).replicates) == 1000


def test_sums_and_differences_by_hand():
    one, two = (LogEvidence(value=v, error=0.0, replicates=np.array(r)) for v, r in (
        (1.0, [1.0, 2.0, 4.0]), (5.0, [4.0, 6.0, 5.0])))  # fmt: skip
    total = evidence_sum([one, two], coefficients=[2.0, -0.5])
    assert (total.value, total.replicates.tolist()) == (-0.5, [0.0, 1.0, 5.5])
    assert total.error == pytest.approx(np.std([0.0, 1.0, 5.5], ddof=1))
    apart = evidence_difference([one, two], [two, two])
    assert (apart.value, apart.replicates.tolist()) == (-4.0, [-3.0, -4.0, -1.0])
