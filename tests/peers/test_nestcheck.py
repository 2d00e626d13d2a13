"""nestcheck, the reference implementation of the thread bootstrap, on the same run and the same resamples."""

from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.validate.evidence.bootstrap import log_evidence_of_threads, thread_bootstrap
from gaugeblock.validate.evidence.perfect_runs import perfect_run

REPLICATES = 200


@pytest.fixture(scope="module")
def run():
    """A Gaussian likelihood in four dimensions, by a perfect sampler with 100 live points."""
    return perfect_run(
        lambda log_volume: -50 * np.exp(log_volume / 2), live_points=100, depth=14,
        rng=np.random.default_rng(0),
    )  # fmt: skip


@pytest.fixture(scope="module")
def theirs(run, peer):
    """The run as nestcheck holds it."""
    last = np.array([run.log_likelihood[run.thread == k].max() for k in range(len(run.start))])
    samples = np.column_stack([run.log_likelihood, run.thread, np.zeros(len(run.thread)), run.log_likelihood])
    samples[np.isin(run.log_likelihood, last), 2] = -1
    return peer("nestcheck.ns_run_utils").dict_given_run_array(samples, np.column_stack([run.start, last]))


@pytest.fixture(scope="module")
def their_bootstrap(theirs, peer):
    """Log evidences of resamples; seed k of NumPy's global generator for the k-th."""
    values = peer("nestcheck.error_analysis").run_bootstrap_values(
        theirs, [peer("nestcheck.estimators").logz], n_simulate=REPLICATES, flip_skew=False
    )
    return values[0]


def test_log_evidences_agree_exactly(run, theirs, peer):
    ours = log_evidence_of_threads(run, np.ones((1, len(run.thread))))[0]
    assert ours == pytest.approx(peer("nestcheck.estimators").logz(theirs), abs=1e-9)


def test_log_evidences_of_the_same_resamples_agree(run, their_bootstrap):
    """Nearly: a point that is there k times, theirs dies k times in a row, ours with k times the volume."""
    n = len(run.start)
    counts = np.array(
        [np.bincount(np.random.RandomState(k).randint(0, n, n), minlength=n) for k in range(REPLICATES)]
    )
    ours = log_evidence_of_threads(run, counts[:, run.thread])
    np.testing.assert_allclose(ours, their_bootstrap, atol=1e-2)
    assert ours.std(ddof=1) == pytest.approx(their_bootstrap.std(ddof=1), rel=0.01)


def test_errors_agree(run, their_bootstrap):
    """Two errors from 200 and 1,000 resamples differ by 5.5% in sd: 20% fails, once in 3,000 seeds."""
    ours = thread_bootstrap(run, rng=np.random.default_rng(1), replicates=1000)
    assert ours.error == pytest.approx(their_bootstrap.std(ddof=1), rel=0.2)
