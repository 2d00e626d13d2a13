"""What data are turned into before an estimator is called again, and what comes of it."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from gaugeblock.core.streams import generator
from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.library.calls import (
    DRAWS,
    FACTORS,
    MORE,
    STEPS,
    Called,
    as_logs,
    as_roots,
    as_shares,
    calls,
    exchanged,
    in_reverse,
    knows_truth,
    standardised,
    transposed,
    ways_to_call,
)

IMAGES = np.arange(24.0).reshape(2, 3, 4)


def test_what_is_done_to_data():
    np.testing.assert_allclose(standardised(IMAGES, 2.0, 4.0), (IMAGES - 2) / 4)
    np.testing.assert_allclose(standardised(IMAGES, IMAGES[0], 2.0)[1], 6.0)
    np.testing.assert_allclose(as_logs(IMAGES), np.log(1 + IMAGES))
    np.testing.assert_allclose(as_roots(IMAGES) ** 2, IMAGES)
    np.testing.assert_array_equal(in_reverse(IMAGES, 1), IMAGES[:, ::-1])
    np.testing.assert_array_equal(in_reverse(IMAGES, -1), IMAGES[..., ::-1])
    np.testing.assert_array_equal(transposed(IMAGES), IMAGES.transpose(0, 2, 1))
    np.testing.assert_array_equal(exchanged(IMAGES[0], np.array([1, 0, 2, 3])), IMAGES[0][:, [1, 0, 2, 3]])
    np.testing.assert_allclose(as_shares(IMAGES).sum(axis=(1, 2)), 1.0)
    np.testing.assert_allclose(as_shares(IMAGES)[1] / as_shares(IMAGES)[1, 0, 0], IMAGES[1] / 12)
    assert (as_shares(np.zeros((2, 3))) == 0).all()


def ways(x):
    return [(symptom, words, turn(x), size) for symptom, words, turn, size in ways_to_call(x)]


def test_ways_to_call_with_numbers_of_either_sign():
    x = np.random.default_rng(1).normal(size=(50, 3)) * [1.0, 5.0, 0.0] + [0.0, 3.0, 7.0]
    x[0, 0] = -1.0
    found = ways(x)
    said = [words for _, words, _, _ in found]
    assert len(found) == 2 + len(FACTORS) + len(STEPS) + 1 + 3
    assert len(FACTORS) == 24
    each, whole = found[0][2], found[1][2]
    np.testing.assert_allclose(each.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(each.std(axis=0), [1.0, 1.0, 0.0], atol=1e-12)
    assert (whole.mean(), whole.std()) == (pytest.approx(0.0, abs=1e-12), pytest.approx(1.0))
    for symptom, words, turned, size in found[2:26]:
        np.testing.assert_allclose(turned, x * size["factor"])
        assert (symptom, words) == ("x_scale", f"times {size['factor']:.3g}")
    for (symptom, words, turned, size), step in zip(found[26:36], STEPS, strict=True):
        assert size == {"step": pytest.approx(step * x.std())}
        np.testing.assert_allclose(turned, x + size["step"])
        assert (symptom, words) == ("x_shift", f"plus {size['step']:.4g}")
    assert said[36:] == [
        "in reverse order",
        *(f"with x[{i}] and x[{j}] exchanged" for i, j in ((0, 1), (0, 2), (1, 2))),
    ]
    np.testing.assert_array_equal(found[36][2], x[:, ::-1])
    np.testing.assert_array_equal(found[38][2], x[:, [2, 1, 0]])
    assert [symptom for symptom, *_ in found[36:]] == ["x_order", "x_channel", "x_channel", "x_channel"]


def test_ways_to_call_with_counts_images_and_single_numbers():
    counts = np.random.default_rng(2).poisson(5.0, (20, 7)).astype(float)
    said = [words for _, words, _, _ in ways(counts)]
    assert said[2:5] == ["logarithms of one plus them", "their square roots", "divided by their sum"]
    assert not [words for words in said if "exchanged" in words]  # of seven channels
    images = [(symptom, words) for symptom, words, _, _ in ways(np.ones((20, 3, 4)))]
    assert images[-3:] == [
        ("x_order", "in reverse order"),
        ("x_order", "with the first two axes exchanged"),
        ("x_order", "with the last axis in reverse order"),
    ]
    assert not [words for _, words in images if words.startswith("with x[")]
    single = [symptom for symptom, *_ in ways(np.ones((20, 1)))]
    assert "x_order" not in single
    assert [symptom for symptom, *_ in ways(np.ones(20))].count("x_scale") == 2 + 3 + 24
    pair = [words for _, words, _, _ in ways(np.ones((20, 2)))]
    assert pair[-2:] == ["in reverse order", "with x[0] and x[1] exchanged"]
    assert "with x[4] and x[5] exchanged" in [words for _, words, _, _ in ways(np.ones((20, 6)))]
    # Data that are all alike are not divided by their spread.
    assert np.isfinite(ways(np.full((20, 2), 3.0))[0][2]).all()


def normal(x, n, rng):
    """Posteriors of a standard normal mean seen once with unit noise, parameter by parameter."""
    return np.asarray(x)[:, None] / 2 + np.sqrt(0.5) * rng.standard_normal((len(x), n, np.shape(x)[1]))


def planted(sample, trials=400, draws=60, seed=3):
    rng = np.random.default_rng(seed)
    theta = rng.normal(size=(trials, 2))
    x = theta + rng.normal(size=theta.shape)
    number = np.arange(trials) * 2 + 5
    order = rng.permutation(trials)
    cases = Cases(("a", "b"), number[order], theta[order], sample(x, draws, rng)[order])
    return cases, Called(sample, x, number, 11)


def test_draws_are_for_each_trials_own_data_and_finite():
    seen = []

    def sample(x, n, rng):
        seen.append((x, n, rng.random()))
        drawn = np.repeat(x[:, None] * 1.0, n, axis=1)
        drawn[0, 0] = np.inf
        drawn[1, 1] = np.nan
        return drawn

    cases, again = planted(sample)
    seen.clear()
    made = again.drawn(cases, lambda x: 10 * x, 4)
    data = 10 * again.data[(cases.trial - 5) // 2]
    (x, n, first) = seen[0]
    np.testing.assert_array_equal(x, data)
    assert x.flags["C_CONTIGUOUS"]
    assert n == 4
    assert first == generator(11, "diagnosis calls", 4, 400).random()
    expected = np.repeat(data[:, None], 4, axis=1)
    expected[0, 0] = expected[1, 1] = np.nan
    middle = np.nanmedian(expected, axis=(0, 1))
    np.testing.assert_allclose(made.draws, np.where(np.isnan(expected), middle, expected))
    np.testing.assert_array_equal(made.theta, cases.theta)


def test_a_parameter_of_which_nothing_is_finite_is_nought_and_nobody_is_warned():
    def sample(x, n, rng):
        return np.stack([normal(x, n, rng)[..., 0], np.full((len(x), n), np.nan)], axis=-1)

    cases, again = planted(sample)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = again.drawn(cases, lambda x: x, 8)
    assert np.isfinite(made.draws[..., 0]).all()
    assert (made.draws[..., 1] == 0).all()


def test_a_factor_is_found_between_those_that_are_tried():
    cases, again = planted(lambda x, n, rng: normal(np.asarray(x) / 20.0, n, rng))
    first, *others = calls(cases, again)
    assert first.symptom == "x_scale"
    assert first.numbers["factor"] == pytest.approx(20.0, rel=0.2)
    assert first.words == (
        f"draws are right if the estimator is called with the data times {first.numbers['factor']:.3g}"
    )
    assert (first.variant, first.neutral, len(others) <= 2) == (first.words, 1.0, True)
    x = np.ones((3, 2))
    np.testing.assert_allclose(first.turn(x), first.numbers["factor"])
    assert first.apply(cases).draws.shape == (400, MORE, 2)
    assert calls(*planted(normal)) == []


def test_ways_that_an_estimator_refuses_are_left_out():
    def strict(x, n, rng):
        if np.abs(x).max() > 1e5:
            raise ValueError("too large")
        return normal(np.asarray(x)[:, ::-1], n, rng)

    (repair, *_) = calls(*planted(strict))
    assert repair.words.endswith(("in reverse order", "with x[0] and x[1] exchanged"))
    assert repair.numbers == {}


def test_an_estimator_that_knew_the_truth_is_asked_again():
    cases, again = planted(normal)
    known = cases.drawn(cases.theta[:, None] + 0.1 * np.random.default_rng(5).normal(size=cases.draws.shape))
    (repair,) = knows_truth(known, again)
    assert repair.numbers["ratio"] == pytest.approx(np.sqrt(0.5) / 0.1, rel=0.1)
    assert repair.words == (
        "asked again for the same data, the estimator gives other draws, "
        f"{repair.numbers['ratio']:.3g} times as wide"
    )
    assert repair.apply(known).draws.shape == (400, MORE, 2)
    assert np.median(repair.apply(known).half_width) == pytest.approx(np.sqrt(0.5), rel=0.1)
    assert knows_truth(cases, again) == []
    few = cases.drawn(cases.draws[:, : DRAWS // 2])
    assert knows_truth(few, again) == []
