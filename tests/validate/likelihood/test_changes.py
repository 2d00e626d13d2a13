"""Which changes of parameters are tried, and which cannot be undone."""

import itertools

import numpy as np

from gaugeblock.validate.likelihood.changes import factor_words, of_data, of_parameters, scaled

THETA = np.random.default_rng(1).normal(size=(40, 2))


def test_what_cannot_be_undone_is_tried_one_way_and_of_one_parameter():
    tried = list(of_parameters(["a", "b"], THETA))
    one_way = {change.words for change in tried if change.one_way}
    assert one_way == {
        "in place of a stands its absolute value",
        "in place of b stands its absolute value",
        "the parameters are divided by their sum",
    }
    every = [change for change in tried if change.words.startswith("in place of every parameter stands")]
    alone = [change for change in tried if change.words.startswith("in place of a stands")]
    # Each function of one is one of all, but for the absolute value.
    assert len(alone) == len(every) + 1 > 10
    assert not any("absolute" in change.words for change in every)


def test_a_function_of_one_parameter_leaves_the_other_alone():
    (inverse,) = (
        c for c in of_parameters(["a", "b"], THETA) if c.words == "in place of b stands its inverse"
    )
    np.testing.assert_array_equal(inverse.theta(THETA), np.column_stack([THETA[:, 0], 1 / THETA[:, 1]]))


def test_of_one_parameter_nothing_is_said_of_all():
    words = [change.words for change in of_parameters(["a"], THETA[:, :1])]
    assert len(words) == len(set(words)) > 10
    assert not any("every parameter" in said or "the parameters" in said for said in words)


def orders(size):
    """The order in which parameters are taken by each change that only reorders them."""
    theta = np.arange(float(size))[None]
    tried = [
        c for c in of_parameters([f"p{i}" for i in range(size)], theta) if c.name == "swapped parameters"
    ]
    return [tuple(change.theta(theta)[0].astype(int)) for change in tried], [change.words for change in tried]


def test_few_parameters_are_taken_in_every_other_order_and_many_pair_by_pair():
    for size in (2, 3, 4):
        found, _ = orders(size)
        assert sorted(found) == sorted(set(itertools.permutations(range(size))) - {tuple(range(size))})
    found, _ = orders(5)
    pairs = [order for order in found if sum(i != j for i, j in enumerate(order)) == 2]
    assert len(set(pairs)) == 10
    assert set(found) - set(pairs) == {(4, 3, 2, 1, 0), (1, 2, 3, 4, 0), (4, 0, 1, 2, 3)}


def test_two_that_are_exchanged_come_first_and_are_named():
    found, words = orders(3)
    assert [sum(i != j for i, j in enumerate(order)) for order in found] == [2, 2, 2, 3, 3]
    named = dict(zip(found, words, strict=True))
    assert named[2, 1, 0] == "p0 and p2 are swapped"
    assert named[1, 2, 0] == "the parameters are taken in the order p1, p2, p0"


def test_steps_of_a_discrete_parameter():
    theta = np.array([2.0, 3.0, 5.0, 9.0] * 10)[:, None]
    tried = [change.theta(theta[:4])[:, 0].tolist() for change in of_parameters(["k"], theta)][-5:]
    assert tried == [
        [3.0, 4.0, 6.0, 10.0],
        [3.0, 5.0, 9.0, 2.0],
        [1.0, 2.0, 4.0, 8.0],
        [9.0, 2.0, 3.0, 5.0],
        [9.0, 5.0, 3.0, 2.0],
    ]
    # Forty values that are all different are no steps.
    assert not any("counted" in c.words for c in of_parameters(["a"], THETA[:, :1]))


def changed(words, x, *, floating=True):
    """What the data become under the first change that says so: shifts of either sign say the same."""
    one = next(change for change in of_data(x.shape[1:], floating=floating) if change.words == words)
    return one.x(x).tolist()


def test_data_are_shifted_both_ways_and_filled_as_said():
    x = np.arange(1.0, 6.0)[None]
    shifts = [change for change in of_data((5,), floating=True) if change.name == "shifted bins"]
    assert [change.one_way for change in shifts] == [False, True, True] * 4
    assert [change.x(x)[0].tolist() for change in shifts] == [
        *([5, 1, 2, 3, 4], [0, 1, 2, 3, 4], [1, 1, 2, 3, 4]),
        *([2, 3, 4, 5, 1], [2, 3, 4, 5, 0], [2, 3, 4, 5, 5]),
        *([4, 5, 1, 2, 3], [0, 0, 1, 2, 3], [1, 1, 1, 2, 3]),
        *([3, 4, 5, 1, 2], [3, 4, 5, 0, 0], [3, 4, 5, 5, 5]),
    ]
    assert "by 1 bin" in shifts[0].words
    assert "by 2 bins" in shifts[-1].words


def test_data_of_two_axes_are_moved_along_either():
    x = np.arange(1.0, 5.0).reshape(1, 2, 2)
    assert changed("the data are shifted by 1 bin along axis 0", x) == [[[3, 4], [1, 2]]]
    assert changed("the data are shifted by 1 bin along axis 1 (zero comes in at the end)", x) == [
        [[0, 1], [0, 3]]
    ]
    assert changed("the data are read backwards along axis 1", x) == [[[2, 1], [4, 3]]]
    assert changed("rows and columns of the data are exchanged", x) == [[[1, 3], [2, 4]]]
    words = [change.words for change in of_data((2, 3, 2, 2), floating=True)]
    assert {f"the data are read backwards along axis {axis}" for axis in (0, 1, 2)} == {
        said for said in words if "backwards" in said
    }
    assert not any("exchanged" in said for said in words)
    # An axis of one bin has no neighbours.
    assert not any("axis 1" in change.words for change in of_data((3, 1), floating=True))


def test_data_are_moved_cut_and_rounded():
    x = np.array([[-1.0, 0.0, 1.5]])
    assert changed("every datum is one more", x) == [[0, 1, 2.5]]
    assert changed("every datum is one less", x) == [[-2, -1, 0.5]]
    assert changed("zeros are replaced by ones", x) == [[1, 1, 1.5]]
    assert changed("negative data are set to zero", x) == [[0, 0, 1.5]]
    assert changed("the data are cut to whole numbers", x) == [[-1, 0, 1]]
    assert changed("the data are rounded to whole numbers", x) == [[-1, 0, 2]]
    assert changed("in place of the data stands their square", x) == [[1, 0, 2.25]]
    assert not any("whole numbers" in change.words for change in of_data((3,), floating=False))
    lossy = {change.words for change in of_data((3,), floating=True) if change.one_way}
    assert {"zeros are replaced by ones", "in place of the data stands their absolute value"} <= lossy
    assert "every datum is one more" not in lossy


def test_some_parameters_are_scaled_or_moved():
    theta = np.array([[1.0, 2.0, 3.0]])
    assert scaled([0, 2], 2.5)(theta).tolist() == [[2.5, 2.0, 7.5]]
    assert scaled([1], -4.0, offset=True)(theta).tolist() == [[1.0, -2.0, 3.0]]
    assert theta.tolist() == [[1.0, 2.0, 3.0]]


def test_a_known_factor_is_known_either_way_up():
    assert factor_words(1000.0) == "1000 (thousand (milli, kilo))"
    assert factor_words(1e-3) == "0.001 (1 / thousand (milli, kilo))"
    assert factor_words(1.001e-3) == "0.001001"
