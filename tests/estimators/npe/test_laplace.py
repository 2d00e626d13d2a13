"""The flow around a Gaussian: its parts against exact answers, and its training."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import minimize

torch = pytest.importorskip("torch")
pytest.importorskip("sbi")

from gaugeblock.core.errors import InputError  # noqa: E402
from gaugeblock.estimators.npe import load, train  # noqa: E402
from gaugeblock.estimators.npe.bank import Bank, stream  # noqa: E402
from gaugeblock.estimators.npe.laplace.compressor import (  # noqa: E402
    Compressor,
    approximate,
    potential,
)
from gaugeblock.estimators.npe.laplace.emulator import Emulator  # noqa: E402
from gaugeblock.estimators.npe.laplace.network import Head  # noqa: E402
from gaugeblock.estimators.npe.laplace.training import train_compressor, train_laplace  # noqa: E402
from gaugeblock.estimators.npe.networks import NetworkShape, build_network  # noqa: E402
from gaugeblock.simulators.protocol import poisson_log_likelihood  # noqa: E402
from gaugeblock.validate.joint.importance import kish_fraction, log_weights  # noqa: E402


class LogLinear:
    """Log expected counts that are linear in the scores: one channel a parameter, known posteriors."""

    def __init__(self, size: int, level: float):
        self.size, self.level = size, level

    def __call__(self, score):
        return 0.1 * score + self.level

    def with_slope(self, score):
        slope = 0.1 * torch.eye(self.size, dtype=score.dtype)
        return self(score), slope.expand(len(score), -1, -1)


@pytest.fixture(scope="module")
def settings(configure_laplace):
    return configure_laplace


@pytest.fixture(scope="module")
def flow(tmp_path_factory, make_counts, settings):
    return train(make_counts(), settings(), folder=tmp_path_factory.mktemp("laplace") / "model")


def test_slopes_are_those_of_the_emulator():
    torch.manual_seed(0)
    emulator = Emulator(3, 7, (16, 16))
    emulator.standardise(torch.exp(3.0 + torch.linspace(0.5, 2.0, 7) * torch.randn(50, 7)))
    score = torch.randn(5, 3)
    value, slope = emulator.with_slope(score)
    torch.testing.assert_close(value, emulator(score))
    exact = torch.func.vmap(torch.func.jacrev(lambda s: emulator(s[None])[0]))(score)
    torch.testing.assert_close(slope, exact.transpose(1, 2), rtol=1e-4, atol=1e-5)
    # As precise as the scores: single precision is off by more than this.
    precise, steep = emulator.with_slope(score.double())
    emulator.double()
    torch.testing.assert_close(precise, emulator(score.double()), rtol=1e-12, atol=0.0)
    exact = torch.func.vmap(torch.func.jacrev(lambda s: emulator(s[None])[0]))(score.double())
    torch.testing.assert_close(steep, exact.transpose(1, 2), rtol=1e-10, atol=1e-12)


def test_a_quadratic_posterior_is_found_as_it_is():
    # With 1e4 counts a channel and slopes of 0.1 the posterior is a Gaussian to a per cent.
    emulator = LogLinear(3, math.log(1e4))
    x = torch.exp(emulator(torch.tensor([[0.5, -1.0, 0.0]])))
    found = approximate(emulator, x, torch.zeros(1, 3))
    expected = torch.diag(1.0 / torch.sqrt(1.0 + 0.01 * x[0]))
    torch.testing.assert_close(found.factor[0], expected, rtol=0.01, atol=1e-3)
    torch.testing.assert_close(found.mean[0], torch.tensor([0.5, -1.0, 0.0]) * 0.99, atol=0.02, rtol=0.0)
    assert found.shape.abs().max() < 0.1


class Mixed:
    """Log expected counts that are linear in all scores: skewed posteriors where counts are few."""

    matrix = np.array([[0.9, 0.2], [-0.5, 0.6], [0.3, 0.8]])
    level = np.log(np.array([2.0, 5.0, 1.0]))

    def __call__(self, score):
        return self.with_slope(score)[0]

    def with_slope(self, score):
        slope = torch.from_numpy(self.matrix.T).to(score)
        return score @ slope + torch.from_numpy(self.level).to(score), slope.expand(len(score), -1, -1)


def by_hand(x):
    """Mean, factor and shape for one row of counts, axis by axis."""

    def expected(score):
        return np.exp(Mixed.matrix @ score + Mixed.level)

    def height(score):
        return (expected(score) - x * np.log(expected(score))).sum() + 0.5 * score @ score

    def uphill(score):
        return score - Mixed.matrix.T @ (x - expected(score))

    def covariance(score):
        return np.linalg.inv(Mixed.matrix.T @ np.diag(expected(score)) @ Mixed.matrix + np.eye(2))

    def ends(mean, factor):
        return [mean + sign * math.sqrt(2) * factor[:, k] for sign in (1, -1) for k in (0, 1)]

    mean = minimize(height, np.zeros(2), jac=uphill, tol=1e-12).x
    found = covariance(mean)
    for _ in range(2):
        points = [mean, *ends(mean, np.linalg.cholesky(found))]
        fall = [height(mean) - height(point) + (0.0 if point is mean else 1.0) for point in points]
        weight = np.exp(np.minimum(fall, 1.5))
        weight /= weight.sum()
        mean = sum(w * point for w, point in zip(weight, points, strict=True))
        found = sum(w * covariance(point) for w, point in zip(weight, points, strict=True))
    factor = np.linalg.cholesky(found)
    points = ends(mean, factor)
    excess = [height(point) - height(mean) - 1.0 for point in points]
    along = [sign * math.sqrt(2) * np.eye(2)[k] for sign in (1, -1) for k in (0, 1)]
    steep = [uphill(point) @ factor - each for point, each in zip(points, along, strict=True)]
    return mean, factor, np.arcsinh(np.concatenate([excess, *steep]))


def test_a_skewed_posterior_is_described_as_by_hand():
    rows = np.array([[0.0, 3.0, 1.0], [7.0, 2.0, 4.0], [40.0, 1.0, 0.0]])
    found = approximate(Mixed(), torch.from_numpy(rows).float(), torch.tensor([[0.5, -0.5]] * 3))
    for row, x in enumerate(rows):
        for mine, theirs in zip(
            by_hand(x), (found.mean[row], found.factor[row], found.shape[row]), strict=True
        ):
            np.testing.assert_allclose(theirs.numpy(), mine, rtol=2e-3, atol=2e-3)


def test_without_counts_the_posterior_is_the_prior():
    found = approximate(LogLinear(2, math.log(1e-6)), torch.zeros(1, 2), torch.ones(1, 2))
    torch.testing.assert_close(found.mean, torch.zeros(1, 2), atol=1e-4, rtol=0.0)
    torch.testing.assert_close(found.factor[0], torch.eye(2), atol=1e-4, rtol=0.0)


def test_the_potential_keeps_its_digits_at_many_counts():
    x = torch.full((1, 100), 1e6)
    log_mean = torch.log(x) + 1e-4
    ratio = log_mean.double() - torch.log(x.double())
    exact = float((x * (torch.expm1(ratio) - ratio)).sum())
    assert float(potential(log_mean, x, torch.zeros(1, 1))) == pytest.approx(exact, rel=0.03)


def test_groups_keep_all_counts_and_neighbours_together():
    compressor = Compressor(2, 400, 50, (8, 8))
    expected = torch.linspace(5.0, 0.01, 400).expand(10, -1)
    compressor.choose_groups(expected)
    group = compressor.group
    assert (group.diff() >= 0).all()
    assert set(group.tolist()) == set(range(50))
    # Where the counts are, groups are narrower.
    assert (group == 0).sum() < (group == 49).sum()
    x = torch.poisson(expected).double()
    assert torch.equal(compressor.grouped(x).sum(dim=1), x.sum(dim=1))


def test_draws_and_densities_belong_together():
    torch.manual_seed(1)
    head = Head(2, embedding=(8,), output=4, transforms=2, hidden=(8, 8), bins=4)
    compressed = torch.randn(3, 2 + 3 + 2 * 2 * 3)
    compressed[:, [2, 4]] = compressed[:, [2, 4]].abs() + 0.2
    head.standardise(compressed)
    context = head.context(compressed)
    grid = torch.linspace(-60.0, 60.0, 601)
    points = torch.stack(torch.meshgrid(grid, grid, indexing="ij"), dim=-1).reshape(1, -1, 2)
    with torch.no_grad():
        mass = torch.exp(head.log_prob(points, context[:1])).sum() * 0.2**2
        assert float(mass) == pytest.approx(1.0, abs=0.02)
        draws, density = head.draw(torch.randn(3, 4000, 2), context)
        torch.testing.assert_close(density, head.log_prob(draws, context), rtol=1e-3, atol=1e-3)
        # A density's mean logarithm over its own draws is above that over anybody else's.
        own = head.log_prob(draws, context).mean()
        assert own > head.log_prob(draws[:, torch.randperm(4000)] * 1.3, context).mean()


def test_it_is_exact_enough_for_importance_weights(flow, counts):
    rng = np.random.default_rng(5)
    x = counts.simulate(counts.prior.sample(100, rng), rng)
    draws, log_q = flow.sample_and_log_prob(x, 400, rng)
    expected = counts.expected(draws.reshape(-1, 2)).reshape(100, 400, -1)
    likelihood = (x[:, None] * np.log(expected) - expected).sum(axis=-1)
    fraction = kish_fraction(log_weights(log_q, likelihood, counts.prior.log_prob(draws)))
    assert np.median(fraction) > 0.9
    assert counts.prior.contains(draws).all()


def test_its_ranks_are_uniform(flow, counts):
    from scipy.stats import kstest

    rng = np.random.default_rng(6)
    theta = counts.prior.sample(1000, rng)
    draws = flow.sample(counts.simulate(theta, rng), 200, rng)
    ranks = (draws < theta[:, None]).mean(axis=1)
    # Two tests at one in a thousand; a width 20% off has p of 1e-5 and less.
    assert min(kstest(ranks[:, j], "uniform").pvalue for j in range(2)) > 1e-3


def test_it_comes_back_from_its_folder(flow, counts, tmp_path_factory):
    folder = next(tmp_path_factory.getbasetemp().glob("laplace*/model"))
    again = load(folder, counts)
    x = counts.simulate(counts.prior.sample(3, np.random.default_rng(1)), np.random.default_rng(2))
    first, second = (f.sample(x, 10, np.random.default_rng(3)) for f in (flow, again))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("cut", [("compressed", 400), ("steps", 15)], ids=lambda cut: cut[0])
def test_cut_off_in_or_after_the_compression_it_ends_at_the_same_weights(
    tmp_path, make_counts, settings, monkeypatch, cut
):
    for name, value in {"GUESS_STEPS": 10, "CHUNK": 200}.items():
        monkeypatch.setattr(f"gaugeblock.estimators.npe.laplace.training.{name}", value)

    class Cut(Exception):
        pass

    def stop(stage, done, total):
        if (stage, done) == cut:
            raise Cut

    few = {"simulations": 512, "batch": 64, "steps": 20, "emulator_steps": 10, "checkpoint": 10}
    with torch.no_grad():  # as BayesFlow leaves a whole process
        whole = train(make_counts(), settings(**few), folder=tmp_path / "whole")
    folder = tmp_path / "model"
    with pytest.raises(Cut):
        train(make_counts(), settings(**few), folder=folder, progress=stop)
    chunks = list((folder / "training").glob("compressed-*/*.npz"))
    assert len(chunks) == (2 if cut[0] == "compressed" else 3)
    again = train(make_counts(), settings(**few), folder=folder)
    assert again.record["sha256"] == whole.record["sha256"]


def test_the_emulator_follows_the_simulator(tmp_path, counts):
    bank = Bank.simulate(counts, 4096, seed=3, folder=tmp_path)
    compressor = Compressor(2, 8, 8, (64, 64))
    train_compressor(compressor, bank, seed=3, steps=(1000, 10))
    with torch.no_grad():
        away = compressor.emulator(torch.from_numpy(bank.scores)) - torch.log(torch.from_numpy(bank.data))
    misfit = (torch.from_numpy(bank.data) * away**2).sum(dim=1)
    assert float(misfit.median()) < 0.02


def test_stages_hand_on_what_they_have_found(tmp_path, make_counts, settings, monkeypatch):
    """Every stage is cut to a few steps, chunks and rows to less than the bank."""
    for name, value in {"GUESS_STEPS": 3, "CHUNK": 100, "EXAMPLES": 150}.items():
        monkeypatch.setattr(f"gaugeblock.estimators.npe.laplace.training.{name}", value)
    simulator = make_counts()
    simulator.log_likelihood = lambda theta, x: poisson_log_likelihood(simulator.expected(theta), x)
    few = {"simulations": 260, "batch": 32, "steps": 5, "checkpoint": 4, "validation": 0.1, "redraws": 3}
    config = settings(**few, emulator_steps=2, seed=8)
    bank = Bank.simulate(simulator, 260, seed=8, folder=tmp_path)
    network = build_network(config.network, NetworkShape(2, (8,), "counts"), seed=8)
    seen = []
    curve = train_laplace(
        network, bank, config.training, folder=tmp_path, key="k", progress=lambda *said: seen.append(said)
    )
    steps = [("steps", done, 5) for done in range(1, 6)]
    assert seen == [
        *[("emulator", done, 2) for done in (1, 2)], *[("first guess", done, 3) for done in (1, 2, 3)],
        ("compressed", 100, 260), ("compressed", 200, 260), ("compressed", 260, 260), *steps,
        ("redraws", 100, 234), ("redraws", 200, 234), ("redraws", 234, 234), *steps,
    ]  # fmt: skip
    assert curve["step"] == [2, 4, 5, 7, 9, 10]
    assert len(curve["training"]) == len(curve["validation"]) == 6
    assert curve["best"] == min(curve["validation"][3:])

    compressor = network.compressor
    logarithm = np.log(bank.data[:150].astype(float))
    np.testing.assert_allclose(compressor.emulator.mean, logarithm.mean(axis=0), rtol=1e-4)
    np.testing.assert_allclose(compressor.emulator.scale, logarithm.std(axis=0, ddof=1), rtol=1e-4)
    assert not any(weight.requires_grad for weight in compressor.parameters())
    noise = [simulator.observe(bank.data[i : i + 100], stream(8, "noise", i)) for i in (0, 100, 200)]
    features = compressor.features(torch.from_numpy(np.concatenate(noise))).numpy()
    np.testing.assert_allclose(features.mean(axis=0), 0.0, atol=0.4)
    np.testing.assert_allclose(features.std(axis=0), 1.0, atol=0.4)
    stored = sorted((tmp_path / "compressed-k").glob("*.npz"))
    assert [path.stem for path in stored] == ["00000000", "00000100", "00000200"]
    compressed = np.concatenate([np.load(path)["data"] for path in stored])
    parts = [compressor(torch.from_numpy(x)).numpy() for x in noise]
    np.testing.assert_allclose(compressed, np.concatenate(parts), rtol=1e-4, atol=1e-5)
    with torch.no_grad():
        read = network.head.context(torch.from_numpy(compressed[:150]))[:, : network.head.read]
    read = read[:, -len(network.head.mean) :].numpy()
    np.testing.assert_allclose(read.mean(axis=0), 0.0, atol=0.01)
    np.testing.assert_allclose(read.std(axis=0, ddof=1), 1.0, atol=0.05)
    pools = [np.load(path)["pool"] for path in sorted((tmp_path / "redraws-k").glob("*.npz"))]
    assert [pool.shape for pool in pools] == [(100, 4, 2), (100, 4, 2), (34, 4, 2)]
    np.testing.assert_array_equal(np.concatenate(pools)[:, 0], bank.scores[:234])


def test_it_is_for_counts_with_an_expectation(tmp_path, signal, counts, settings):
    with pytest.raises(InputError, match="is for counts"):
        train(signal, settings(), folder=tmp_path / "a")
    with pytest.raises(InputError, match="expected counts"):
        train(counts, settings(fresh_noise=False), folder=tmp_path / "b")
