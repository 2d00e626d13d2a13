"""Forecasts of how many trials settle a gate: eight of ten futures settle in their ranges."""

from __future__ import annotations

import numpy as np
from scipy import stats
from studies.error_rates.forecasts import AFTER, BEFORE, EDGED, ON_EDGE, WITHIN, foretold, part
from studies.kit.results import RESULTS, read


def test_ranges_hold_eight_of_ten_futures():
    """Of 120 audits of two shapes; 99.9% limits on 0.76 to 0.84 of those whose end is known."""
    found = [foretold("normal")(seed) for seed in range(80)]
    found += [foretold("ten parameters")(seed) for seed in range(40)]
    known = [values for values in found if np.isfinite(values[WITHIN])]
    assert all(values[WITHIN] + values[BEFORE] + values[AFTER] == 1 for values in known)
    held, number = sum(values[WITHIN] for values in known), len(known)
    assert number > 110
    assert stats.binom.ppf(0.001, number, 0.76) <= held <= stats.binom.ppf(0.999, number, 0.84)


def test_what_lies_on_the_edge_is_mostly_said_to():
    """Two of three INCONCLUSIVEs are within an error of it: fewer than 27 of 60 happen in 0.1%."""
    said = [foretold("normal", on_edge=True)(seed) for seed in range(60)]
    assert sum(values[EDGED] for values in said) >= 27
    assert all(np.isnan(values[WITHIN]) for values in said)


def test_the_committed_study_holds_what_the_page_says():
    table = read(RESULTS / "forecasts.nc")
    assert set(table["case"].values) == set(part().cases)
    assert (table["replicates"].sel(thing=EDGED) >= 1000).all()
    on_edge = [case for case in part().cases if case.endswith(ON_EDGE)]
    held = table["rate"].sel(thing=WITHIN).drop_sel(case=on_edge).values
    assert len(held) == 4
    assert ((held >= 0.76) & (held <= 0.84)).all()
    assert (table["replicates"].sel(thing=WITHIN).drop_sel(case=on_edge) >= 950).all()
    assert float(table["rate"].sel(thing=EDGED, case=f"normal{ON_EDGE}")) > 0.5
