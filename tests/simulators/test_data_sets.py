"""One data set, several, or neither."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.simulators.data_sets import as_data_sets

ROWS = np.arange(12.0).reshape(2, 2, 3)


def test_one_or_several():
    np.testing.assert_array_equal(as_data_sets(ROWS, (2, 3), what="x"), ROWS)
    np.testing.assert_array_equal(as_data_sets(ROWS[1], (2, 3), what="x"), ROWS[1:])
    # As many data sets as one has rows: what could be both is one.
    assert as_data_sets(ROWS[0], (2, 3), what="x").shape == (1, 2, 3)
    assert as_data_sets(np.zeros(3, dtype=int), (), what="x").shape == (3,)
    assert as_data_sets(np.zeros(()), (), what="x").shape == (1,)
    missing = np.where(ROWS > 3.0, np.nan, ROWS)
    np.testing.assert_array_equal(as_data_sets(missing, (2, 3), what="x", finite=False), missing)


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (
            ROWS,
            r"^x: has shape \(2, 2, 3\); it must have .* data, \(2, 2\), or be several of them, \(n, 2, 2\)$",
        ),
        (ROWS[:0, :, :2], r"^x: has shape \(0, 2, 2\); it must"),
        (np.where(ROWS[0, :, :2] > 2, np.nan, 1.0), "^x: 2 of 4 numbers are NaN or infinite; leave them out"),
        (np.array([[[1.0, np.inf], [1.0, 1.0]]]), "^x: 1 of 4 numbers"),
    ],
)
def test_what_is_neither_is_refused(data, says):
    with pytest.raises(InputError, match=says):
        as_data_sets(data, (2, 2), what="x")
