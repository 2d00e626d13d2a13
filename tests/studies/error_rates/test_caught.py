"""Faults are as large as pilots state them, and fresh audits of them FAIL: twin of the part `caught`."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from studies.error_rates import caught
from studies.error_rates.shapes import SHAPES
from studies.error_rates.shortcut import middle
from studies.kit.results import DOCS, RESULTS, read

from gaugeblock.validate import Outcome


@pytest.mark.parametrize("kind", ["bias", "width", "region"])
def test_a_fault_is_as_large_as_it_says(kind):
    """Of Cauchy posteriors: what the draws were moved by, in the half-widths of exact ones, to 10% (of 100
    draws these are 7% wider); and each trial's by its own."""
    pool, x = caught.faulty(kind, 0.5, "Cauchy", np.random.default_rng(1))
    exact, data = caught.pools("Cauchy", np.random.default_rng(1))
    np.testing.assert_array_equal(x, data)
    np.testing.assert_array_equal(pool[:, 0], exact[:, 0])
    draws, right = pool[:, 1:, 0], exact[:, 1:, 0]
    unit = stats.cauchy.ppf(0.84)
    assert middle("Cauchy")[1] == pytest.approx(unit, rel=0.01)
    if kind == "width":
        median = np.median(right, axis=1, keepdims=True)
        factor = (draws - median) / (right - median)
        np.testing.assert_allclose(np.abs(np.log(factor)), 0.5, rtol=1e-6)
        np.testing.assert_allclose(np.ptp(factor), 0.0, atol=1e-6)
        return
    moved = (draws - right).mean(axis=1)
    np.testing.assert_allclose(draws - right, np.broadcast_to(moved[:, None], draws.shape), atol=1e-9)
    wrong = x[:, 0] >= np.quantile(x, 7 / 8) if kind == "region" else np.ones(len(x), dtype=bool)
    assert wrong.sum() == (125 if kind == "region" else 1000)
    assert moved[wrong].mean() == pytest.approx(0.5 * unit, rel=0.1)
    assert moved[wrong].std() > 0.05 * unit
    assert (moved[~wrong] == 0).all()


def test_too_narrow_is_as_frequent_as_too_wide():
    """20 faults: 2 of either kind at least, but for 2 in 50,000."""
    spread = []
    for seed in range(20):
        pool, _ = caught.faulty("width", 0.5, "normal", np.random.default_rng(seed))
        spread.append(pool[:, 1:].std(axis=1).mean() > 1)
    assert 2 <= sum(spread) <= 18


def test_a_loss_is_calibrated_and_as_wide_as_it_says():
    """Normal: noise of sd s makes intervals sqrt(1 + s^2) as wide; truths rank uniformly among the draws."""
    assert caught.noise_of("normal", 0.2) == pytest.approx(np.sqrt(np.exp(0.4) - 1), abs=0.01)
    pool, x = caught.faulty("loss", 0.2, "normal", np.random.default_rng(2))
    draws = pool[:, 1:, 0]
    assert draws.std(axis=1).mean() == pytest.approx(np.exp(0.2), rel=0.01)
    rank = (draws < pool[:, :1, 0]).sum(axis=1)
    assert stats.kstest((rank + 0.5) / 101, "uniform").pvalue > 1e-3
    # And the datum says more: the truth is as near to it as an exact posterior's.
    assert (pool[:, 0] - x).std() == pytest.approx(1.0, abs=4 / np.sqrt(2000))
    exact, x = caught.pools("normal", np.random.default_rng(3))
    assert (exact[:, 1:] - x[:, None]).std() == pytest.approx(1.0, rel=0.01)
    assert x.std() == pytest.approx(3.0, abs=12 / np.sqrt(2000))


def test_what_a_pilot_states_is_put_in_and_counted(monkeypatch):
    """Each kind by its own gate, in trials of their own; a size that would not be caught is not to be had."""
    asked, seeds = [], []

    class Control:
        def __init__(self, kind):
            self.kind, self.size, self.caught = kind, 0.1 * len(kind), kind != "region"

    class Gate:
        def __init__(self, name, outcome):
            self.id, self.outcome = name, outcome

    class Verdict:
        controls = tuple(Control(kind) for kind in caught.GATES)
        gates = tuple(
            Gate(name, Outcome.PASS if name == "informed.rank" else Outcome.FAIL)
            for name in caught.GATES.values()
        )

    def faulty(kind, size, shape, rng):
        asked.append((kind, size, shape))
        return rng.normal(size=2), None

    monkeypatch.setattr(caught, "faulty", faulty)
    monkeypatch.setattr(
        caught, "judged", lambda pool, x, seed: seeds.append((float(pool.ravel()[0]), seed)) or Verdict()
    )
    found = caught.once("normal", 7)
    assert asked == [(kind, pytest.approx(0.1 * len(kind)), "normal") for kind in caught.GATES]
    assert {kind: found[kind] for kind in ("bias", "width", "loss")} == {
        "bias": 1.0,
        "width": 1.0,
        "loss": 0.0,
    }
    assert np.isnan(found["region"])
    assert len({first for first, _ in seeds}) == 5
    assert [seed for _, seed in seeds] == [7, 8, 8, 8, 8]
    assert set(caught.SHOWN) <= set(SHAPES)


def test_one_replicate_of_few_trials(monkeypatch):
    """The real thing: all four kinds are stated, and a bias that is caught in nine of ten FAILs."""
    monkeypatch.setattr(caught, "TRIALS", 600)
    found = caught.once("normal", 3)
    assert set(found) == set(caught.GATES)
    assert found["bias"] == found["width"] == 1.0


def test_what_was_measured_is_on_the_page():
    """Of what is said to be caught nine times in ten at least two thirds are, of every kind and shape."""
    table, page = read(RESULTS / "caught.nc"), (DOCS / "validators.md").read_text(encoding="utf-8")
    assert f"{int(table['replicates'].max())} replicates of each" in page
    for case in caught.SHOWN:
        assert f"| {case} |" in page
        for kind in ("bias", "width", "loss"):
            cell = table.sel(case=case, thing=kind)
            assert int(cell["replicates"]) >= 60
            assert float(cell["rate"]) > 2 / 3
