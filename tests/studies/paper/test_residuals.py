"""Residuals at equal counts, of evidences whose trend is known."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from studies.kit.resume import Pieces
from studies.paper.beyond import past_the_paper
from studies.paper.experiments import residuals
from studies.paper.experiments.residuals import CELLS, RUNS, pulls, residual, summaries

MANY = 300
LOWER = {"B1 medium": -70.0, "B1 bright": -900.0, "B4 medium": 2.0}
"""By how much, where the trend is straight, these cells' log evidences lie off it."""


def made(curve: float, noise: float = 3.0) -> xr.Dataset:
    """A row a spectrum, MANY a cell: -100 nats a decade, `curve` times the square of decades off 1,000."""
    rng, cells = np.random.default_rng(4), list(RUNS)
    cell, place = np.repeat(cells, MANY), np.tile(np.arange(MANY), len(cells))
    decade = {"faint": 2.0, "medium": 3.0, "bright": 4.0}
    total = np.array([decade[name.split()[1]] for name in cell]) + 0.3 * rng.normal(size=len(cell))
    lower = np.array([LOWER.get(name, 0.0) for name in cell])
    exact = 50 - 100 * total + curve * (total - 3) ** 2 + lower + noise * rng.normal(size=len(cell))
    error = np.full(len(cell), 0.2)
    nested = np.where(place < [RUNS[name] for name in cell], exact + 0.2 * rng.normal(size=len(cell)), np.nan)
    return xr.Dataset(
        {
            "cell": ("spectrum", cell),
            "counts": ("spectrum", np.round(10**total)),
            "exact": ("spectrum", exact),
            "nested": ("spectrum", nested),
            "nested_error": ("spectrum", np.where(np.isfinite(nested), error, np.nan)),
        }
    )


def test_residuals_of_a_straight_trend():
    found = summaries(made(0.0))
    assert tuple(found) == CELLS
    for cell, said in found.items():
        wanted = LOWER.get(cell, 0.0)
        assert said["runs"] == RUNS[cell]
        assert said["spectra"] == MANY
        assert said["all"] == pytest.approx(wanted, abs=4 * said["all_error"])
        # Noise of 3 nats in the mean of so many, and in the line through three times as many.
        assert said["all_error"] == pytest.approx(3 / np.sqrt(MANY) * 1.15, rel=0.25)
        assert said["nested"] == pytest.approx(said["same"], abs=0.6)
        assert said["low"] < said["nested"] < said["high"]
        assert said["nested"] == pytest.approx(wanted, abs=4 * 3 / np.sqrt(RUNS[cell]))
        assert said["few_low"] < wanted < said["few_high"]
        # Of a mean of 4 to 16, and of a line through 56.
        width = 2 * 1.96 * 3 * np.sqrt(1 / RUNS[cell] + 1 / 56)
        assert said["few_high"] - said["few_low"] == pytest.approx(width, rel=0.2)


def test_a_curved_trend_is_seen_as_a_residual_of_clean_spectra_and_of_any_other():
    """In the middle, below the line through a trend that is curved upwards: by hand, of many."""
    table = made(20.0)
    rng = np.random.default_rng(1)
    clean = np.array([str(name).startswith("clean") for name in table["cell"].values])
    x, y = np.log10(table["counts"].values), table["exact"].values
    line = np.polyfit(x[clean], y[clean], 1)
    for cell in ("clean medium", "B4 medium", "B1 bright"):
        mine = table["cell"].values == cell
        wanted = (y[mine] - np.polyval(line, x[mine])).mean()
        assert residual(table, cell, "exact", rng).residual == pytest.approx(wanted)
    found = summaries(table)
    assert found["clean medium"]["all"] < -8
    assert found["B4 medium"]["all"] - found["clean medium"]["all"] == pytest.approx(2.0, abs=1.5)


def test_the_first_spectra_of_each_cell_are_the_runs(tmp_path, xray_data, monkeypatch):
    """Evidences that say which spectrum they are of, in place of half an hour of sampling."""
    from gaugeblock.simulators.xray import published

    monkeypatch.setattr(
        residuals,
        "run_nested",
        lambda simulator, counts, live, rng: {
            "log_evidence": -counts.sum() - simulator.exposure,
            "error": 0.1,
        },
    )
    monkeypatch.setattr(
        residuals,
        "exact_posteriors",
        lambda simulator, counts, scale, **_: SimpleNamespace(
            log_evidence=-counts.sum(axis=1), effective=scale
        ),
    )
    runs = dict.fromkeys(RUNS, 1) | {"clean medium": 3, "B4 medium": 0}
    table = residuals.run({"runs": runs, "spectra": 4, "live": 50}, Pieces(tmp_path, {}), 3)
    known = np.isfinite(table["nested"].values).reshape(len(runs), 4)
    wanted = [[k < number for k in range(4)] for number in runs.values()]
    assert known.tolist() == wanted
    np.testing.assert_array_equal(table["exact"], -table["counts"])
    seconds = published.EXPOSURES["epic-pn"]
    level = [name.split()[1] for name in table["cell"].values]
    scale = np.array([seconds[name] / seconds["bright"] for name in level])
    np.testing.assert_allclose(table["effective"], scale)
    own = (-table["counts"].values - [seconds[name] for name in level])[known.ravel()]
    np.testing.assert_allclose(table["nested"].values[known.ravel()], own)
    assert len(set(table["counts"].values)) > 20  # no cell has the sources of another


def test_pulls_are_of_runs_alone():
    table = made(0.0)
    known = np.isfinite(table["nested"].values)
    table["nested_error"] = table["nested_error"] / xr.where(table["cell"].str.endswith("bright"), 2.0, 1.0)
    found = pulls(table)
    assert {level: len(of) for level, of in found.items()} == {"faint": 25, "medium": 26, "bright": 25}
    assert known.sum() == sum(RUNS.values()) == 76
    assert found["medium"].std() == pytest.approx(1.0, abs=0.4)
    assert found["bright"].std() == pytest.approx(2.0, abs=0.8)


def test_what_the_page_says_of_them():
    table = made(20.0)
    table["effective"] = xr.full_like(table["exact"], 200.0)
    said = summaries(table)
    text = "\n".join(past_the_paper({"residuals": table}))
    assert "76 runs of nested sampling" in text
    of_medium = pulls(table)["medium"]
    assert f" {np.sqrt(np.mean(of_medium**2)):.1f} (medium)" in text
    own = np.sqrt(np.nanmean(1 / (table["effective"] * table["nested_error"] ** 2)))
    assert f"own error is {own:.1f}:" in text
    (row,) = (line for line in text.splitlines() if line.startswith("| B1 medium"))
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    of = said["B1 medium"]
    assert cells[1:] == [
        "-67",
        f"{of['nested']:+.0f} ({of['low']:+.0f} to {of['high']:+.0f}), 6",
        f"{of['same']:+.0f}",
        f"{of['all']:+.1f} ± {of['all_error']:.1f}",
        f"{of['few_low']:+.0f} to {of['few_high']:+.0f}",
    ]
    (row,) = (line for line in text.splitlines() if line.startswith("| clean bright"))
    assert row.split("|")[2].strip() == ""
    left = said["B4 medium"]["all"] - said["clean medium"]["all"]
    assert f"gain {said['B4 medium']['all']:+.1f}:\n{left:+.1f} ± " in text
    assert "spectra have +13." in text
    assert f"{said['B1 medium']['all']:+.0f} and {said['B1 bright']['all']:+.0f} nats" in text
