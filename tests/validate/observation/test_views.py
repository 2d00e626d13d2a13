"""Views of a family, how much each counts, and where distances are taken."""

import numpy as np
import pytest

from gaugeblock.validate.observation import Sets
from gaugeblock.validate.observation.coordinates import Coordinates
from gaugeblock.validate.observation.ranking import p_values_against
from gaugeblock.validate.observation.views import Views


def data(n, rng):
    """Two numbers that vary much, seen in sixty noisy readings."""
    return np.repeat(3.0 * rng.standard_normal((n, 2)), 30, axis=1) + rng.standard_normal((n, 60))


@pytest.fixture(scope="module")
def views():
    rng = np.random.default_rng(1)
    own = {"first": lambda x: x[:, 0], "last": lambda x: x[:, -1]}
    return Views.learned(
        Sets(data(1500, rng)), Coordinates.of((60,)), rng, summaries=lambda x: x[:, [0, 59]], own=own
    )


def test_families_count_alike_and_functions_of_ones_own_as_one(views):
    weights = dict(zip(views.names, views.weights, strict=True))
    assert sum(weights.values()) == pytest.approx(3.0)
    assert weights["summaries: distance"] == pytest.approx(2 * weights["summaries: neighbours"])
    assert weights["largest"] == pytest.approx(3 * weights["runs"])
    assert weights["first"] == weights["last"] == pytest.approx(0.5)
    assert sum(v for k, v in weights.items() if ":" not in k) == pytest.approx(2.0)


def test_a_data_set_scores_the_same_whatever_stands_beside_it(views):
    some = data(40, np.random.default_rng(5))
    together = views(Sets(some)).scores
    alone = np.concatenate([views(Sets(one[None])).scores for one in some])
    assert together.shape == alone.shape
    np.testing.assert_allclose(together, alone, rtol=1e-8)


def test_distances_are_taken_where_data_sets_vary_more_than_noise_does(views):
    """A shift of both numbers by two sd: a test of two normal numbers sees 72%, one of six 51%."""
    rng = np.random.default_rng(2)
    reference, planted = views(Sets(data(999, rng))).scores, views(Sets(data(400, rng) + 6.0)).scores
    for way in ("neighbours", "kernel"):
        at = [views.names.index(way)]
        assert np.mean(p_values_against(reference[:, at], planted[:, at]) <= 0.05) > 0.6


def test_scores_are_those_of_their_definitions(views):
    """By brute force from what is left, where distances are taken, and what the views were learned on."""
    learned_on, own = Sets(data(1500, np.random.default_rng(1))), data(25, np.random.default_rng(6)) * 1.5
    before, rows = views(learned_on), views(Sets(own))
    score = dict(zip(views.names, rows.scores.T, strict=True))
    np.testing.assert_allclose(score["largest"], np.abs(rows.left["data"]).max(axis=1))
    for name, column in (("first", 0), ("last", -1)):
        middle = np.median(learned_on.x[:, column])
        np.testing.assert_allclose(score[name], np.abs(own[:, column] - middle))
    # The signed numbers end in level, remainder, whole, largest, least and eight parts.
    for name, column in (("size", -13), ("remainder", -12)):
        middle = np.median(before.signed[:, column])
        np.testing.assert_allclose(score[name], np.abs(rows.signed[:, column] - middle))
    whole = np.exp(rows.signed[:, -11])
    assert np.argsort(whole).tolist() == np.argsort(score["distance"]).tolist()
    square = np.square(rows.space[:, None] - before.space).sum(axis=2)
    near = np.sort(np.sqrt(square), axis=1)[:, :5]
    np.testing.assert_allclose(score["neighbours"], np.log(near).mean(axis=1))
    some = before.space[:400]
    apart = np.square(some[:, None] - some).sum(axis=2)[np.triu_indices(400, 1)]
    alike = np.exp(-square / np.median(apart)).mean(axis=1)
    np.testing.assert_allclose(score["kernel"], -np.log(alike))
