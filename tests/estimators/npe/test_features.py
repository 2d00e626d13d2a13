import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("sbi")

from gaugeblock.estimators.npe.features import CountFeatures, StandardFeatures, choose_kind  # noqa: E402


@pytest.mark.parametrize("level", [1.0, 1e3, 1e8])
def test_noise_of_a_channel_keeps_its_size_at_any_count(level):
    # The first features are square roots: noise of sd 1/2 whatever the mean (0.35 to 0.65 from one count on).
    x = np.random.default_rng(1).poisson(level, size=(4000, 12))
    raw = CountFeatures((12,)).raw(torch.from_numpy(x.astype(float)))[:, :12]
    assert 0.35 < float(raw.std()) < 0.65


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
    assert torch.isfinite(features(torch.tensor([[0.1, 3.0]]))).all()


def test_choice_by_data():
    assert choose_kind("auto", np.zeros((3, 4), dtype=np.int64)) == "counts"
    assert choose_kind("auto", np.zeros((3, 4))) == "standard"
    assert choose_kind("auto", np.zeros((3, 4, 4), dtype=np.int64)) == "standard"
    assert choose_kind("standard", np.zeros((3, 4), dtype=np.int64)) == "standard"
