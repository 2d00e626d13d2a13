"""Truths and draws of one variable put beside each other: shapes that belong together, and names."""

import numpy as np
import pytest
from tests.refusals import said

from gaugeblock.auditing.trials_from.arrays import assembled, chosen_names, columns, data_of, named_arrays
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


def test_what_was_probably_meant():
    def advice(draws, truth):
        return said(columns, "a", np.zeros(draws), np.zeros(truth), source="here").partition("(trial, ...)")[
            2
        ]

    assert advice((7, 4), (4,)) == "; the draws look like (draw, trial, ...): exchange their first two axes"
    assert advice((5, 7), (4,)) == "; there are draws of 5 trials and truths of 4"
    assert advice((4, 4, 2), (4, 3)) == advice((4, 7, 2), (4, 3)) == ""
    assert advice((4,), (4,)) == advice((4, 7), ()) == ""


def test_mappings_and_lists_of_them_and_nothing_else():
    """Of the names that are asked for, so that others may hold what is no array."""
    one, other = {"a": [1.0, 2.0], "b": "words"}, {"b": 0, "a": [3.0, 4.0], "c": 1}
    for named, wanted in (([one, other], [[1.0, 2.0], [3.0, 4.0]]), (one, [1.0, 2.0])):
        found = named_arrays(named, what="w", expected="e", names=["a", "z"])
        assert {name: array.tolist() for name, array in found.items()} == {"a": wanted}
    assert list(named_arrays([{"a": 1, "b": 2}], what="w", expected="e")) == ["a", "b"]
    for wrong, kind in (([], "list"), ([one, 3], "list"), (3, "int"), ("ab", "str")):
        assert said(named_arrays, wrong, what="w", expected="e") == f"w: got {kind}; expected e"
    assert said(named_arrays, [{"a": 1}, {"b": 1}], what="w", expected="e") == (
        "w, variable a: trial 1 has none, unlike trial 0"
    )
    assert said(named_arrays, [{"a": [1]}, {"a": [1, 2]}], what="w", expected="e") == (
        "w, variable a: trial 1 has shape (2,), trial 0 (1,); every trial needs the same number of chains "
        "and draws"
    )


def test_names_that_are_asked_for():
    assert chosen_names({"a": 1, "b": 2}, None, source="here") == ["a", "b"]
    assert chosen_names({"a": 1, "b": 2}, ["b"], source="here") == ["b"]
    assert (
        said(chosen_names, {"a": 1}, ["c", "a", "d"], source="here") == "here: no draws of c, d; there are a"
    )
    assert said(chosen_names, {}, None, source="here") == "here: no variable has draws; there are none"


def test_variables_put_side_by_side():
    draws = {"a": np.arange(6.0).reshape(2, 3), "b": np.arange(12.0).reshape(2, 3, 2) + 10}
    truths = {"b": np.arange(4.0).reshape(2, 2), "a": np.arange(2.0) + 5}
    made = assembled(
        draws, truths, names=["b", "a"], source="here", labels={"b": ["x", "y"]}, x=np.zeros((2, 1))
    )
    assert made["parameter"].values.tolist() == ["b[x]", "b[y]", "a"]
    assert made["theta_true"].values.tolist() == [[0.0, 1.0, 5.0], [2.0, 3.0, 6.0]]
    assert made["draws"].values[1].tolist() == [[16, 17, 3], [18, 19, 4], [20, 21, 5]]
    assert "autocorrelated" not in made.attrs
    assert assembled(draws, truths, names=["a"], source="h", autocorrelated=True).attrs["autocorrelated"] == 1
    assert said(assembled, draws, {"b": 1, "c": 2}, names=["a"], source="here") == (
        "here: no truths of a (there are b, c); give them, or choose with names=[...] what to audit"
    )
    fewer = {**draws, "b": draws["b"][:, :2]}
    assert said(assembled, fewer, truths, names=["a", "b"], source="here") == (
        "here, variable b: 2 trials of 2 draws; a has 2 of 3"
    )
    for x in (np.zeros((3, 1)), np.zeros(())):
        assert said(assembled, draws, truths, names=["a"], source="here", x=x) == (
            f"here: x has the shape {x.shape}; its first axis must be the 2 trials"
        )


def test_data_by_name_or_as_they_are():
    assert data_of(None, {"y": 1}, source="here") is None
    assert data_of([[1], [2]], 3, source="here").values.tolist() == [[1], [2]]
    assert data_of("y", {"y": [1, 2]}, source="here").values.tolist() == [1, 2]
    assert said(data_of, "z", {"y": 1, "t": 2}, source="here") == (
        "here: no data 'z' among the simulations (there are y, t)"
    )
    assert (
        said(data_of, "z", [1], source="here") == "here: no data 'z' among the simulations (there are list)"
    )
