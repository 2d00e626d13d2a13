"""Fits of a generalized Pareto tail, by loops over the grid of Zhang and Stephens."""

import numpy as np
import pytest

from gaugeblock.validate.joint import psis
from gaugeblock.validate.joint.psis import pareto_khat, pareto_shape, tail_length


def shape_of(values):
    x = sorted(values)
    n, quartile = len(x), x[int(len(x) / 4 + 0.5) - 1]
    number = 30 + int(np.sqrt(n))
    places, logs = [], []
    for j in range(1, number + 1):
        theta = 1 / x[-1] + (1 - np.sqrt(number / (j - 0.5))) / (3 * quartile)
        k = np.mean([np.log1p(-theta * value) for value in x])
        places.append(theta)
        logs.append(n * (np.log(-theta / k) - k - 1))
    weight = np.exp(np.array(logs) - max(logs))
    theta = np.average(places, weights=weight)
    k = np.mean([np.log1p(-theta * value) for value in x])
    return (n * k + 10 * 0.5) / (n + 10)


@pytest.mark.parametrize("n", [5, 17, 64])
def test_shapes_by_a_loop(n):
    rows = np.random.default_rng(n).pareto(1.5, size=(4, n)) + 0.01
    np.testing.assert_allclose(pareto_shape(rows), [shape_of(row) for row in rows], rtol=1e-8)


@pytest.mark.parametrize("draws", [25, 100, 225, 226, 400])
def test_khat_is_of_the_largest_weights_above_the_next(draws, monkeypatch):
    monkeypatch.setattr(psis, "CHUNK", 2)
    size = draws // 5 if draws <= 225 else int(3 * np.sqrt(draws))
    assert tail_length(draws) == size
    log_weight = 2 * np.random.default_rng(draws).normal(size=(5, draws)) + 100
    log_weight[1] = np.round(log_weight[1], 1)
    found = pareto_khat(log_weight)
    for k, row in zip(found, log_weight, strict=True):
        ordered = np.exp(np.sort(row) - row.max())
        tail = np.maximum(ordered[-size:] - ordered[-size - 1], np.finfo(float).tiny ** 0.5)
        assert k == pytest.approx(shape_of(tail), rel=1e-6)


def test_tails_that_are_none():
    rows = np.full((5, 25), -np.inf)
    rows[0, :5] = np.arange(5.0)  # all of the tail, above nothing
    rows[1, :4] = np.arange(4.0)
    rows[2] = 3.0
    rows[3] = np.r_[np.nan, np.arange(24.0)]
    rows[4] = np.r_[np.inf, np.arange(24.0)]
    found = pareto_khat(rows)
    assert np.isinf(found[[1, 3, 4]]).all()
    assert found[0] == pytest.approx(shape_of(np.exp(np.arange(5.0) - 4)))
    assert found[2] == 0
    assert np.isinf(pareto_khat(np.zeros((1, 24)))).all()
    assert pareto_khat(np.zeros((0, 30))).shape == (0,)
