"""Very many trials: what they contribute is kept together, and what learns is shown the first of them."""

from dataclasses import replace

import numpy as np
import pytest

import gaugeblock as gb
from gaugeblock.auditing.config import as_policy
from gaugeblock.validate import contributions as module
from gaugeblock.validate import validators
from gaugeblock.validate.contributions import MANY, SUMS, contributions, of_several, together
from gaugeblock.validate.family import maxima
from gaugeblock.validate.finding import MeanFinding, QuantileFinding
from gaugeblock.validate.judging import judge
from gaugeblock.validate.quantiles import mean_error, quantile_finding

N = 130_003


@pytest.fixture(scope="module")
def influence():
    """Three components of N trials: correlated, skewed, and of ones and zeros."""
    rng = np.random.default_rng(1)
    first = rng.standard_normal(N)
    second = 0.6 * first + 0.8 * rng.exponential(size=N) - 0.8
    third = (rng.random(N) < 0.1) - 0.1
    found = np.stack([first, second, third])
    return found - found.mean(axis=1, keepdims=True)


def test_as_many_sums_as_are_kept(influence):
    made = of_several(influence)
    assert together(N) == 6
    assert made.shape == (3, -(-N // 6))
    assert SUMS / 2 < made.shape[1] <= SUMS
    assert of_several(influence[:, :MANY]) is not made
    np.testing.assert_array_equal(of_several(influence[:, :MANY]), influence[:, :MANY])


def test_sums_are_of_trials_in_a_row_in_a_unit_that_keeps_the_average(influence):
    raw = influence + 1.0
    made, size = of_several(raw), together(N)
    unit = made.shape[1] / N
    np.testing.assert_allclose(made[:, 0], raw[:, :size].sum(axis=1) * unit)
    np.testing.assert_allclose(made[:, 7_001], raw[:, 7_001 * size : 7_002 * size].sum(axis=1) * unit)
    np.testing.assert_allclose(made[:, -1], raw[:, -(N % size) :].sum(axis=1) * unit)
    np.testing.assert_allclose(made.mean(axis=1), raw.mean(axis=1), rtol=1e-12)


def test_pieces_do_not_matter(influence):
    asked = []

    def of(rows):
        asked.append(rows.stop - rows.start)
        return influence[:, rows]

    np.testing.assert_array_equal(contributions(N, of), of_several(influence))
    assert max(asked) <= module.CHUNK
    assert sum(asked) == N


def test_errors_and_correlations_stay(influence):
    """Of 21,668 sums: errors to 2%, correlations to 0.03, four standard errors; the critical value to 1%."""
    made = of_several(influence)
    np.testing.assert_allclose(
        mean_error(made, N), mean_error(influence), rtol=4 / np.sqrt(2 * made.shape[1])
    )
    np.testing.assert_allclose(np.corrcoef(made), np.corrcoef(influence), atol=4 / np.sqrt(made.shape[1]))
    level = int(0.99 * 40_000)
    assert maxima([made], seed=1)[level] == pytest.approx(maxima([influence], seed=1)[level], rel=0.01)


def test_quantiles_and_means_keep_as_many(influence):
    found = quantile_finding(
        influence[:1], [0.3], id="a", quantity="", claim="", null="", reference="", components=("a",)
    )  # fmt: skip
    assert isinstance(found, QuantileFinding)
    assert found.values.shape == (1, N)
    below = influence[0] <= found.estimate[0]
    np.testing.assert_allclose(found.influence[0], of_several((below - below.mean())[None])[0])
    mean = MeanFinding(
        id="b", quantity="", claim="", null="", reference="", n_trials=N, influence=influence[1:2],
        estimate=np.zeros(1), standard_error=np.ones(1),
    )  # fmt: skip
    assert mean.influence.shape == found.influence.shape
    assert replace(mean, claim="said again").influence is not mean.influence
    np.testing.assert_array_equal(replace(mean, claim="said again").influence, mean.influence)


@pytest.fixture(scope="module")
def trials():
    rng = np.random.default_rng(2)
    theta = rng.standard_normal((2400, 2))
    x = theta + rng.standard_normal(theta.shape)
    draws = x[:, None] / 2 + np.sqrt(0.5) * rng.standard_normal((2400, 40, 2))
    made = gb.make_trials(theta, draws, ["a", "b"], x=x)
    return made.assign_coords(trial=rng.permutation(2400))


def run(trials, names):
    return validators.run_validators(trials, seed=3, select=names)


def test_a_verdict_of_sums_is_that_of_trials(trials, monkeypatch):
    """Their bounds differ by what 400 sums leave unknown of a correlation, and of no estimate."""
    names = ["sbc", "coverage", "joint", "tails"]
    policy = as_policy("default")
    alone = run(trials, names)
    first = judge(*alone, policy, seed=1)
    monkeypatch.setattr(module, "MANY", 1000)
    monkeypatch.setattr(module, "SUMS", 400)
    summed = run(trials, names)
    second = judge(*summed, policy, seed=1)
    for one, other in zip(alone[0], summed[0], strict=True):
        np.testing.assert_array_equal(one.estimate, other.estimate)
        np.testing.assert_array_equal(one.standard_error, other.standard_error)
        if isinstance(one, MeanFinding):
            assert (one.influence.shape[1], other.influence.shape[1]) == (2400, 400)
    assert [gate.outcome for gate in first.gates] == [gate.outcome for gate in second.gates]
    for one, other in zip(first.gates, second.gates, strict=True):
        width = np.diff(one.interval)
        np.testing.assert_allclose(other.interval, one.interval, atol=0.08 * width.item())


def test_what_learns_is_shown_the_first_by_number(trials, monkeypatch):
    few = {name: replace(one, most=600) for name, one in validators.VALIDATORS.items() if one.most}
    monkeypatch.setattr(validators, "VALIDATORS", {**validators.VALIDATORS, **few})
    found, _ = run(trials, ["sbc", "local", "c2st", "informed"])
    first = trials.isel(trial=np.flatnonzero(trials["trial"].values < 600))
    monkeypatch.undo()
    whole, _ = run(trials, ["sbc"])
    short, _ = run(first, ["local", "c2st", "informed"])
    for one, other in zip(found, (*whole, *short), strict=True):
        assert one.id == other.id
        np.testing.assert_array_equal(one.estimate, other.estimate)
        if one.validator == "sbc":
            assert (one.n_trials, one.population) == (2400, "trials")
        else:
            assert one.n_trials == other.n_trials <= 600
            assert one.population == f"{other.population}, the first 600"
            assert any(said.startswith("the first 600 of 2,400 trials") for said in one.caveats)


def test_a_few_sums_by_hand(monkeypatch):
    """Of more than ten trials about five sums: of 13 in pieces of six (two sums each), one left over."""
    monkeypatch.setattr(module, "MANY", 10)
    monkeypatch.setattr(module, "SUMS", 5)
    monkeypatch.setattr(module, "CHUNK", 8)
    assert [together(n) for n in (10, 11, 15, 16)] == [1, 3, 3, 4]
    pieces = []

    def of(rows):
        pieces.append((rows.start, rows.stop))
        return np.arange(13.0)[None, rows]

    found = contributions(13, of)
    assert pieces == [(0, 6), (6, 12), (12, 13)]
    np.testing.assert_allclose(found, [np.array([0 + 1 + 2, 3 + 4 + 5, 6 + 7 + 8, 9 + 10 + 11, 12]) * 5 / 13])
