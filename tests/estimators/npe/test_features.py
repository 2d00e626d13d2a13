import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("sbi")

from gaugeblock.estimators.npe.features import GROUP, CountFeatures, StandardFeatures, choose_kind  # noqa: E402


@pytest.mark.parametrize("level", [1.0, 1e3, 1e8])
def test_noise_of_a_channel_keeps_its_size_at_any_count(level):
    # The first features are square roots: noise of sd 1/2 whatever the mean (0.35 to 0.65 from one count on).
    x = np.random.default_rng(1).poisson(level, size=(4000, 12))
    raw = CountFeatures((12,)).raw(torch.from_numpy(x.astype(float)))[:, :12]
    assert 0.35 < float(raw.std()) < 0.65


@pytest.mark.parametrize("channels", [GROUP, GROUP + 1, 3 * GROUP - 1])
def test_features_of_counts_are_what_the_docstring_says(channels):
    x = np.random.default_rng(4).poisson(3.0, size=(5, channels)).astype(float)
    x[0] = 0.0
    rows = []
    for row in x:
        root = [(count + 3 / 8) ** 0.5 for count in row]
        total = sum(row)
        # Of a total that is corrected as its parts are.
        shape = [one / (total + channels * 3 / 8) ** 0.5 for one in root]
        groups = [sum(row[start : start + GROUP]) for start in range(0, channels, GROUP)]
        rows.append([*root, np.log(1 + total), *shape, *(np.log(one + 0.5) for one in groups)])
    features = CountFeatures((channels,))
    assert features.size == len(rows[0])
    np.testing.assert_allclose(features.raw(torch.from_numpy(x)), rows, rtol=1e-12)
    features.fit(x)
    mean, sd = np.mean(rows, axis=0), np.std(rows, axis=0, ddof=1)
    np.testing.assert_allclose(features(torch.from_numpy(x)), (rows - mean) / sd, atol=1e-5)
    # Below none there is nothing.
    np.testing.assert_allclose(
        features.raw(torch.full((1, channels), -1.0).double())[0, 0], 0.375**0.5, rtol=1e-12
    )


def test_data_of_any_shape_are_made_flat_and_bounded_on_both_sides():
    x = np.random.default_rng(5).normal(size=(40, 2, 3))
    features = StandardFeatures((2, 3))
    assert features.size == 6
    features.fit(x)
    flat = x.reshape(40, 6)
    expected = (flat - flat.mean(axis=0)) / flat.std(axis=0, ddof=1)
    np.testing.assert_allclose(features(torch.from_numpy(x)), expected, atol=1e-5)
    assert features(torch.full((1, 2, 3), -1e9)).tolist() == [[-10.0] * 6]
    assert StandardFeatures(()).raw(torch.arange(3.0)).tolist() == [[0.0], [1.0], [2.0]]


def test_one_count_in_1e8_is_not_lost():
    features = CountFeatures((12,))
    features.fit(np.random.default_rng(2).poisson(1e8, size=(100, 12)))
    x = torch.full((2, 12), 1e8, dtype=torch.float64)
    x[1, 3] += 1.0
    first, second = features(x)
    assert float(second[3] - first[3]) > 0


def test_fitted_features_are_standardised_and_bounded():
    x = np.random.default_rng(3).normal(5.0, 2.0, size=(1000, 3))
    features = StandardFeatures((3,))
    features.fit(x)
    values = features(torch.from_numpy(x))
    assert torch.allclose(values.mean(dim=0), torch.zeros(3), atol=1e-5)
    assert torch.allclose(values.std(dim=0), torch.ones(3), atol=1e-4)
    assert float(features(torch.full((1, 3), 1e9, dtype=torch.float64)).max()) == 10.0


def test_a_channel_that_never_varies_is_harmless():
    features = StandardFeatures((2,))
    features.fit(np.column_stack([np.full(50, 0.1), np.arange(50.0)]))
    assert features.scale[0] == 1.0
    assert torch.isfinite(features(torch.tensor([[0.1, 3.0]]))).all()


def test_choice_by_data():
    assert choose_kind("auto", np.zeros((3, 4), dtype=np.int64)) == "counts"
    assert choose_kind("auto", np.array([[0, 1], [-1, 2]])) == "standard"
    assert choose_kind("counts", np.zeros((3, 4))) == "counts"
    assert choose_kind("auto", np.zeros((3, 4))) == "standard"
    assert choose_kind("auto", np.zeros((3, 4, 4), dtype=np.int64)) == "standard"
    assert choose_kind("standard", np.zeros((3, 4), dtype=np.int64)) == "standard"
