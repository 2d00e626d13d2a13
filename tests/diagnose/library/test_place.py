"""Draws that are wrong in a part of the data: where it begins, and that nothing beyond it is touched."""

import numpy as np
import pytest

from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.library.place import region


def counted(shift, *, trials=4000, draws=64):
    """Exact draws whose data are a count of 0 to 9; moved by a function of the count."""
    rng = np.random.default_rng(4)
    count = rng.integers(0, 10, trials).astype(float)
    centre = rng.normal(size=(trials, 1))
    theta = centre + rng.normal(size=(trials, 1))
    drawn = centre[:, None] + rng.normal(size=(trials, draws, 1))
    drawn += shift(count)[:, None, None]
    return Cases(("a",), np.arange(trials), theta, drawn, np.stack([centre[:, 0], count], axis=1), ("c", "n"))


@pytest.mark.parametrize(("above", "said"), [(True, "where n > 6 ("), (False, "where n <= 2 (")])
def test_a_repair_of_a_part_of_the_data_ends_where_it_says(above, said):
    cases = counted(lambda count: 1.5 * ((count > 6) if above else (count <= 2)))
    moved = next(repair for repair in region(cases) if repair.variant == "shift")
    assert moved.words.startswith(said)
    mended = moved.apply(cases).draws
    count = cases.x[:, 1]
    wrong = (count > 6) if above else (count <= 2)
    assert f"({wrong.mean():.0%} of the trials)" in moved.words
    np.testing.assert_array_equal(mended[~wrong], cases.draws[~wrong])
    assert np.median(cases.draws[wrong] - mended[wrong]) == pytest.approx(1.5, abs=0.1)


def test_what_is_right_everywhere_has_no_such_part():
    for repair in region(counted(np.zeros_like)):
        assert all(abs(number - repair.neutral) < 0.2 for number in repair.numbers.values())
