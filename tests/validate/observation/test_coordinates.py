"""What a coordinate sums, and what a person calls it."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.validate.observation.coordinates import Coordinates


@pytest.mark.parametrize(
    ("shape", "options", "chosen", "name"),
    [
        ((1,), {"labels": ["mean"]}, [0], "mean"),
        ((1,), {"labels": [3.5]}, [0], "channel 3.5"),
        ((3,), {"labels": ["mean", "sd", "skew"]}, [0, 2], "mean to skew"),
        ((3,), {"labels": [1, 20, 300], "axes": ["day"]}, [2, 1], "day 20 to 300"),
        ((2, 3), {"labels": ["a", "b", "c"]}, [5], "row 1, c"),
        ((2, 3), {"labels": ["a", "b", "c"]}, [1, 4], "row 0 to 1, b"),
        ((3, 4), {}, [5], "row 1, column 1"),
        ((2, 2, 2, 2), {}, [0], "axis 1 0, axis 2 0, axis 3 0, axis 4 0"),
        ((10,), {"most": 5, "axes": ["time"]}, [1, 2], "time 2 to 5"),
        ((4,), {"most": 2, "labels": [0.25, 0.5, 1.0, 12345.678]}, [1], "channel 1 to 1.235e+04"),
        ((), {}, [0], "the number"),
    ],
)
def test_a_coordinate_has_a_name(shape, options, chosen, name):
    assert Coordinates.of(shape, **options).name(*chosen) == name


def test_sums_are_those_of_the_members():
    coordinates = Coordinates.of((3, 50), most=40)
    x = np.random.default_rng(1).poisson(5.0, size=(2, 3, 50))
    summed = coordinates(x)
    assert summed.shape == (2, len(coordinates))
    assert len(coordinates) == np.prod(coordinates.grid) == 3 * 13
    for row in range(2):
        expected = [x[row][coordinates.members(k)].sum() for k in range(len(coordinates))]
        assert summed[row].tolist() == expected


def test_axes_and_labels_that_do_not_fit():
    with pytest.raises(InputError, match="axes: 1 names for data with 2 axes; give one for each"):
        Coordinates.of((2, 3), axes=["row"])
    for shape in ((2, 3), ()):
        with pytest.raises(InputError, match="coordinates: 2 labels for data of shape"):
            Coordinates.of(shape, labels=["a", "b"])
