"""What a constant between two likelihoods usually is."""

from math import lgamma, log, pi

import numpy as np
import pytest

from gaugeblock.validate.likelihood.terms import constant_words

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
