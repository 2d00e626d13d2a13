"""One flow for counts of any exposure: its parts against those of one exposure, and its training."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest

torch = pytest.importorskip("torch")
pytest.importorskip("sbi")

from gaugeblock.core.errors import InputError  # noqa: E402
from gaugeblock.estimators.npe import load, train  # noqa: E402
from gaugeblock.estimators.npe.features import CountFeatures  # noqa: E402
from gaugeblock.estimators.npe.laplace.compressor import (  # noqa: E402
    AtExposures,
    Compressor,
    approximate,
)
from gaugeblock.estimators.npe.laplace.emulator import Emulator  # noqa: E402
from gaugeblock.simulators import LogUniform  # noqa: E402
from gaugeblock.simulators.exposures import AcrossExposures  # noqa: E402
from gaugeblock.validate.joint.importance import kish_fraction, log_weights  # noqa: E402

RANGE = LogUniform(0.03, 30.0)


@pytest.fixture(scope="module")
def across(make_counts):
    return AcrossExposures(make_counts(), RANGE)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, across, configure_laplace):
    folder = tmp_path_factory.mktemp("across") / "model"
    train(across, configure_laplace(), folder=folder)
    return folder


@pytest.fixture(scope="module")
def flow(folder, across):
    return load(folder, across)


@pytest.mark.parametrize("decade", [(0.03, 0.3), (0.3, 3.0), (3.0, 30.0)])
def test_its_ranks_are_uniform_and_its_weights_even_in_every_decade(flow, counts, decade):
    some = AcrossExposures(counts, LogUniform(*decade))
    rng = np.random.default_rng(6)
    theta = some.prior.sample(600, rng)
    x = some.simulate(theta, rng)
    draws, log_q = flow.sample_and_log_prob(x, 200, rng)
    ranks = (draws < theta[:, None]).mean(axis=1)
    assert min(kstest(ranks[:, j], "uniform").pvalue for j in range(2)) > 1e-3
    likelihood = some.log_likelihood(draws, x[:, None])
    fraction = kish_fraction(log_weights(log_q, likelihood, some.prior.log_prob(draws)))
    assert np.median(fraction) > 0.8


def test_counts_in_one_exposure_are_compressed_as_by_an_emulator_of_that_exposure():
    torch.manual_seed(0)
    one, other = Compressor(2, 12, 6, (8, 8)), Compressor(2, 12, 6, (8, 8), exposed=True)
    expected = torch.rand(50, 12) * 20
    one.choose_groups(expected)
    other.choose_groups(torch.cat((expected, torch.full((50, 1), 40.0)), dim=1))
    assert torch.equal(one.group, other.group)
    other.emulator.load_state_dict(one.emulator.state_dict())
    rows, seconds = (
        torch.poisson(expected[:4]).double(),
        torch.tensor([[4.0], [40.0], [400.0], [80.0]]).double(),
    )
    compressed = other(torch.cat((rows, seconds), dim=1))
    torch.testing.assert_close(compressed[:, -1:], torch.log(seconds / 40.0).float())
    for row, factor, found in zip(rows, seconds[:, 0] / 40.0, compressed, strict=True):
        # The same emulator, made for so many times the counts; the fit goes on from where it ends.
        bright = Emulator(2, 6, (8, 8))
        bright.load_state_dict(one.emulator.state_dict())
        bright.mean += torch.log(factor).float()
        start = found[None, :2]
        counts = one.grouped(row[None]).float()
        gaussian = approximate(bright, counts, start)
        again = approximate(AtExposures(one.emulator, torch.log(factor).reshape(1, 1)), counts, start)
        torch.testing.assert_close(again.mean, gaussian.mean, rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(again.factor, gaussian.factor, rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(again.shape, gaussian.shape, rtol=1e-3, atol=1e-4)


def test_several_scores_of_a_row_are_in_its_exposure():
    torch.manual_seed(1)
    emulator, score = Emulator(2, 3, (4, 4)), torch.randn(6, 2)
    factor = torch.tensor([[0.5], [-1.0]])
    log_mean, slope = AtExposures(emulator, factor).with_slope(score)
    own, steep = emulator.with_slope(score)
    torch.testing.assert_close(log_mean - own, torch.tensor([0.5] * 3 + [-1.0] * 3)[:, None].expand(6, 3))
    assert torch.equal(slope, steep)


def test_an_exposure_is_no_channel():
    features = CountFeatures((13,), exposed=True)
    counts, seconds = torch.arange(24.0).reshape(2, 12).double(), torch.tensor([[10.0], [1e4]]).double()
    raw = features.raw(torch.cat((counts, seconds), dim=1))
    assert torch.equal(raw[:, :-1], CountFeatures((12,)).raw(counts))
    assert torch.equal(raw[:, -1:], torch.log(seconds))


def test_at_one_exposure_it_is_the_flow_of_counts_alone(flow, folder, counts):
    x = counts.simulate(counts.prior.sample(3, np.random.default_rng(1)), np.random.default_rng(2))
    seconds = np.full((3, 1), 0.7)
    whole = flow.sample_and_log_prob(np.concatenate([x, seconds], axis=1), 50, np.random.default_rng(3))
    one = flow.at(0.7)
    for mine, theirs in zip(one.sample_and_log_prob(x, 50, np.random.default_rng(3)), whole, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_allclose(one.log_prob(whole[0], x), whole[1], rtol=1e-4, atol=1e-3)
    assert one.data_shape == (8,)
    assert one.describe() == {**flow.describe(), "exposure": 0.7}

    # So it comes out of its folder where a simulator has one exposure.
    counts_in_seconds = type("Seconds", (), {
        "prior": counts.prior, "data_shape": (8,), "exposure": 0.7, "simulate": counts.simulate,
    })()  # fmt: skip
    np.testing.assert_array_equal(
        load(folder, counts_in_seconds).sample(x, 50, np.random.default_rng(3)), whole[0]
    )


def test_the_exposure_is_used(flow, counts):
    # Half the channels' counts in a tenth of the time are another amplitude altogether.
    x = counts.expected(np.full((1, 2), [2.0, 5.0])).round()
    short, long = (flow.at(t).sample(x, 500, np.random.default_rng(1))[0, :, 1] for t in (0.5, 2.0))
    assert np.median(short) / np.median(long) == pytest.approx(4.0, rel=0.15)


def test_it_says_which_exposures_it_knows(flow, folder, counts, across):
    x = np.concatenate([np.ones((2, 8)), [[1.0], [31.0]]], axis=1)
    with pytest.raises(InputError, match=r"from 0\.03 to 30, and here is 31; train one for it"):
        flow.sample(x, 3, np.random.default_rng(1))
    with pytest.raises(InputError, match=r"here is 0\.02"):
        flow.at(0.02)
    with pytest.raises(InputError, match="of one exposure"):
        flow.at(1.0).at(1.0)
    with pytest.raises(InputError, match="here is 40"):
        load(folder, AcrossExposures(counts, LogUniform(1.0, 40.0)))
    # Part of the range is within it, its ends too.
    load(folder, AcrossExposures(counts, LogUniform(1.0, 30.0)))
    with pytest.raises(InputError, match=r"trained on data of shape \(9,\)"):
        load(folder, counts)
    with pytest.raises(InputError, match=r"got \(2, 8\); the last entry is the exposure, and flow.at\("):
        flow.sample(np.ones((2, 8)), 3, np.random.default_rng(1))
    with pytest.raises(InputError, match=r"got \(2, 9\)$"):
        flow.at(1.0).sample(np.ones((2, 9)), 3, np.random.default_rng(1))


def test_other_networks(tmp_path, across, configure, counts_flow):
    flow = train(across, configure("counts", steps=20, simulations=1024), folder=tmp_path / "default")
    assert flow.record["features"] == "counts"
    x = across.simulate(across.prior.sample(2, np.random.default_rng(1)), np.random.default_rng(2))
    assert flow.sample(x, 5, np.random.default_rng(3)).shape == (2, 5, 2)
    published = configure("counts").replace({"network.kind": "published"})
    with pytest.raises(InputError, match="the last entry is an exposure"):
        train(across, published, folder=tmp_path / "published")
    with pytest.raises(InputError, match="for data of one exposure"):
        counts_flow.at(1.0)
