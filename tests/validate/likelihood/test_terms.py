"""What a constant between two likelihoods usually is."""

from math import lgamma, log, pi

import numpy as np
import pytest

from gaugeblock.validate.likelihood.terms import constant_words, factor_name

THETA = np.ones((3, 1))
# Rows of one total, and of one vector.
TOTAL, SAME = np.array([[3, 2], [1, 4], [5, 0]]), np.array([[2, 3]] * 3)
REAL = np.array([[0.5, 0.1], [0.2, -0.3], [1.0, 2.0]])


class Even:
    """A uniform prior of width 8.5."""

    def log_prob(self, theta):
        return np.full(len(theta), -log(8.5))


@pytest.mark.parametrize(
    ("value", "x", "prior", "name", "words"),
    [
        (lgamma(6), TOTAL, None, "factorial", "log N! of the total N = 5"),
        (-lgamma(6), TOTAL, None, "factorial", "minus log N! of the total N = 5"),
        (lgamma(3) + lgamma(4), SAME, None, "factorial", "sum log x!"),
        (-lgamma(3) - lgamma(4), SAME, None, "factorial", "minus sum log x!"),
        (-log(8.5), REAL, Even(), "prior", "the log density of the (uniform) prior"),
        (log(8.5), REAL, Even(), "prior", "minus the log density of the (uniform) prior"),
        (-log(2 * pi), REAL, None, "2 pi", "-2 times log(2 pi) / 2, one for each datum"),
        (1.5 * log(2 * pi), REAL, None, "2 pi", "3 times log(2 pi) / 2"),
        (log(3.3), REAL, None, "log width", "1 times log width"),
        (-4 * log(2), REAL, None, "log 2", "-4 times log 2"),
        (log(pi) / 2, REAL, None, "pi", "1 times log(pi) / 2"),
        (-lgamma(8), REAL, None, "factorial", "minus log 7!"),
        (log(19), REAL, None, "constant", "log 19"),
        (0.123, REAL, None, "constant", "a constant of the normalisation"),
    ],
)  # fmt: skip
def test_a_constant_is_named(value, x, prior, name, words):
    assert constant_words(value, x, THETA, prior, {"width": 3.3, "one": 1.0, "none": 0.0}) == (name, words)


@pytest.mark.parametrize(
    ("factor", "shape", "terms_too", "name", "words"),
    [
        (0.5, (2,), False, "mean for sum", "a mean over 2 stands for a sum (factor 0.5)"),
        (2.0, (2,), False, "mean for sum", "a mean over 2 stands for a sum in the other (factor 2)"),
        (1 / 6, (2, 3), False, "mean for sum", "a mean over 6 stands for a sum (factor 0.16666667)"),
        (3.0, (2, 3), False, "mean for sum", "a mean over 3 stands for a sum in the other (factor 3)"),
        (-2.0, (2,), False, "deviance", "it is a deviance, -2 log L (factor -2)"),
        (-0.5, (2,), False, "deviance", "the other is a deviance, -2 log L (factor -0.5)"),
        (1 / log(10), (2,), False, "log10", "it is a logarithm to base 10 (factor 0.43429448)"),
        (log(2), (2,), False, "log2", "the other is a logarithm to base 2 (factor 0.69314718)"),
        (0.5, (5,), True, "temperature", "all but what is named beside it is taken 0.5 times"),
        (0.7, (1,), False, "temperature", "a power (temperature) of 0.7"),
    ],
)
def test_a_factor_is_named(factor, shape, terms_too, name, words):
    found = factor_name(factor, shape, terms_too)
    assert found[0] == name
    assert found[1].startswith(words)
