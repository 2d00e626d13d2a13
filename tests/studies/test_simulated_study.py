"""The study of discovery by simulations alone, small: exact scores, tables, and what the page says."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy import special
from studies.kit.results import DOCS, RESULTS, read_groups
from studies.simulated import __main__ as study
from studies.simulated import series
from studies.simulated.cases import EPIDEMIC, HIDDEN, UNLISTED, plain, with_effect
from studies.simulated.document import (
    blocks,
    information_table,
    intervals_table,
    names_table,
    pulls,
    series_table,
    tables_in,
)
from studies.simulated.exact import NODES, REACH, exact_scores, projected
from studies.simulated.information import correlation, taught_by

from gaugeblock.discovery.simulated.model import Model
from gaugeblock.discovery.simulated.moment_fit import SimulatedFit
from gaugeblock.discovery.simulated.population import LearnedPopulation

STATE = np.array([0.4, -0.2, -1.0, -1.2, 0.1])


def log_marginal(x, simulator, tail, state):
    """Log probability of cases, theta integrated out on the study's grid; an effect's values behind it."""
    population = LearnedPopulation.of(EPIDEMIC.prior)
    line = np.linspace(-REACH, REACH, NODES)
    normal = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    theta = population.theta(state, normal)
    mean = simulator.expected(np.concatenate([theta, np.broadcast_to(tail, (len(theta), len(tail)))], axis=1))
    log = x @ np.log(mean).T - mean.sum(axis=1) - 0.5 * (normal**2).sum(axis=1)
    return special.logsumexp(log, axis=1)


@pytest.mark.parametrize(("name", "week"), [("contact_change", 5.0), ("missed_week", 3.0), ("mixing", None)])
def test_exact_scores_are_derivatives_of_the_log_marginal(name, week):
    entry = EPIDEMIC.effect_library(np.array([[0.4, 0.13]]))[name]
    node = next(n for n in entry.nodes if week is None or n[1] == week)
    model = Model.plain(EPIDEMIC, LearnedPopulation.of(EPIDEMIC.prior))
    fitted = SimulatedFit(model, STATE, np.eye(5), None, None, True)
    x = model.draw(STATE, 6, 1)
    exact, population = exact_scores(EPIDEMIC, fitted, {name: (entry, node)}, x)
    simulator, neutral = EPIDEMIC.with_effect(entry.effect()), node.copy()
    neutral[0] = entry.neutral
    step = 1e-4 * np.eye(len(node))[0]
    sides = [log_marginal(x, simulator, neutral + sign * step, STATE) for sign in (1, -1)]
    np.testing.assert_allclose(exact[name], (sides[0] - sides[1]) / 2e-4, rtol=1e-4, atol=1e-4)
    for k in range(5):
        # The grid moves with the population: what is integrated is the same to many digits.
        move = 1e-4 * np.eye(5)[k]
        sides = [log_marginal(x, EPIDEMIC, np.zeros(0), STATE + sign * move) for sign in (1, -1)]
        np.testing.assert_allclose(population[:, k], (sides[0] - sides[1]) / 2e-4, rtol=1e-3, atol=1e-3)


def test_what_is_projected_is_uncorrelated():
    rng = np.random.default_rng(1)
    others = rng.normal(size=(500, 3)) + 2.0
    score = others @ [1.0, 2.0, 3.0] + rng.normal(size=500)
    left = projected(score, others)
    np.testing.assert_allclose(left @ (others - others.mean(axis=0)), 0.0, atol=1e-8)
    assert 0.8 < left.std() < 1.2


def test_a_regression_finds_what_the_features_hold():
    rng = np.random.default_rng(4)
    rows = rng.normal(size=(4000, 3)) * [1.0, 5.0, 0.0] + 1.0
    targets = rows[:, :2] @ [[2.0, 1.0], [0.4, 0.0]] + [[0.0, 1.0]] * rng.normal(size=(4000, 1))
    weights = taught_by(rows, targets, np.ones(3))
    np.testing.assert_allclose(weights, [[2.0, 1.0], [0.4, 0.0], [0.0, 0.0]], atol=0.06)
    found = correlation(rows @ weights, targets) ** 2
    np.testing.assert_allclose(found, [1.0, 0.5], atol=0.05)


def said(named, alike, value, low, high, truth, kinds):
    """A table of searches ``(kind, catalogue)`` as the study keeps it."""
    columns = {"named": named, "alike": alike, "value": value, "low": low, "high": high, "truth": truth}
    return xr.Dataset(
        {name: (("kind", "catalogue"), np.array(values)) for name, values in columns.items()},
        coords={"kind": kinds},
    )


def test_tables_count_what_was_said():
    nan, words = np.nan, [["mixing", "waning", "unnamed", "", "waning"]]
    alike = [["mixing", "waning,mixing", "unnamed,mixing", "", "waning,unnamed"]]
    table = said(
        words, alike, [[0.5, 1.0, nan, nan, 1.0]], [[0.3, 0.0, nan, nan, 0.9]], [[0.7, 2.0, nan, nan, 1.1]],
        [[0.4] * 5], ["mixing"],
    )  # fmt: skip
    none = said([["", "waning"]], [["", "waning"]], *[[[nan, nan]]] * 4, ["nothing"])
    other = said([["unnamed", "waning"]], [["unnamed", "waning"]], *[[[nan, nan]]] * 4, ["a wave"])
    tables = {"names": table, "unlisted": other, "nothing": none, "intervals": table}
    rows = names_table(tables).splitlines()
    assert rows[2] == "| `mixing` | 5 | 1 | 2 | 0 | 1 | 1 |"
    assert rows[3] == "| not in the library: a wave | 2 |  |  | 1 | 0 | 1 |"
    assert rows[4] == "| nothing | 2 |  |  | 0 | 1 | 1 |"
    # The only one with the right name: 0.1 off where the interval's half is 1.645 errors.
    assert pulls(table) == (1, 1, pytest.approx(0.1 / (0.2 / 1.6449)), 0.0)
    assert "1 of 1" in intervals_table(tables)
    one = xr.Dataset(
        {"effect": ("score", ["a", "a", "b"]), "week": ("score", [4.0, 5.0, nan]),
         "share": (("catalogue", "score"), [[0.2, 0.6, 0.9], [0.4, 0.8, 0.7]]),
         "ceiling": (("catalogue", "score"), [[0.5, 0.9, 1.0]] * 2),
         "rare": (("catalogue", "score"), [[0.5, 0.1, 0.3]] * 2)},
        attrs={"simulations": 1000, "command": "python -m studies simulated"},
    )  # fmt: skip
    text = information_table(one)
    assert "| `a` | 5 | 0.70 (0.60, 0.80) | 0.30 to 0.70, median 0.50 | 0.90 | 0.10 |" in text
    assert "| `b` |  | 0.80 (0.90, 0.70) |  | 1.00 | 0.30 |" in text


def test_series_are_what_they_are_said_to_be():
    theta = np.broadcast_to([0.5, 0.1], (4000, 2))
    x = series.simulate(theta, np.random.default_rng(2))
    scatter = np.exp(0.1) / np.sqrt(1 - 0.5**2)
    np.testing.assert_allclose(x.std(axis=0), scatter, rtol=0.05)
    for lag in (1, 3):
        np.testing.assert_allclose((x[:, lag:] * x[:, :-lag]).mean(), scatter**2 * 0.5**lag, rtol=0.05)
    found = series.summaries(np.arange(80.0).reshape(2, 40))
    assert found.shape == (2, 11)
    assert found[0, :2].tolist() == [2.0, 7.0]
    assert found[0, 9] == pytest.approx(np.mean(np.arange(1, 40) * np.arange(39)))
    # The effect of this name is the step that is hidden.
    values = {"height": np.array([series.HEIGHT]), "at": np.array([series.AT])}
    moved = series.EFFECTS[0].kind(lambda *_: np.zeros((1, 40)), theta[:1], values, None)
    assert moved[0].tolist() == [0.0] * 20 + [series.HEIGHT] * 20


def test_the_table_of_series_counts_what_was_said():
    nan = np.nan
    table = said(
        [["step", "unnamed", ""], ["step", "step", "drift"]],
        [["step", "unnamed,step", ""], ["step", "step", "drift"]],
        [[0.8, nan, nan], [0.8, 0.5, 1.0]], [[0.7, nan, nan], [0.7, 0.4, 0.5]],
        [[0.9, nan, nan], [0.9, 0.6, 1.5]], [[0.8] * 3] * 2, ["raw", "own summaries"],
    )  # fmt: skip
    axes = ("kind", "catalogue")
    table = table.assign(first=(axes, [[0.5, 0.6, 0.7]] * 2), seconds=(axes, [[9.0] * 3] * 2))
    rows = series_table(table.assign_attrs(command="python -m studies simulated")).splitlines()
    assert rows[2] == "| raw | 3 | 1 | 1 | 0 | 1 | 0 | 1 of 1 | 0.60 (0.50 to 0.70) | 9 s |"
    assert rows[3] == "| own summaries | 3 | 2 | 0 | 0 | 0 | 1 | 1 of 2 | 0.60 (0.50 to 0.70) | 9 s |"


def test_what_is_hidden_is_in_the_cases():
    for name, ranges in HIDDEN.items():
        x, truth = with_effect(name, ranges, np.random.default_rng(2))
        entry = EPIDEMIC.effect_library(np.array([[0.4, 0.13]]))[name]
        low, high = ranges[entry.amplitude]
        assert low <= truth <= high
        assert x.shape == (200, 12)
    rng = np.random.default_rng(3)
    usual = plain(rng).mean(axis=0)
    factors = {name: draw(rng).mean(axis=0) / usual for name, draw in UNLISTED.items()}
    # 200 towns: weekly means are known to about 7%.
    alternate, wave, scatter = factors.values()
    assert alternate[::2].mean() / alternate[1::2].mean() == pytest.approx(1.12 / 0.88, rel=0.1)
    assert wave[1] / wave[4] == pytest.approx(1.143 / 0.857, rel=0.2)
    assert scatter.mean() == pytest.approx(1.0, abs=0.15)


@pytest.mark.slow
def test_small_all_of_it_makes_a_table(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(study, "HIDDEN", {"missed_week": HIDDEN["missed_week"]})
    monkeypatch.setattr(study, "UNLISTED", {next(iter(UNLISTED)): next(iter(UNLISTED.values()))})
    few = [
        "--information",
        "1",
        "--names",
        "1",
        "--nothing",
        "1",
        "--intervals",
        "2",
        "--simulations",
        "1000",
    ]
    assert study.main([*few, "--out", str(tmp_path), "--docs", str(tmp_path)]) == 0
    shown = capsys.readouterr().out
    assert "| `missed_week` | 1 |" in shown
    tables = read_groups(tmp_path / "simulated.nc")
    share = tables["information"]["share"].values
    assert share.shape == (1, 36)
    assert ((share >= 0) & (share <= 1)).all()
    assert np.median(share) > 0.4
    assert np.median(tables["information"]["ceiling"].values) > np.median(share)
    assert (tables["information"]["rare"].values > 0.01).all()
    assert tables["intervals"]["value"].shape == (1, 2)
    (tmp_path / "discover-simulated.md").write_text("<!-- names -->\n<!-- /names -->\n")
    assert study.main(["--report", "--out", str(tmp_path), "--docs", str(tmp_path)]) == 0
    assert names_table(tables) in (tmp_path / "discover-simulated.md").read_text()


def test_the_page_says_what_was_found():
    text = (DOCS / "discover-simulated.md").read_text(encoding="utf-8")
    made = blocks(tables_in(RESULTS))
    assert set(made) == {"information", "names", "intervals", "series"}
    for block in made.values():
        assert block in text
