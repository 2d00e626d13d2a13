"""Data as challengers see them: sums, standardised or ranked, named in the data's own terms."""

import itertools

import numpy as np
import pytest
import xarray as xr

from gaugeblock.validate import make_trials, trials_tree
from gaugeblock.validate.learned.discriminant import normal_scores
from gaugeblock.validate.learned.informed.data import (
    channel_names,
    channels,
    data_of,
    make_data,
    summed,
    usable,
)
from gaugeblock.validate.prepared import Prepared


def test_neighbours_are_summed_until_there_are_few_enough():
    x = np.random.default_rng(1).normal(size=(3, 10, 60))
    flat = x.reshape(3, -1)
    starts = [int(600 * k / 256) for k in range(257)]
    wanted = np.stack([flat[:, a:b].sum(axis=1) for a, b in itertools.pairwise(starts)], axis=1)
    np.testing.assert_allclose(summed(x), wanted)
    np.testing.assert_array_equal(summed(x[:, :, :25]), x[:, :, :25].reshape(3, -1))
    assert summed(np.ones((2, 256))).shape == (2, 256)
    assert summed(np.ones((2, 257))).shape == (2, 256)
    assert summed(np.ones(4)).tolist() == [[1.0]] * 4


def test_channels_are_called_as_they_lie():
    def called(*shape):
        return channel_names(xr.DataArray(np.zeros((5, *shape))))

    assert called(3) == ["x[0]", "x[1]", "x[2]"]
    assert called(2, 2) == ["x[0, 0]", "x[0, 1]", "x[1, 0]", "x[1, 1]"]
    assert called() == ["x"]
    assert called(0) == called(3, 0) == []
    many = called(2, 300)
    assert len(many) == 256
    assert many[:2] == ["x[0, 0] to x[0, 1]", "x[0, 2] to x[0, 3]"]
    assert many[-1] == "x[1, 297] to x[1, 299]"
    assert called(300)[0] == "x[0]"
    energies = xr.DataArray(np.zeros((5, 512)), dims=("trial", "keV"), coords={"keV": np.arange(512) / 100})
    assert channel_names(energies)[1] == "x[keV=0.02] to x[keV=0.03]"


def test_values_are_standardised_counts_by_their_roots_and_heavy_ones_by_rank():
    rng = np.random.default_rng(2)
    plain = rng.normal(size=200)
    heavy = rng.standard_cauchy(200)
    features = rng.exponential(size=(200, 2))
    found = make_data(
        np.column_stack([plain, np.full(200, 3.0), heavy]), features, names=["one", "two"],
        channels=["x[0]", "x[1]", "x[2]"],
    )  # fmt: skip
    assert (found.names, found.channels) == (("x[0]", "x[2]", "one", "two"), 2)
    np.testing.assert_allclose(found.values[:, 0], (plain - plain.mean()) / plain.std())
    np.testing.assert_allclose(found.values[:, 1], normal_scores(heavy[:, None], heavy[:, None])[:, 0])
    np.testing.assert_allclose(found.values[:, 2:], normal_scores(features, features))
    counts = rng.poisson(4.0, (200, 2)).astype(float)
    root = np.sqrt(counts)
    found = make_data(counts, np.empty((200, 0)), channels=["a", "b"], names=[])
    np.testing.assert_allclose(found.values, (root - root.mean(axis=0)) / root.std(axis=0))


@pytest.mark.parametrize(("share", "ranked"), [(0.03, False), (0.05, True)])
def test_ranks_are_taken_where_far_values_make_most_of_the_spread(share, ranked):
    """Beyond twice what quartiles say of a normal distribution: 16 times 9^2 or so many percent decide."""
    rng = np.random.default_rng(3)
    values = rng.normal(size=2000)
    values[: int(2000 * share)] *= 9.0
    ratio = values.std() / (np.subtract(*np.quantile(values, [0.75, 0.25])) / 1.349)
    assert (ratio > 2) == ranked
    assert abs(ratio - 2) < 0.35
    found = make_data(values[:, None], np.empty((2000, 0)), channels=["x[0]"], names=[]).values[:, 0]
    scores = normal_scores(values[:, None], values[:, None])[:, 0]
    wanted = scores if ranked else (values - values.mean()) / values.std()
    np.testing.assert_allclose(found, wanted)


def test_data_of_some_trials_leave_out_features_that_are_no_numbers():
    rng = np.random.default_rng(4)
    x = rng.normal(size=(30, 2, 2))
    trials = make_trials(np.zeros((30, 1)), rng.normal(size=(30, 5, 1)), ["a"], x=x)
    trials = trials.assign(own=("trial", rng.normal(size=30)), bad=("trial", np.full(30, np.nan)))
    rows = np.array([4, 2, 9, 20, 7])
    made = Prepared(trials_tree(trials), 1)
    found = data_of(made, rows)
    features = made.features
    kept = [k for k, name in enumerate(features.names) if name != "bad"]
    assert "bad" in features.names
    wanted = make_data(
        x.reshape(30, 4)[rows], features.values[rows][:, kept],
        channels=["x[0, 0]", "x[0, 1]", "x[1, 0]", "x[1, 1]"], names=[features.names[k] for k in kept],
    )  # fmt: skip
    assert (found.names[:5], found.channels) == (wanted.names[:5], 4)
    # Components say with which value of x they go most, the user's own keep their names.
    for name, was in zip(found.names[5:], wanted.names[5:], strict=True):
        column = features.column(was)
        alike = [abs(np.corrcoef(column, value)[0, 1]) for value in x.reshape(30, 4).T]
        main = wanted.names[int(np.argmax(alike))]
        assert name == (was if was == "own" else f"{was} (most of it {main})")
    assert [name.split(" (")[0] for name in found.names[5:]] == [
        *(f"component {k + 1}" for k in range(4)),
        "own",
    ]
    np.testing.assert_allclose(found.values, wanted.values)
    np.testing.assert_array_equal(usable(features.values), features.values[:, kept])
    silent = data_of(Prepared(trials_tree(trials.assign(x=0 * trials["x"])), 1), rows)
    assert (silent.names[:2], silent.channels) == (("total", "component 1"), 0)
    alone = data_of(Prepared(trials_tree(trials.drop_vars("x")), 1), rows)
    assert (alone.names, alone.channels, alone.values.shape) == (("own",), 0, (5, 1))
    none = data_of(Prepared(trials_tree(trials.drop_vars(["x", "own", "bad"])), 1), rows)
    assert (none.names, none.values.shape) == ((), (5, 0))
    (block,) = made.blocks()
    np.testing.assert_array_equal(channels(block), x.reshape(30, 4))


def test_principal_components_are_of_the_trials_that_taught():
    """By a singular value decomposition of their standardised values, up to signs; ranked among them."""
    rng = np.random.default_rng(6)
    x = rng.normal(size=(90, 3)) @ rng.normal(size=(3, 3)) + 4.0
    x[60:] *= rng.normal(size=(30, 3)) * 50
    trials = make_trials(np.zeros((90, 1)), rng.normal(size=(90, 5, 1)), ["a"], x=x)
    rows = rng.permutation(90)
    found = data_of(Prepared(trials_tree(trials), 1), rows, taught=40)
    first = x[rows[:40]]
    assert (first < 0).any()
    standard = (x[rows] - first.mean(axis=0)) / first.std(axis=0)
    directions = np.linalg.svd(standard[:40])[2]
    assert found.names[:4] == ("x[0]", "x[1]", "x[2]", "total")
    for k, direction in enumerate(directions):
        component = standard @ direction
        main = np.argmax([abs(np.corrcoef(component[:40], value)[0, 1]) for value in first.T])
        assert found.names[4 + k] == f"component {k + 1} (most of it x[{main}])"
        (wanted,) = normal_scores(component[:, None], component[:40, None]).T
        sign = np.sign(wanted @ found.values[:, 4 + k])
        np.testing.assert_allclose(found.values[:, 4 + k], sign * wanted, atol=1e-9)
    assert found.values.shape == (90, 7)
    single = data_of(Prepared(trials_tree(trials.isel(channel=[0])), 1), rows, taught=40)
    assert single.names == ("x[0]", "total")
