"""Rows of intervals: cut, summed, found."""

from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.core.precision import double_precision
from gaugeblock.simulators.xray import intervals

jax = pytest.importorskip("jax")


def test_intervals_are_cut_where_a_number_lies_inside_them():
    low, high = np.array([1.0, 2.0, 5.0]), np.array([2.0, 4.0, 6.0])
    start, stop, others = intervals.cut(low, high, np.array([0.5, 2.0, 2.5, 3.0, 4.5, 5.5, 6.0]))
    # The first piece of each, then the rest; 0.5 and 4.5 lie in none, 2 and 6 at an end.
    np.testing.assert_array_equal(start, [1.0, 2.0, 5.0, 2.5, 3.0, 5.5])
    np.testing.assert_array_equal(stop, [2.0, 2.5, 5.5, 3.0, 4.0, 6.0])
    np.testing.assert_array_equal(others, [1, 1, 2])
    whole = intervals.per_bin(jax.numpy.asarray(stop - start), others)
    np.testing.assert_allclose(whole, high - low, rtol=1e-6)


def test_intervals_come_in_any_order_and_their_pieces_in_theirs():
    """A sum over pieces is the sum over intervals, whatever is integrated over them."""
    rng = np.random.default_rng(0)
    edges = np.cumsum(rng.uniform(0.1, 1.0, 61))
    order = rng.permutation(30)
    low, high = edges[:-1:2][order], edges[1::2][order]
    at = np.sort(rng.uniform(edges[0] - 1, edges[-1] + 1, 200))
    start, stop, others = intervals.cut(low, high, at)
    np.testing.assert_array_equal(start[:30], low)
    assert (stop > start).all()
    assert not ((at[:, None] > start) & (at[:, None] < stop)).any()
    with double_precision():
        cubes = intervals.per_bin(jax.numpy.asarray(stop**3 - start**3), others)
    np.testing.assert_allclose(cubes, high**3 - low**3, rtol=1e-12)


def test_what_nothing_cuts_stays_whole():
    low, high = np.array([1.0, 2.0]), np.array([2.0, 4.0])
    start, stop, others = intervals.cut(low, high, np.empty(0))
    np.testing.assert_array_equal([start, stop], [low, high])
    assert not len(others)
    values = np.array([3.0, 4.0])
    assert intervals.per_bin(values, others) is values


@pytest.mark.parametrize("number", [1, 2, 3, 35, 36, 37, 560])
def test_running_sums_are_sums_of_the_first(number):
    values = np.random.default_rng(number).lognormal(0.0, 3.0, (2, number))
    with double_precision():
        found = jax.jit(jax.vmap(intervals.running_sums))(values)
    assert found.shape == (2, number + 1)
    np.testing.assert_array_equal(found[:, 0], 0.0)
    np.testing.assert_allclose(found[:, 1:], np.cumsum(values, axis=1), rtol=1e-13)


@pytest.mark.parametrize(
    "edges",
    [
        np.arange(11.0),
        0.1 + 0.7 * np.arange(101.0),
        np.geomspace(0.01, 20.0, 300),
        np.array([0.0, 1e-3, 1.0, 1.0005, 7.0]),
        np.array([2.0, 3.0]),
        # Too many cells for a table; of files there are channels of no width.
        np.array([0.0, 1e-6, 1.0, 3.0]),
        np.array([0.0, 0.0, 1.0, 2.0]),
    ],
)
def test_a_number_is_found_in_its_interval(edges):
    rng = np.random.default_rng(0)
    at = np.concatenate([edges, rng.uniform(edges[0], edges[-1], 5000)])
    for direction in (-np.inf, np.inf):
        at = np.concatenate([at, np.clip(np.nextafter(edges, direction), edges[0], edges[-1])])
    expected = np.minimum(np.searchsorted(edges, at, side="right") - 1, len(edges) - 2)
    with double_precision():
        found = jax.jit(intervals.places_among(edges))(at)
    np.testing.assert_array_equal(found, expected)


def test_a_table_of_places_is_not_made_where_widths_differ_too_much(monkeypatch):
    searched = []
    real = jax.numpy.searchsorted
    monkeypatch.setattr(jax.numpy, "searchsorted", lambda *a, **k: searched.append(1) or real(*a, **k))
    for edges, used in ((np.arange(9.0), 0), (np.array([0.0, 1e-6, 1.0, 3.0]), 1)):
        with double_precision():
            intervals.places_among(edges)(edges)
        assert len(searched) == used
