"""The bank: every row of its prior and simulator, in chunks that a later run takes as they are."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

pytest.importorskip("sbi")

from gaugeblock.core.errors import InputError
from gaugeblock.estimators.npe import bank as module
from gaugeblock.estimators.npe.bank import Bank, describe_simulator, fingerprint, stream
from gaugeblock.estimators.npe.coordinates import to_scores
from gaugeblock.simulators import Prior


@pytest.fixture(autouse=True)
def few(monkeypatch):
    monkeypatch.setattr(module, "CHUNK", 10)


def simulated(simulator, n, folder, **options):
    seen = []
    bank = Bank.simulate(
        simulator, n, seed=3, folder=folder, progress=lambda *said: seen.append(said), **options
    )
    return bank, seen


@pytest.mark.parametrize(("fresh", "n"), [(True, 25), (False, 20)])
def test_rows_are_of_the_prior_and_their_own_data(counts, tmp_path, fresh, n):
    bank, seen = simulated(counts, n, tmp_path, fresh=fresh)
    assert seen == [("simulations", done, n) for done in ((10, 20, 25) if n == 25 else (10, 20))]
    theta, data = [], []
    for number, rows in enumerate((10, 10, 5)[: len(seen)]):
        rng = stream(3, "bank", number)
        theta.append(counts.prior.sample(rows, rng))
        data.append(counts.expected(theta[-1]) if fresh else counts.simulate(theta[-1], rng))
    theta, data = np.concatenate(theta), np.concatenate(data)
    assert len(np.unique(theta[:, 0])) == len(bank) == n
    assert (bank.fresh, bank.scores.dtype) == (fresh, np.float32)
    np.testing.assert_allclose(bank.scores, to_scores(counts.prior, theta), rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(bank.data, data, rtol=1e-6)
    rows = np.array([7, 2, 19])
    scores, x = bank.pairs(rows, np.random.default_rng(1))
    np.testing.assert_array_equal(scores, bank.scores[rows])
    expected = counts.observe(bank.data[rows], np.random.default_rng(1)) if fresh else bank.data[rows]
    np.testing.assert_array_equal(x, expected)


def test_without_a_mean_there_is_no_fresh_noise(counts, signal, tmp_path):
    bank, _ = simulated(signal, 5, tmp_path)
    assert not bank.fresh
    np.testing.assert_array_equal(bank.observe(slice(1, 3), None), bank.data[1:3])
    assert describe_simulator(counts) == counts.describe()
    assert describe_simulator(signal) == {"simulator": "Signal", "prior": signal.prior.describe()}


def test_what_is_left_is_taken_and_of_another_simulation_nothing(counts, tmp_path):
    first, _ = simulated(counts, 20, tmp_path)
    place = tmp_path / "bank"
    names = sorted(path.name for path in place.glob("*.npz"))
    assert len(names) == 2
    content = dict(np.load(place / names[0]))
    np.savez(place / names[0], theta=content["theta"], data=content["data"] + 1)
    (place / names[1]).write_bytes(b"torn")
    again, _ = simulated(counts, 20, tmp_path)
    np.testing.assert_allclose(again.data[:10], first.data[:10] + 1)
    np.testing.assert_array_equal(again.data[10:], first.data[10:])
    for change in ({"seed": 4}, {"seed": 3, "fresh": False}):
        other = Bank.simulate(counts, 20, folder=tmp_path, **change)
        assert not np.isclose(other.data, again.data).all(axis=1).any()
        json.loads((place / "key.json").read_text())
    np.testing.assert_array_equal(simulated(counts, 20, tmp_path)[0].data, first.data)
    # The same parameters in another order are another simulator's.
    turned = type(counts)()
    turned.prior = Prior(dict(reversed(counts.prior.marginals.items())))
    theta = simulated(turned, 20, tmp_path)[0].scores
    np.testing.assert_array_equal(theta, simulated(turned, 20, tmp_path / "empty")[0].scores)


def test_data_that_cannot_be_trained_on_name_their_parameters(counts, tmp_path):
    def spoilt(theta, rng):
        return np.where(theta[:, :1] == theta[3:4, :1], np.nan, np.ones((len(theta), 4)))

    simulator = SimpleNamespace(prior=counts.prior, simulate=spoilt)
    third = counts.prior.sample(10, stream(3, "bank", 0))[3]
    with pytest.raises(InputError, match=rf"at slope={third[0]:.6g}, norm={third[1]:.6g}; a flow"):
        simulated(simulator, 10, tmp_path)
    simulator.simulate = lambda theta, rng: np.zeros((len(theta) - 1, 4))
    with pytest.raises(InputError, match=r"data of shape \(9, 4\) for 10 parameter vectors"):
        simulated(simulator, 10, tmp_path)


def test_streams_and_fingerprints_are_of_all_that_they_are_given(counts, make_counts):
    words = [(1, "a", 0), (2, "a", 0), (1, "b", 0), (1, "a", 1), (1, "ab", 0), (1, "ba", 0)]
    assert len({stream(*each).random() for each in words}) == len(words)
    assert stream(1, "a").random() == stream(1, "a", 0).random()
    priors = counts.prior, make_counts(high=4.0).prior
    marks = [fingerprint(prior, values) for prior in priors for values in ({"a": 1}, {"a": 2})]
    assert len(set(marks)) == 4
    assert {len(mark) for mark in marks} == {16}


def test_a_bank_is_known_again_whatever_the_order_its_simulator_is_described_in(tmp_path, make_counts):
    class Turned(make_counts):
        def describe(self):
            return dict(reversed(super().describe().items()))

        def expected(self, theta):
            raise AssertionError("simulated again")

    seen = []
    first = Bank.simulate(
        make_counts(), 10, seed=1, folder=tmp_path, progress=lambda *said: seen.append(said)
    )
    again = Bank.simulate(Turned(), 10, seed=1, folder=tmp_path)
    np.testing.assert_array_equal(again.data, first.data)
    np.testing.assert_array_equal(again.scores, first.scores)
    assert seen == [("simulations", 10, 10)]
    for other in ({"seed": 2}, {"seed": 1, "fresh": False}):
        made = Bank.simulate(make_counts(), 10, folder=tmp_path, **other)
        assert not np.array_equal(made.data, first.data)


def test_chunks_of_a_bank_are_of_streams_of_their_own(tmp_path, counts, monkeypatch):
    monkeypatch.setattr("gaugeblock.estimators.npe.bank.CHUNK", 4)
    seen = []
    bank = Bank.simulate(counts, 10, seed=1, folder=tmp_path, progress=lambda *said: seen.append(said))
    assert seen == [("simulations", done, 10) for done in (4, 8, 10)]
    parts = [counts.prior.sample(rows, stream(1, "bank", k)) for k, rows in enumerate((4, 4, 2))]
    theta = np.concatenate(parts)
    np.testing.assert_allclose(bank.data, counts.expected(theta), rtol=1e-6)
    np.testing.assert_allclose(bank.scores, norm.ppf(counts.prior.to_unit_cube(theta)), rtol=1e-5)
    assert len(np.unique(bank.scores, axis=0)) == 10
    # More of the same: whole chunks are read again, and the last is made anew.
    more = Bank.simulate(counts, 12, seed=1, folder=tmp_path)
    np.testing.assert_array_equal(more.data[:8], bank.data[:8])
    assert len(more) == 12
