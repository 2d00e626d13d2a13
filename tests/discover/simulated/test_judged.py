"""What one half of a catalogue says of what the other fitted: moments, decoys, errors of gains."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gaugeblock.discovery.simulated.before import prepare
from gaugeblock.discovery.simulated.extend import LogRatio, extended_by, refit
from gaugeblock.discovery.simulated.judged import gap, learned_scores, moments
from gaugeblock.discovery.simulated.learning import Base, Lesson
from gaugeblock.discovery.simulated.moment_fit import SimulatedFit
from gaugeblock.discovery.simulated.observed import Budget, Observed
from gaugeblock.discovery.simulated.score_tests import find


@pytest.fixture(scope="module")
def tilted(ruler, readings):
    """Sixty rulers, a tilt fitted to them."""
    before = prepare(
        ruler, readings(60, 3, tilt={"slope": 0.25}), own=None, only=("tilt",), budget=Budget(1000, 2),
        summaries=None, step=lambda _: None,
    )  # fmt: skip
    found = find(before.scores, before.fit, before.observed, replicates=9, rng=np.random.default_rng(1))
    seen = found.look(before.candidates.entries, 60)
    one = extended_by(before.candidates["tilt"], ("tilt",), seen, before.fit, before.observed)
    return before, one, found


def judged(tilted, observed, **options):
    before, one, found = tilted
    options = {"folds": 2, "decoys": 4, "rng": np.random.default_rng(3), **options}
    return learned_scores(before.fit, {"tilt": one, "other": one}, found.span, observed, **options)


def test_moments_are_whitened_off_what_was_fitted():
    """The sum of their squares is Mahalanobis' distance, whatever the axes; one direction was fitted."""
    rng = np.random.default_rng(2)
    rows = rng.normal(size=(500, 4)) @ rng.normal(size=(4, 4))
    base, slope = Base.of(rows, np.ones(4)), rng.normal(size=4)
    halves = np.stack([slope, slope])[None]
    lesson = Lesson(np.zeros(1), base.learn(halves[0])[None], halves)
    fitted = SimulatedFit(None, np.zeros(1), np.eye(1), base, lesson, True)
    features = SimpleNamespace(moments=lambda: np.eye(4))
    observed = Observed(None, features, rng.normal(size=(50, 4)) + 0.3, Budget(500, 1))
    found = moments(fitted, observed)
    own = lesson.weights[0]
    off = np.eye(4) - np.outer(slope, own) / (slope @ own)
    left = off @ (observed.mean - base.mean)
    inverse = np.linalg.pinv(off @ np.cov(rows.T, bias=True) @ off.T, rcond=1e-9)
    distance = left @ inverse @ left / (1 / 50 + 1 / 500)
    assert np.count_nonzero(found) == 3
    assert (found**2).sum() == pytest.approx(distance, rel=1e-6)
    assert gap(fitted, observed) == pytest.approx(distance / 4, rel=1e-6)


def test_of_halves_that_are_alike_decoys_gain_what_geometry_says(tilted):
    """Every data set is the mean one: what a direction of unit length takes from one half it takes from the
    other, and the shrunk moments leave one over what was there."""
    before, _, found = tilted
    alike = replace(before.observed, rows=np.tile(before.observed.mean, (60, 1)))
    scored = judged(tilted, alike)
    assert scored.names == ("before", "tilt", "other", "unnamed", *(f"random {k}" for k in (1, 2, 3, 4)))
    assert scored.kinds == ("before", "named", "rival", "unnamed", *["random"] * 4)
    half = alike.part(np.arange(60) < 30)
    there = moments(refit(before.fit, half, span=found.span), half)
    size, square = 16, float((there**2).mean())
    assert len(there) == size
    assert square > 1.5
    np.testing.assert_allclose(scored.deviance[0], square)
    np.testing.assert_allclose(scored.deviance[3], 1 / square)
    assert scored.gain("unnamed") == pytest.approx(2 * 0.5 * size * (square - 1 / square))
    for row in range(4, 8):
        left = scored.deviance[row]
        assert left[0] == pytest.approx(left[1])
        assert 0 < left[0] < square
        assert scored.gain(scored.names[row]) == pytest.approx(size * (square - left[0]))
        assert np.isnan(scored.error[row]).all()
        assert np.isnan(scored.error[:, row]).all()


def test_log_ratios_are_over_the_model_before_and_of_rivals_over_the_name(tilted):
    before, one, found = tilted
    observed = before.observed
    scored = judged(tilted, observed)
    fold = np.random.default_rng(3).permutation(np.arange(60) % 2)
    expected, gaps = [], []
    for k in (0, 1):
        fitting, judging = observed.part(fold != k), observed.part(fold == k)
        plain = refit(before.fit, fitting, span=found.span)
        named = refit(one.fit, fitting, span=found.span)
        expected.append(LogRatio.learned(found.span, named.base, plain.base)(judging.rows))
        gaps.append(gap(named, judging))
    won = np.concatenate(expected)
    assert won.sum() > 3
    # The other is the same model: it is no better than the name, and as much better than the model before.
    np.testing.assert_allclose(scored.log_score[:3], [np.zeros(60), won, won], atol=1e-9)
    np.testing.assert_allclose(scored.deviance[1:3], [gaps, gaps])
    error = won.std() * np.sqrt(60)
    np.testing.assert_allclose(
        scored.error[:3, :3], [[0, error, error], [error, 0, 0], [error, 0, 0]], atol=1e-9
    )
