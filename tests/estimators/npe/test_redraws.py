"""Posterior draws beside a row's own parameters: exact for known posteriors, and what they are worth."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import kstest

torch = pytest.importorskip("torch")
pytest.importorskip("sbi")

from gaugeblock.core.errors import InputError  # noqa: E402
from gaugeblock.estimators.npe import TrainingConfig, train  # noqa: E402
from gaugeblock.estimators.npe.bank import Bank, stream  # noqa: E402
from gaugeblock.estimators.npe.laplace.training import RedrawnBank, redrawn, redrawn_bank  # noqa: E402
from gaugeblock.simulators import Normal, Prior  # noqa: E402
from gaugeblock.simulators.protocol import poisson_log_likelihood  # noqa: E402

NOISE = 0.5
WIDTH, SHIFT = 0.7, 0.2


class Shifted:
    """A flow that ignores the data: normal draws of another width and place than any posterior."""

    def parameters(self):
        yield torch.zeros(())

    def context(self, data):
        return data

    def draw(self, noise, context):
        drawn = WIDTH * noise + SHIFT
        return drawn, self.log_prob(drawn, context)

    def log_prob(self, scores, context):
        away = (scores[..., 0] - SHIFT) / WIDTH
        return -0.5 * away**2 - np.log(WIDTH * np.sqrt(2.0 * np.pi))


@pytest.fixture(scope="module")
def conjugate():
    """Standard normal parameters, data with normal noise: the posterior is normal(0.8 x, 0.2)."""
    rng = np.random.default_rng(1)
    theta = rng.standard_normal((3000, 1))
    x = theta + NOISE * rng.standard_normal((3000, 1))
    simulator = SimpleNamespace(
        prior=Prior({"place": Normal(0.0, 1.0)}),
        log_likelihood=lambda theta, x: -0.5 * ((theta - x) ** 2).sum(axis=-1) / NOISE**2,
    )
    return Bank(theta.astype(np.float32), x, False, simulator), x


def away(bank, x, number, *, wrong=False):
    pool, log_weight = redrawn(
        Shifted(), bank, x, slice(0, len(bank)), number=number, rng=np.random.default_rng(2)
    )
    if wrong:
        log_weight = np.zeros_like(log_weight)
    scores, _ = RedrawnBank(bank, pool, log_weight).pairs(np.arange(len(bank)), np.random.default_rng(3))
    return ((scores - 0.8 * x) / np.sqrt(0.2))[:, 0], scores


@pytest.mark.parametrize("number", [1, 4, 32])
def test_picks_follow_the_posterior_however_few_and_bad_the_draws(conjugate, number):
    bank, x = conjugate
    pulls, scores = away(bank, x, number)
    # One test at one in a thousand.
    assert kstest(pulls, "norm").pvalue > 1e-3
    assert (scores != bank.scores).mean() > 0.2


def test_without_weights_they_would_not(conjugate):
    bank, x = conjugate
    assert kstest(away(bank, x, 32, wrong=True)[0], "norm").pvalue < 1e-6


def test_pools_of_chunks_are_weighed_with_the_noise_they_were_compressed_with(tmp_path, monkeypatch):
    monkeypatch.setattr("gaugeblock.estimators.npe.laplace.training.ROWS", 30)
    rng = np.random.default_rng(4)
    simulator = SimpleNamespace(
        prior=Prior({"place": Normal(3.0, 2.0)}),
        observe=lambda mean, rng: mean + NOISE * rng.standard_normal(mean.shape),
        log_likelihood=lambda theta, x: -0.5 * ((theta - x) ** 2).sum(axis=-1) / NOISE**2,
    )
    scores = rng.standard_normal((260, 1)).astype(np.float32)
    bank = Bank(scores, 3.0 + 2.0 * scores, True, simulator)
    seen = []

    def made():
        return redrawn_bank(
            Shifted(), bank, Bank(scores, scores, False, simulator), number=3, rows=230, chunk=100, seed=5,
            folder=tmp_path / "pools", progress=lambda *said: seen.append(said),
        )  # fmt: skip

    some = made()
    assert seen == [("redraws", done, 230) for done in (100, 200, 230)]
    x = [simulator.observe(bank.data[i : i + 100], stream(5, "noise", i)) for i in (0, 100, 200)]
    x = np.concatenate(x)[:230]
    np.testing.assert_array_equal(some.pool[:, 0], scores[:230])
    assert some.pool.shape == (230, 4, 1)
    assert len(np.unique(some.pool)) == 230 * 4
    score = some.pool[..., 0].astype(float)
    log_q = -0.5 * ((score - SHIFT) / WIDTH) ** 2 - np.log(WIDTH * np.sqrt(2 * np.pi))
    expected = -0.5 * ((3.0 + 2.0 * score - x) / NOISE) ** 2 - 0.5 * score**2 - log_q
    np.testing.assert_allclose(some.log_weight, expected, rtol=1e-4, atol=1e-4)
    # What lies in the folder is taken as it is.
    (tmp_path / "pools" / "00000100.npz").unlink()
    simulator.log_likelihood = lambda theta, x: np.zeros(theta.shape[:-1])
    again = made()
    np.testing.assert_array_equal(again.pool, some.pool)
    same = (again.log_weight == some.log_weight).all(axis=1)
    assert np.flatnonzero(~same).tolist() == list(range(100, 200))


def test_picks_are_new_every_time_and_rows_held_out_keep_their_own(conjugate):
    bank, x = conjugate
    rows = slice(0, 2000)
    pool, log_weight = redrawn(Shifted(), bank, x[rows], rows, number=8, rng=np.random.default_rng(2))
    some = RedrawnBank(bank, pool, log_weight)
    place = np.array([5, 2500, 7, 1999, 2000])
    first, data = some.pairs(place, np.random.default_rng(3))
    np.testing.assert_array_equal(data, bank.data[place])
    np.testing.assert_array_equal(first[[1, 4]], bank.scores[[2500, 2000]])
    several = np.stack([some.pairs(rows, np.random.default_rng(seed))[0] for seed in range(20)])
    assert np.median([len(np.unique(several[:, row])) for row in range(200)]) > 2
    held, _ = some.pairs(slice(2000, None), np.random.default_rng(3))
    np.testing.assert_array_equal(held, bank.scores[2000:])


def with_likelihood(make_counts):
    simulator = make_counts()
    simulator.log_likelihood = lambda theta, x: poisson_log_likelihood(simulator.expected(theta), x)
    return simulator


@pytest.fixture(scope="module")
def settings(configure_laplace):
    """Few simulations, and every third of them held out."""

    def made(**training):
        few = {"simulations": 1000, "validation": 0.3, "batch": 128, "steps": 120, "checkpoint": 40}
        return configure_laplace(**few, **training)

    return made


@pytest.fixture(scope="module")
def flow(tmp_path_factory, make_counts, settings):
    folder = tmp_path_factory.mktemp("redraws") / "model"
    return train(with_likelihood(make_counts), settings(redraws=5), folder=folder)


def test_a_flow_that_learns_few_simulations_by_heart_learns_more_from_pools(flow):
    curve = flow.record["curve"]
    once = curve["step"].index(120) + 1
    loss = {name: np.array(curve[name]) for name in ("training", "validation")}
    gap = loss["validation"] - loss["training"]
    assert gap[once - 1] > 0.1
    assert loss["validation"][once:].min() < loss["validation"][:once].min() - 0.02
    assert gap[-1] < 0.8 * gap[once - 1]


def test_cut_off_among_them_it_ends_at_the_same_weights(
    tmp_path, make_counts, configure_laplace, monkeypatch
):
    monkeypatch.setattr("gaugeblock.estimators.npe.laplace.training.GUESS_STEPS", 10)

    class Cut(Exception):
        pass

    seen = []

    def stop(stage, done, total):
        seen.append(stage)
        if stage == "steps" and done == 15 and "redraws" in seen:
            raise Cut

    few = {"simulations": 300, "batch": 64, "steps": 20, "checkpoint": 10, "redraws": 3}
    settings, folder = configure_laplace(**few, emulator_steps=10), tmp_path / "model"
    whole = train(with_likelihood(make_counts), settings, folder=tmp_path / "whole")
    with pytest.raises(Cut):
        train(with_likelihood(make_counts), settings, folder=folder, progress=stop)
    again = train(with_likelihood(make_counts), settings, folder=folder)
    assert again.record["sha256"] == whole.record["sha256"]


def test_they_need_a_likelihood_and_the_network_that_has_them(tmp_path, make_counts, settings):
    with pytest.raises(InputError, match="redraws needs"):
        train(make_counts(), settings(redraws=5), folder=tmp_path / "a")
    config = TrainingConfig.build(
        {"simulator": {"name": "counts"}, "training": {"simulations": 1100, "redraws": 1}}
    )
    with pytest.raises(InputError, match="redraws needs"):
        train(with_likelihood(make_counts), config, folder=tmp_path / "b")
