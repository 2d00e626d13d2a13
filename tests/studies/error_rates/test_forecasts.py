"""Forecasts of how many trials settle a gate: eight of ten futures settle in their ranges."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from studies.error_rates.forecasts import AFTER, BEFORE, EDGED, WITHIN, foretold, part
from studies.kit.results import RESULTS, read


@pytest.mark.parametrize("shape", ["normal", "ten parameters"])
def test_ranges_hold_eight_of_ten_futures(shape):
    """Of 150 audits; 99.9% limits on 0.76 to 0.9 of those whose end is known."""
    found = [foretold(shape)(seed) for seed in range(150)]
    held = np.array([values[WITHIN] for values in found])
    held = held[np.isfinite(held)]
    assert len(held) > 130
    assert stats.binom.ppf(0.001, len(held), 0.76) <= held.sum() <= stats.binom.ppf(0.999, len(held), 0.9)


def test_what_happened_is_one_of_three_things():
    for seed in range(20):
        values = foretold("normal")(seed)
        if np.isfinite(values[WITHIN]):
            assert values[WITHIN] + values[BEFORE] + values[AFTER] == 1


def test_the_committed_study_holds_what_the_page_says():
    table = read(RESULTS / "forecasts.nc")
    assert set(table["case"].values) == set(part().cases)
    assert (table["replicates"].sel(thing=EDGED) >= 1000).all()
    rate = table["rate"].sel(thing=WITHIN).values
    assert (rate > 0.76).all()
