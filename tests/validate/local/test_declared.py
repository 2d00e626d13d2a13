"""What regions may be defined by: named in the data's own terms, and never by which value is the truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import make_trials, trials_tree
from gaugeblock.validate.learned.discriminant import normal_scores
from gaugeblock.validate.learned.informed.data import data_of
from gaugeblock.validate.learned.informed.ridge import fit_ridge
from gaugeblock.validate.local.declared import declared_features
from gaugeblock.validate.prepared import Prepared

N = 900
TAUGHT = np.arange(300)


def made(channels=4, *, seed=0, data=True, own=True, **extra):
    rng = np.random.default_rng(seed)
    theta = rng.normal(size=(N, 2))
    x = np.concatenate([theta + 0.5 * rng.normal(size=(N, 2)), rng.normal(size=(N, channels - 2))], axis=1)
    draws = x[:, None, :2] + rng.normal(size=(N, 9, 2))
    trials = make_trials(theta, draws, ["a", "b"], **({"x": x} if data else {}), **extra)
    if own:
        trials["exposure"] = ("trial", rng.random(N))
    return trials


def declared(trials):
    return declared_features(Prepared(trials_tree(trials), 1), TAUGHT)


def test_names_are_the_data_s_own():
    found = declared(made())
    names = found.names
    assert names[:2] == ("the posterior of a", "the posterior of b")
    assert names[2] == "total"
    assert all(name.startswith("component") and "(most of it x[" in name for name in names[3:7])
    assert names[7:] == (
        "exposure", "x[0]", "x[1]", "x[2]", "x[3]",
        "a as a regression on x expects it", "b as a regression on x expects it",
    )  # fmt: skip
    assert found.values.shape == (N, len(names))
    assert found.left_out == ()


def test_a_component_is_named_by_the_channel_it_goes_with():
    rng = np.random.default_rng(2)
    x = rng.normal(size=(N, 3)) * [1.0, 1.0, 1.0]
    x[:, 1] = x[:, 2] + 0.1 * rng.normal(size=N)
    trials = make_trials(x[:, :1], x[:, None, :1] + rng.normal(size=(N, 9, 1)), ["a"], x=x)
    assert declared(trials).names[2] in ("component 1 (most of it x[1])", "component 1 (most of it x[2])")


def test_the_regression_says_where_the_parameter_is_in_its_own_unit():
    trials = made()
    found = declared(trials)
    expected = found.values[:, found.names.index("a as a regression on x expects it")]
    truth = trials["theta_true"].values[:, 0]
    assert np.corrcoef(expected, truth)[0, 1] > 0.85
    # As widely spread as truths are: what a quantile of the one is, is one of the other.
    assert truth[TAUGHT].min() <= expected.min() < -1.5


def test_the_regression_knows_the_truths_that_teach_alone():
    trials = made()
    other = trials.copy(deep=True)
    other["theta_true"][TAUGHT.size :] = 0.0
    kept = [declared(part) for part in (trials, other)]
    place = kept[0].names.index("b as a regression on x expects it")
    np.testing.assert_array_equal(kept[0].values[:, place], kept[1].values[:, place])


def test_truth_and_draws_may_change_places():
    trials = made(own=False)
    swapped = trials.copy(deep=True)
    swapped["theta_true"][300:] = trials["draws"][300:, 4].values
    swapped["draws"][300:, 4] = trials["theta_true"][300:].values
    one, other = declared(trials), declared(swapped)
    assert one.names == other.names
    np.testing.assert_allclose(one.values, other.values, rtol=1e-10, atol=1e-12)


def test_of_many_channels_those_that_foretell_most_stay():
    trials = made(channels=120)
    names = declared(trials).names
    channels = [name for name in names if name.startswith("x[")]
    assert len(channels) == 40
    assert {"x[0]", "x[1]"} <= set(channels)


def test_samples_alone_have_locations_and_numbers_of_their_own():
    assert declared(made(data=False)).names == ("the posterior of a", "the posterior of b", "exposure")


@pytest.mark.parametrize("value", [3.0, np.nan])
def test_what_cannot_part_trials_is_said(value):
    trials = made()
    trials["exposure"][:] = value
    found = declared(trials)
    assert "exposure" not in found.names
    assert len(found.left_out) == 1
    assert found.left_out[0].startswith("exposure: ")


def test_a_circular_parameter_has_a_place_and_no_regression():
    rng = np.random.default_rng(3)
    phase = rng.uniform(0, 2 * np.pi, size=(N, 1))
    draws = (phase[:, None] + 0.1 * rng.normal(size=(N, 9, 1))) % (2 * np.pi)
    trials = make_trials(phase, draws, ["phase"], x=np.column_stack([np.cos(phase), np.sin(phase)]),
                         circular=["phase"])  # fmt: skip
    found = declared(trials)
    assert not any("regression" in name for name in found.names)
    place = found.values[:, found.names.index("the posterior of phase")]
    assert ((place >= 0) & (place < 2 * np.pi)).all()
    pool = np.concatenate([phase, draws[..., 0]], axis=1)
    middle = np.angle(np.exp(1j * pool).mean(axis=1))
    np.testing.assert_allclose(np.angle(np.exp(1j * (place - middle))), 0, atol=0.01)


def correlation(one, other):
    return 0.0 if np.ptp(one) == 0 or np.ptp(other) == 0 else abs(np.corrcoef(one, other)[0, 1])


def test_channels_that_stay_are_those_most_correlated_with_ranks_or_truths():
    """On normal scores of the trials that teach, or on their squares; the others tell nothing."""
    trials = made(channels=45, own=False)
    trials["x"][:, 7] = np.abs(trials["theta_true"][:, 0] - 1.0)
    trials["x"][:, 9] = 4.0
    ready = Prepared(trials_tree(trials), 1)
    taught = np.arange(100, 350)
    found = declared_features(ready, taught)
    rank = ready.pit[taught] - 0.5
    told = np.concatenate([rank, abs(rank), ready.theta_true[taught]], axis=1)
    x = trials["x"].values
    place = normal_scores(x[taught], x[taught])
    strength = [max(max(correlation(p, t), correlation(p**2, t)) for t in told.T) for p in place.T]
    kept = np.sort(np.argsort(-np.array(strength), kind="stable")[:40])
    names = [name for name in found.names if name.startswith("x[")]
    assert names == [f"x[{k}]" for k in kept if k != 9]
    for k in (0, 7):
        np.testing.assert_array_equal(found.values[:, found.names.index(f"x[{k}]")], x[:, k])
    # A component is named by the channel that it goes with.
    for number in (1, 2):
        column = ready.features.column(f"component {number}")
        main = np.argmax([correlation(column, x[:, k]) for k in range(x.shape[1])])
        assert f"component {number} (most of it x[{main}])" in found.names


def test_a_regression_s_quantile_is_one_of_the_truths_that_teach():
    """Linear between the sorted truths of the trials that teach, at the level of the expected score."""
    rng = np.random.default_rng(4)
    theta = np.column_stack([rng.uniform(0, 6, N), np.exp(rng.normal(size=N)), rng.normal(size=N)])
    x = np.column_stack([np.log(theta[:, 1]) + rng.normal(size=N), theta[:, 2], rng.normal(size=N)])
    draws = rng.uniform(0, 6, size=(N, 9, 3))
    ready = Prepared(trials_tree(make_trials(theta, draws, ["p", "a", "b"], x=x, circular=["p"])), 1)
    taught = np.arange(5, 210)
    found = declared_features(ready, taught)
    assert found.names[-2:] == ("a as a regression on x expects it", "b as a regression on x expects it")
    inputs = data_of(ready, np.arange(N)).values
    truth = theta[taught][:, 1:]
    level = stats.norm.cdf(fit_ridge(inputs[taught], normal_scores(truth, truth))(inputs))
    for k in range(2):
        at = level[:, k] * 204
        order = np.sort(truth[:, k])
        low = np.minimum(at.astype(int), 203)
        wanted = order[low] + (at - low) * (order[low + 1] - order[low])
        np.testing.assert_allclose(found.values[:, -2 + k], wanted, rtol=1e-6, atol=1e-9)


def test_of_a_single_channel_the_total_is_all():
    trials = made(own=False)
    trials = trials.drop_vars("x").assign(x=(("trial", "place"), trials["x"].values[:, :1]))
    found = declared(trials)
    assert found.names[2:] == (
        "total", "a as a regression on x expects it", "b as a regression on x expects it",
    )  # fmt: skip
