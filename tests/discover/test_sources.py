"""Sources: what is put where, chosen from them, and refused."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.discovery import Sources

COUNTS = np.arange(180.0).reshape(3, 60)


def test_what_is_left_out_is_one_exposure_no_redshift_and_a_number(power_law):
    simulator = power_law()
    plain, alone = Sources.of(simulator, COUNTS), Sources.of(simulator, np.arange(60))
    assert plain.simulator is alone.simulator is simulator
    assert (plain.scale.tolist(), plain.redshift.tolist(), plain.names) == (
        [1, 1, 1],
        [0, 0, 0],
        ("0", "1", "2"),
    )
    assert (len(plain), len(alone), alone.counts.shape, alone.counts.dtype) == (3, 1, (1, 60), float)
    same = Sources.of(simulator, COUNTS, scale=2.5, redshift=0.3, names=["a", "b", "c"])
    assert (same.scale.tolist(), same.redshift.tolist(), same.names) == (
        [2.5] * 3,
        [0.3] * 3,
        ("a", "b", "c"),
    )
    np.testing.assert_array_equal(plain.edges, simulator.segments()[0].edges)


def test_each_source_expects_as_much_as_its_exposure(power_law):
    theta = np.array([[100.0, 1.0], [200.0, 2.0], [300.0, 0.5]])
    sources = Sources.of(power_law(), COUNTS, scale=[0.5, 2.0, 3.0])
    for row, one, scale in zip(sources.expected(theta), theta, (0.5, 2.0, 3.0), strict=True):
        np.testing.assert_allclose(row, scale * power_law().expected(one))

    class Flat:
        def expected(self, theta):
            return np.full((len(theta), 60), 7.0)

    np.testing.assert_allclose(sources.expected(theta, simulator=Flat())[:, 0], [3.5, 14.0, 21.0])


def test_some_of_them_keep_what_is_theirs(power_law):
    sources = Sources.of(
        power_law(), COUNTS, scale=[0.5, 2.0, 3.0], redshift=[0.1, 0.2, 0.3], names=("a", "b", "c")
    )
    for rows, order in (([2, 0], [2, 0]), (np.array([True, False, True]), [0, 2]), (slice(1, None), [1, 2])):
        some = sources.select(rows)
        assert some.names == tuple("abc"[k] for k in order)
        np.testing.assert_array_equal(some.counts, COUNTS[order])
        np.testing.assert_array_equal(some.scale, np.array([0.5, 2.0, 3.0])[order])
        np.testing.assert_array_equal(some.redshift, np.array([0.1, 0.2, 0.3])[order])
        assert some.simulator is sources.simulator


def test_a_refusal_says_which_source_and_channel(power_law):
    simulator, two = power_law(), np.ones(2)

    def refused(message, counts, *, simulator=simulator, scale=two, redshift=two, names=("a", "b")):
        with pytest.raises(InputError, match=message):
            Sources(simulator, counts, scale, redshift, names)

    whole = np.ones((2, 60))
    half = whole.copy()
    half[1, 7:9] = 0.5
    refused(
        r"^source b: channel 7 holds 0\.5; discovery needs raw counts, whole numbers of at least 0$", half
    )
    refused("^source b: holds no counts; leave it out$", whole * [[1.0], [0.0]])
    shapes = r"^sources: counts must be \(source, channel\) with one scale, redshift and name a source, got "
    refused(shapes + r"\(60,\), 2, 2 and 2$", whole[0])
    refused(shapes + r"\(2, 60\), 3, 2 and 2$", whole, scale=np.ones(3))
    refused(shapes + r"\(2, 60\), 2, 1 and 2$", whole, redshift=np.ones(1))
    refused(shapes + r"\(2, 60\), 2, 2 and 3$", whole, names=("a", "b", "c"))

    class Blind:
        def with_effect(self, effect):
            return self

    class Fixed:
        def expected(self, theta):
            return theta

    refused(r"^discover: Blind has no expected\(\.\.\.\), which naming needs$", whole, simulator=Blind())
    refused(r"^discover: Fixed has no with_effect\(\.\.\.\), which naming needs$", whole, simulator=Fixed())
