"""Terms of one, three, seven and more parameters, and what they are worth."""

import itertools

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.learned.informed.terms import (
    Share,
    described,
    parameters_of,
    regressed_terms,
    values_of,
    with_triples,
)

LEVELS = (0.05, 0.25, 0.75, 0.95)


def test_which_terms_are_foretold():
    one = regressed_terms(1)
    assert one.every == ((0,), (0, 0), *(Share(0, level) for level in LEVELS))
    assert (one.regressed, one.treed) == (6, 2)
    six = regressed_terms(6)
    assert six.every[:13] == (*((j,) for j in range(6)), *((j, j) for j in range(6)), ())
    assert six.every[13:28] == tuple(itertools.combinations(range(6), 2))
    assert six.every[28:] == tuple(Share(j, level) for j in range(6) for level in LEVELS)
    assert (six.regressed, six.treed) == (52, 13)
    seven = regressed_terms(7)
    assert seven.every == (*((j,) for j in range(7)), *((j, j) for j in range(7)), ())
    assert (seven.regressed, seven.treed) == (15, 15)


def test_values_are_products_and_squares_less_one():
    scores = np.array([[2.0, 3.0, 0.5], [1.0, -1.0, 4.0]], dtype=np.float32)
    terms = [(0,), (2, 2), (), (0, 1), (0, 1, 2), (2,)]
    found = values_of(terms, scores)
    assert found.dtype == np.float32
    root = np.sqrt(3)
    np.testing.assert_allclose(
        found,
        [[2, -0.75, (3 + 8 - 0.75) / root, 6, 3, 0.5], [1, 15, (0 + 0 + 15) / root, -1, -4, 4]],
        rtol=1e-6,
    )


@pytest.mark.parametrize("level", [0.05, 0.25, 0.75, 0.95])
def test_a_share_is_what_place_and_width_leave_of_an_indicator(level):
    """By least squares over the quantiles of a normal distribution."""
    z = stats.norm.ppf((np.arange(200_000) + 0.5) / 200_000)
    known = np.column_stack([np.ones_like(z), z, z**2])
    below = (z < stats.norm.ppf(level)).astype(float)
    left = below - known @ np.linalg.lstsq(known, below, rcond=None)[0]
    scores = np.stack([z, z[::-1]], axis=1).astype(np.float32)
    found = values_of([(1,), Share(0, level), Share(1, level)], scores)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found[:, 1], left / left.std(), atol=2e-3)
    np.testing.assert_array_equal(found[:, 2], found[::-1, 1])


def test_which_parameters_a_term_is_about():
    assert [parameters_of(term) for term in ((), (2, 2), Share(1, 0.25))] == [(), (2, 2), (1,)]


@pytest.mark.parametrize("p", [2, 3, 6, 7, 9])
def test_triples_in_which_truths_differ_most(p):
    """Of three parameters and more."""
    rng = np.random.default_rng(p)
    scores = rng.normal(size=(40, 5, p))
    plain = regressed_terms(p)
    found = with_triples(plain, scores)
    assert (found.regressed, found.treed) == (plain.regressed, plain.treed)
    assert found.every[: len(plain.every)] == plain.every
    triples = {t: abs(np.mean(scores[:, 0, t].prod(axis=1))) for t in itertools.combinations(range(p), 3)}
    wanted = sorted(sorted(triples, key=triples.get)[-5:])
    assert list(found.every[len(plain.every) :]) == wanted


def test_triples_of_very_many_parameters_are_not_gone_through():
    rng = np.random.default_rng(1)
    for p, further in ((40, 5), (41, 0)):
        plain = regressed_terms(p)
        found = with_triples(plain, rng.normal(size=(6, 3, p)))
        assert len(found.every) - len(plain.every) == further


def test_terms_in_words():
    assert described((), "abc") == "how wide all parameters are"
    assert described((1,), "abc") == "where b lies"
    assert described((1, 1), "abc") == "how wide b is"
    assert described((0, 2), "abc") == "a and c together"
    assert described(Share(2, 0.25), "abc") == "the shape of c"
    assert described((0, 1, 2), "abc") == "a, b and c together"
