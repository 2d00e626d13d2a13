"""Terms of two, three, seven and more parameters, and what they are worth."""

import itertools

import numpy as np
import pytest

from gaugeblock.validate.learned.informed.terms import described, regressed_terms, values_of, with_triples


def test_which_terms_are_foretold():
    one = regressed_terms(1)
    assert (one.every, one.regressed, one.treed) == (((0,), (0, 0)), 2, 2)
    six = regressed_terms(6)
    assert six.every[:13] == (*((j,) for j in range(6)), *((j, j) for j in range(6)), ())
    assert six.every[13:] == tuple(itertools.combinations(range(6), 2))
    assert (six.regressed, six.treed) == (28, 13)
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
    assert described((0, 1, 2), "abc") == "a, b and c together"
