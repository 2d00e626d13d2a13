"""Where data disagree: departures, ranges and p-values of real views, number by number."""

import numpy as np
import pytest

from gaugeblock.validate.observation import Sets
from gaugeblock.validate.observation.coordinates import Coordinates
from gaugeblock.validate.observation.views import Views
from gaugeblock.validate.observation.where import located


def data(n, rng):
    return 5.0 + rng.standard_normal((n, 1)) + rng.standard_normal((n, 20))


@pytest.fixture(scope="module")
def views():
    rng = np.random.default_rng(1)
    return Views.learned(Sets(data(800, rng)), Coordinates.of((20,)), rng, select=["largest"])


def found_at(views, observed):
    """Of observed data sets as one group, among 199 groups of as many simulated ones."""
    m = len(observed)
    rows = views(Sets(np.concatenate([observed, data(199 * m, np.random.default_rng(2))])))
    groups = np.arange(200 * m).reshape(200, m)
    return located(views, observed, rows, groups), rows.left["data"].reshape(200, m, 20)


@pytest.mark.parametrize("m", [1, 4])
def test_departures_are_of_a_group_s_mean_in_its_own_errors(views, m):
    observed = data(m, np.random.default_rng(3))
    observed[:, 7] += 9.0
    found, left = found_at(views, observed)
    mean = left.mean(axis=1) * np.sqrt(m)
    np.testing.assert_allclose(found.departures["data"], mean[0], rtol=1e-9)
    worst = np.abs(mean).max(axis=1)
    assert found.limit == pytest.approx(np.quantile(worst[1:], 0.95))
    np.testing.assert_allclose(found.observed, observed.mean(axis=0))
    first = found.places[0]
    assert (first.coordinate, first.members, first.family) == (7, (7,), "data")
    assert first.name == views.tables.coordinates.name(7)
    assert first.observed == pytest.approx(observed[:, 7].mean())
    assert first.p_value == pytest.approx((1 + np.sum(worst[1:] >= abs(first.departure))) / 200) == 1 / 200
    assert first.expected == tuple(found.expected[[1, 0, 2], 7])
    assert first.expected[0] < first.expected[1] < first.expected[2] < first.observed
    assert found.members == [7]
    assert len(found.places) == 12
    assert not set.intersection(*(set(place.members) for place in found.places))
    for place in found.places:
        assert place.p_value == pytest.approx((1 + np.sum(worst[1:] >= abs(place.departure))) / 200)
        assert place.astray == (place.p_value <= 0.05)


def test_what_is_expected_stands_on_what_is_not_astray(views):
    """Of one data set, by the regression on the others with the astray one where these put it."""
    observed = data(1, np.random.default_rng(3))
    observed[:, 7] += 9.0
    found, _ = found_at(views, observed)
    family = views.families["data"]
    scores = family.values(observed)[0]
    filled = family.expectation.filled(scores, [7])
    ranges = family.expectation.expected(filled, found.limit)
    for row, at in zip(found.expected, ranges, strict=True):
        np.testing.assert_allclose(row, family.values.inverse(at[None])[0])
    # Four numbers of 20 that share a level: their neighbours say where the eighth should be, to one sd.
    others = np.delete(observed[0], 7).mean()
    assert found.expected[0, 7] == pytest.approx(others, abs=1.0)
    calm, left = found_at(views, data(1, np.random.default_rng(9)))
    assert calm.members == []
    assert calm.places[0].departure in [
        value for _, value in family.expectation.set_apart(
            family.values(data(1, np.random.default_rng(9)))[0], (20,), 12
        )
    ]  # fmt: skip
    assert abs(calm.places[0].departure) == pytest.approx(np.abs(left[0, 0]).max())


def test_several_are_ranged_by_their_mean(views):
    """Four data sets: ranges to a half of the limit each, averaged; the farthest coordinates in order."""
    observed = data(4, np.random.default_rng(4))
    found, left = found_at(views, observed)
    family = views.families["data"]
    scores = family.values(observed)
    ranges = np.mean([family.expectation.expected(z, found.limit / 2) for z in scores], axis=0)
    for row, at in zip(found.expected, ranges, strict=True):
        np.testing.assert_allclose(row, family.values.inverse(at[None])[0])
    order = np.argsort(-np.abs(left[0].mean(axis=0)))[:12]
    assert [place.coordinate for place in found.places] == order.tolist()
    assert [place.departure for place in found.places] == pytest.approx(
        (2 * left[0].mean(axis=0)[order]).tolist()
    )
