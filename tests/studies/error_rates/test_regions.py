"""Exact posteriors in every region, and one that is not: twin of the part `regions`."""

from __future__ import annotations

import numpy as np
from scipy import stats
from studies.error_rates import regions
from studies.error_rates.replicates import run
from studies.informed.problems import EXACT, Made
from studies.kit.results import DOCS, RESULTS, read


def bright_half(rng, trials, draws):
    """Right on average, too wide where x is large and too narrow elsewhere."""
    x = rng.normal(size=(trials, 1))
    away = rng.normal(size=(trials, draws + 1, 1))
    away[:, 1:] *= np.where(x[:, :, None] > 0, 1.6, 0.6)
    return Made(x + away[:, 0], x[:, None] + away[:, 1:], x)


def test_half_of_the_data_wrong_fails_and_a_wide_tolerance_passes():
    wrong = regions.audited(bright_half, 1500, (0.21, 4.0), 1)
    assert {name for name, said in wrong.items() if said} == {"FAIL at 0.21", "PASS at 4"}
    exact = regions.audited(EXACT["counts"], 300, (0.01,), 1, draws=20)
    assert exact == {"PASS at 0.01": 0.0, "FAIL at 0.01": 0.0, "INCONCLUSIVE at 0.01": 1.0}


def test_the_tolerances_of_each_size_are_its_own(tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(
        regions,
        "audited",
        lambda *given: asked.append(given) or {f"PASS at {each:g}": 1.0 for each in given[2]},
    )
    part = regions.part()
    table = part.summarise(run(part, tmp_path, seed=3, replicates=2).values)
    assert len(part.cases) == 2 * len(EXACT) == len(asked) / 2
    assert {given[1:3] for given in asked} == {(4000, (0.21,)), (10_000, (0.15, 0.12))}
    assert {given[0] for given in asked} == set(EXACT.values())
    assert len({given[3] for given in asked}) == len(asked)
    counted = table["replicates"].sel(case=["counts, 4,000", "counts, 10,000"])
    assert counted.sel(thing=["PASS at 0.12", "PASS at 0.15", "PASS at 0.21"]).values.tolist() == [
        [0, 0, 2],
        [2, 2, 0],
    ]


def test_what_was_measured_is_on_the_page():
    """By the default policy no cell refutes nine PASSes of ten, nor 5% of FAILs: limits of 99.9%."""
    table, page = read(RESULTS / "regions.nc"), (DOCS / "error-rates.md").read_text(encoding="utf-8")
    number, counts = table["replicates"], table["count"]
    for case in table["case"].values.tolist():
        assert f"| {case} |" in page
    for trials, tolerances in regions.SIZES.items():
        cases = [f"{name}, {trials:,}" for name in EXACT]
        for tolerance in tolerances:
            of = number.sel(case=cases, thing=f"FAIL at {tolerance:g}").values
            assert (of >= 40).all()
            failed = counts.sel(case=cases, thing=f"FAIL at {tolerance:g}").values
            assert (failed <= stats.binom.ppf(0.999, of, 0.05)).all()
    by_default = counts.sel(case=[f"{name}, 4,000" for name in EXACT], thing="PASS at 0.21")
    assert (by_default >= stats.binom.ppf(0.001, int(number.max()), 0.9)).all()
