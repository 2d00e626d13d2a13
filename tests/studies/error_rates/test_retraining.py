"""Retraining until PASS: the CI-sized twin of the study's part `retraining`."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from studies.error_rates.replicates import Values, seed_of
from studies.error_rates.retraining import Case, audited, replicate

NUMBER = 24


@pytest.fixture(scope="module", params=[False, True], ids=["same", "fresh"])
def tried(request: pytest.FixtureRequest) -> tuple[bool, list[Values]]:
    """Whether truths are fresh, and what some projects of 20 trainings on the edge found."""
    once = replicate(Case(fresh=request.param))
    return request.param, [once(seed_of("retraining", "test", index, seed=1)) for index in range(NUMBER)]


def limits(rate: float) -> tuple[float, float]:
    return stats.binom.ppf(5e-4, NUMBER, rate), stats.binom.ppf(1 - 5e-4, NUMBER, rate)


def test_one_audit_and_a_release_keep_the_rate(tried: tuple[bool, list[Values]]) -> None:
    for thing in ("any of 1", "released"):
        assert sum(values[thing] for values in tried[1]) <= limits(0.05)[1]


def test_fresh_truths_inflate_and_the_same_ones_repeat_themselves(tried: tuple[bool, list[Values]]) -> None:
    """Independent tries at 2 to 6% each (one gate on its edge: 5.5%), or the same try twenty times."""
    fresh, found = tried
    if fresh:
        passed = sum(values["any of 20"] for values in found)
        assert limits(1 - 0.98**20)[0] <= passed <= limits(1 - 0.94**20)[1]
        assert passed > sum(values["any of 5"] for values in found)
    else:
        assert all(values["any of 20"] == values["any of 1"] for values in found)


def test_the_bias_that_is_measured_is_the_one_that_is_there() -> None:
    """In half-widths: 4 standard errors of a median-like estimate at 20,000 trials are 0.05."""
    bias = np.array([-0.5, 0.0, 0.4])
    for case in (Case(fresh=True, trials=20_000), Case(fresh=False, own=0.3, trials=20_000)):
        passed, measured = audited(case, bias, np.random.default_rng(3), fresh=case.fresh)
        assert measured == pytest.approx(bias, abs=0.05)
        assert passed.tolist() == [False, True, False]


def test_trainings_differ_by_what_is_their_own() -> None:
    bias, rng = np.full(5, 0.1), np.random.default_rng(4)
    for own, fresh, differ in ((0.0, False, 1), (0.3, False, 5), (0.0, True, 5)):
        _, measured = audited(Case(fresh=fresh, own=own, trials=200), bias, rng, fresh=fresh)
        assert len(set(measured.tolist())) == differ
    far = replicate(Case(fresh=True, spread=50.0))
    assert not any(far(seed)["any of 20"] for seed in range(3))
