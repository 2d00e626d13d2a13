"""Arrays of other kinds are made into NumPy's, or refused."""

import numpy as np
import pytest

from gaugeblock.core.arrays import numbers, plain
from gaugeblock.core.errors import InputError


class Tensor:
    """What of a tensor counts: it is part of a graph, and elsewhere."""

    def detach(self):
        return self

    def cpu(self):
        return np.array([1.5, 2.5], dtype=np.float32)


@pytest.mark.parametrize(
    ("value", "kind", "wanted"),
    [
        ([[True, False]], np.int8, [[1, 0]]),
        (np.array([3, 4], dtype=np.int16), np.int16, [3, 4]),
        (Tensor(), np.float32, [1.5, 2.5]),
        ([1, 2.5], np.float64, [1.0, 2.5]),
    ],
)
def test_numbers_keep_their_type_and_plain_ones_are_of_double_precision(value, kind, wanted):
    made = numbers(value, what="theta")
    assert made.dtype == kind
    assert made.tolist() == wanted
    assert plain(value, what="theta").dtype == np.float64
    assert plain(value, what="theta").tolist() == wanted


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (["a"], "theta holds <U1 values"),
        ([1j], "theta holds complex128"),
        ([None], "theta holds object"),
        ([[1.0], [1.0, 2.0]], r"theta: cannot be made an array of numbers \(rows have different lengths\)$"),
        ({"a": [1.0], "b": [2.0]}, r"theta: is a dictionary \(a, b\); give one array$"),
        (np.ma.masked_equal([1.0, 2.0, 1.0], 1.0), "theta has 2 masked values; fill them, or leave out what"),
    ],
)
def test_what_is_no_array_of_real_numbers_is_refused(value, said):
    with pytest.raises(InputError, match=said):
        numbers(value, what="theta")
