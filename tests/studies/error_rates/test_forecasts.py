"""Forecasts of how many trials settle a gate: eight of ten futures settle in their ranges."""

from __future__ import annotations

import numpy as np
from scipy import stats
from studies.error_rates.forecasts import AFTER, BEFORE, EDGED, WITHIN, foretold, part
from studies.kit.results import RESULTS, read


def test_ranges_hold_eight_of_ten_futures():
    """Of 150 audits of two shapes; 99.9% limits on 0.76 to 0.9 of those whose end is known.

    The shape of ten parameters takes six times as long.
    """
    found = [foretold("normal")(seed) for seed in range(100)]
    found += [foretold("ten parameters")(seed) for seed in range(50)]
    known = [values for values in found if np.isfinite(values[WITHIN])]
    assert all(values[WITHIN] + values[BEFORE] + values[AFTER] == 1 for values in known)
    held, number = sum(values[WITHIN] for values in known), len(known)
    assert number > 130
    assert stats.binom.ppf(0.001, number, 0.76) <= held <= stats.binom.ppf(0.999, number, 0.9)


def test_the_committed_study_holds_what_the_page_says():
    table = read(RESULTS / "forecasts.nc")
    assert set(table["case"].values) == set(part().cases)
    assert (table["replicates"].sel(thing=EDGED) >= 1000).all()
    rate = table["rate"].sel(thing=WITHIN).values
    assert (rate > 0.76).all()
