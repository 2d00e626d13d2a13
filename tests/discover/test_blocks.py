"""Blocks of a catalogue: their sizes, and what is made once for those that share a response."""

import numpy as np
import pytest

from gaugeblock.discovery import Sources
from gaugeblock.discovery.blocks import blocks_of, by_response, here


@pytest.mark.parametrize(
    ("number", "sizes"), [(1, [1]), (127, [127]), (128, [128]), (129, [65, 64]), (300, [100, 100, 100])]
)
def test_blocks_are_of_one_size_or_one_more_in_the_order_of_sources(power_law, number, sizes):
    few = Sources.of(power_law(), np.ones((2, 60)), names=("x", "y"))
    many = Sources.of(power_law(), np.ones((number, 60)))
    blocks = blocks_of([few, many])
    assert [len(one) for one in blocks] == [2, *sizes]
    assert [name for one in blocks for name in one.names] == ["x", "y", *map(str, range(number))]


def test_what_is_made_of_a_simulator_is_made_once_for_its_blocks(power_law):
    one, other = (Sources.of(power_law(), np.ones((2, 60))) for _ in range(2))
    asked = []

    def make(simulator):
        asked.append(simulator)
        return object()

    made = by_response([one, other, one.select([0])], make)
    assert [id(simulator) for simulator in asked] == [id(one.simulator), id(other.simulator)]
    assert made[0] is made[2] is not made[1]


def test_answers_come_in_order_as_arrays_in_rows():
    def ask(values, factor):
        return {"twice": factor * values.T, "sum": values.sum()}

    rows = [np.arange(6.0).reshape(2, 3), np.ones((3, 2))]
    first, second = here(ask, rows, [2.0, 3.0])
    np.testing.assert_array_equal(first["twice"], 2.0 * rows[0].T)
    np.testing.assert_array_equal(second["twice"], np.full((2, 3), 3.0))
    assert first["twice"].flags.c_contiguous
    assert (first["sum"], second["sum"]) == (15.0, 6.0)
    with pytest.raises(ValueError, match="shorter"):
        list(here(ask, rows, [2.0]))
