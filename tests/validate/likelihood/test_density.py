"""How a likelihood code is called: whole batches or row by row, and what is refused or warns."""

import warnings

import numpy as np
import pytest

from gaugeblock.validate.likelihood.density import Rows, as_density, excess

THETA, X = np.array([[1.0], [2.0], [-3.0]]), np.array([[0.5, 1.0], [2.0, 0.0], [1.0, 1.0]])


def summed(theta, x):
    return theta[..., 0] * x.sum(-1)


@pytest.mark.parametrize("wrapped", [False, True])
def test_by_rows_or_at_once(wrapped):
    asked = []

    def density(theta, x):
        asked.append(np.shape(theta))
        return summed(theta, x)

    assert Rows(density, wrapped)(THETA, X).tolist() == [1.5, 4.0, -6.0]
    assert asked == ([(1,)] * 3 if wrapped else [(3, 1)])


@pytest.mark.parametrize("wrapped", [False, True])
def test_a_code_that_warns_has_values_all_the_same_and_nobody_is_warned(wrapped):
    """Arguments that are tried may be anywhere: what a code says of them is no news to its user."""

    def density(theta, x):
        if np.any(theta < 0):
            warnings.warn("out of range", UserWarning, stacklevel=1)
        return summed(theta, x) + 0 * np.sqrt(theta[..., 0])

    for how in ("error", "always"):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter(how)
            found = Rows(density, wrapped).attempt(THETA, X)
        np.testing.assert_array_equal(found, [1.5, 4.0, np.nan])
        assert told == []


def test_what_refuses_or_answers_in_another_shape_has_no_values():
    def refuses(theta, x):
        raise ZeroDivisionError

    assert Rows(refuses, wrapped=False).attempt(THETA, X) is None
    assert Rows(lambda theta, x: theta * x, wrapped=False).attempt(THETA, X) is None
    assert Rows(lambda theta, x: 2.0, wrapped=False).attempt(THETA, X) is None
    found = Rows(lambda theta, x: np.float32(summed(theta, x)), wrapped=False).attempt(THETA, X)
    assert found.dtype == np.float64


def test_a_callable_or_what_has_a_likelihood():
    assert as_density(summed) is summed

    class Model:
        log_likelihood = staticmethod(summed)

    assert as_density(Model()) is summed


def test_differences_in_units_of_what_is_tolerated():
    inf, nan = np.inf, np.nan
    first, second = np.array([1.0, inf, -inf, inf, nan, 1.0]), np.array([1.3, inf, -inf, -inf, nan, nan])
    np.testing.assert_allclose(excess(first, second, 0.1), [3.0, 0.0, 0.0, inf, inf, inf])
