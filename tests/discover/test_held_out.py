"""Held-out scores by hand: gains, errors, what is behind, what random shapes win."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.discovery.held_out import HeldOut, deviance


@pytest.fixture(name="scores")
def scores_fixture():
    names = ("before", "dip", "line", "random 1", "random 2")
    kinds = ("before", "named", "rival", "random", "random")
    log_score = np.array(
        [[1.0, 2.0, 0.0], [4.0, 3.0, 5.0], [6.0, 1.0, 2.0], [1.0, 2.0, 0.5], [3.0, 1.0, 1.0]]
    )
    error = np.arange(25.0).reshape(5, 5)
    return HeldOut(names, kinds, log_score, error, np.array([[2.0, 3.0, 7.0]] * 5))


def test_gains_are_over_all_pieces(scores):
    assert scores.gain("dip") == 9.0
    assert scores.gain("dip", over="line") == 3.0
    assert scores.noise == 2.0
    none = HeldOut(("before",), ("before",), np.zeros((1, 3)), np.zeros((1, 1)), np.zeros((1, 3)))
    assert none.noise == 0.0


def test_errors_are_of_the_pair(scores):
    assert scores.error_of("line") == 10.0
    assert scores.error_of("line", over="dip") == 11.0
    assert scores.behind("line", "dip") == pytest.approx(3.0 / 7.0)
    assert scores.behind("dip", "line") == 0.0
    assert replace(scores, error=np.zeros((5, 5))).behind("line", "dip") == 0.0


def test_a_gap_has_the_error_of_its_pieces(scores):
    mean, error = scores.gap("dip")
    assert mean == 4.0
    assert error == pytest.approx(np.sqrt((4 + 1 + 9) / 2 / 3))


def test_the_deviance_is_a_mean_over_channels():
    counts, mean = np.array([[3.0, 0.0], [1.0, 2.0]]), np.array([[2.0, 1.0], [1.0, 4.0]])
    first = (3 * np.log(1.5) - 1 + 1) / 2 * 2
    second = (2 * np.log(0.5) + 2) / 2 * 2
    np.testing.assert_allclose(deviance(counts, mean), [first, second])
