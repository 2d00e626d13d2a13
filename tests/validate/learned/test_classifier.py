from __future__ import annotations

import sys

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import MissingExtraError
from gaugeblock.validate.learned.classifier import fit_classifier
from gaugeblock.validate.learned.discriminant import fit_discriminant


def test_without_scikit_learn_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "sklearn.neural_network", None)
    monkeypatch.setitem(sys.modules, "sklearn", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'gaugeblock\[classifiers\]'"):
        fit_classifier(np.zeros((4, 1)), [0, 1, 0, 1], seed=0)


def area(score, ones, zeros):
    return stats.mannwhitneyu(score(ones), score(zeros)).statistic / (len(ones) * len(zeros))


def parity(rng, n):
    """Three normal coordinates whose signs multiply to +1: all pairs look independent."""
    z = np.abs(rng.normal(size=(n, 3)))
    sign = rng.choice([-1.0, 1.0], size=(n, 2))
    return z * np.column_stack([sign, sign.prod(axis=1)])


def test_it_sees_what_second_moments_do_not():
    pytest.importorskip("sklearn")
    rng = np.random.default_rng(0)
    ones, zeros = parity(rng, 2000), rng.normal(size=(2000, 3))
    learned = fit_classifier(np.concatenate([ones, zeros]), np.repeat([1, 0], 2000), seed=0)
    quadratic = fit_discriminant(ones, zeros)
    fresh = parity(rng, 2000), rng.normal(size=(2000, 3))
    assert area(learned, *fresh) > 0.65
    assert area(quadratic, *fresh) < 0.53


def test_shift_width_and_correlation_on_held_out_points():
    """Held-out AUC at least 0.9 of what the likelihood ratio has above 1/2."""
    pytest.importorskip("sklearn")
    rng = np.random.default_rng(1)
    faults = {
        "shift": (lambda z: z + np.array([0.4, 0]), lambda z: 0.4 * z[:, 0]),
        "width": (lambda z: 0.7 * z, lambda z: -(z**2).sum(axis=1)),
        "correlation": (lambda z: z @ np.array([[1, 0.6], [0, 0.8]]), lambda z: 0.6 * z[:, 0] * z[:, 1]
                        - 0.18 * (z**2).sum(axis=1)),
    }  # fmt: skip
    for change, ratio in faults.values():
        ones, zeros = change(rng.normal(size=(2000, 2))), rng.normal(size=(2000, 2))
        learned = fit_classifier(np.concatenate([ones, zeros]), np.repeat([1, 0], 2000), seed=0)
        fresh = change(rng.normal(size=(4000, 2))), rng.normal(size=(4000, 2))
        assert area(learned, *fresh) - 0.5 > 0.9 * (area(ratio, *fresh) - 0.5) - 0.005


def test_the_same_seed_is_the_same_classifier_and_global_state_stays():
    pytest.importorskip("sklearn")
    rng = np.random.default_rng(2)
    rows, labels = rng.normal(size=(200, 2)), np.arange(200) % 2
    before = np.random.get_state()[1].copy()  # noqa: NPY002 - looks at what must not change
    first, again, other = (fit_classifier(rows, labels, seed=seed)(rows) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    np.testing.assert_array_equal(before, np.random.get_state()[1])  # noqa: NPY002


def test_log_odds_are_for_equal_classes():
    """Nine times as many zeros as ones, equally distributed: log odds near 0, not -2.2."""
    pytest.importorskip("sklearn")
    rng = np.random.default_rng(5)
    rows = rng.normal(size=(2000, 2))
    score = fit_classifier(rows, np.arange(2000) % 10 == 0, seed=0)(rng.normal(size=(2000, 2)))
    assert abs(np.median(score)) < 0.6


def test_context_goes_with_its_rows():
    pytest.importorskip("sklearn")
    rng = np.random.default_rng(6)
    context = rng.normal(size=(2000, 1))
    labels = np.arange(2000) % 2 == 1
    rows = rng.normal(size=(2000, 1)) + 0.8 * np.sign(context) * labels[:, None]
    score = fit_classifier(rows, labels, context=context, seed=0)
    z = np.array([[[-2.0], [2.0]], [[-2.0], [2.0]]])
    found = score(z, np.array([[[1.0]], [[-1.0]]]))
    assert found.shape == (2, 2)
    assert found[0, 1] > found[0, 0]
    assert found[1, 0] > found[1, 1]
