"""Truths and draws of one variable put beside each other: shapes that belong together, and names."""

import numpy as np
import pytest

from gaugeblock.auditing.trials_from.arrays import columns
from gaugeblock.core.errors import InputError


@pytest.mark.parametrize(
    ("draws", "truth", "names"),
    [
        ((4, 7), (4,), ["theta"]),
        ((4, 7, 1), (4,), ["theta"]),
        ((4, 7), (4, 1), ["theta"]),
        ((4, 7, 2), (4, 2), ["theta[0]", "theta[1]"]),
        ((4, 7, 2, 1), (4, 2), ["theta[0,0]", "theta[1,0]"]),
        ((4, 7, 2, 2), (4, 2, 2), ["theta[0,0]", "theta[0,1]", "theta[1,0]", "theta[1,1]"]),
    ],
)
def test_shapes_that_belong_together(draws, truth, names):
    drawn, true = np.arange(np.prod(draws)).reshape(draws), np.arange(np.prod(truth)).reshape(truth)
    found_true, found_drawn, found = columns("theta", drawn, true, source="here")
    assert found == names
    assert found_true.shape == (4, len(names))
    assert found_drawn.shape == (4, 7, len(names))
    np.testing.assert_array_equal(found_true.ravel(), true.ravel())
    np.testing.assert_array_equal(found_drawn.ravel(), drawn.ravel())


@pytest.mark.parametrize(
    ("draws", "truth"),
    [
        ((4, 7, 2), (4,)),
        ((4, 7), (4, 2)),
        ((4, 7, 2), (4, 3)),
        ((4, 7, 2), (4, 2, 2)),
        ((7, 4, 2), (4, 2)),
        ((4,), (4,)),
        ((4, 7), ()),
    ],
)
def test_shapes_that_do_not_belong_together_are_named(draws, truth):
    with pytest.raises(InputError, match=r"here, variable theta: draws have the shape \(") as said:
        columns("theta", np.zeros(draws), np.zeros(truth), source="here")
    assert f"truths {truth}" in str(said.value)


def test_labels_stand_in_place_of_indices():
    found = columns("theta", np.zeros((4, 7, 2)), np.zeros((4, 2)), source="here", labels=["low", "high"])
    assert found[2] == ["theta[low]", "theta[high]"]
