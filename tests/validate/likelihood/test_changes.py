"""Which changes of parameters are tried, and which cannot be undone."""

import numpy as np

from gaugeblock.validate.likelihood.changes import of_parameters

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
