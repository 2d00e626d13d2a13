"""How many claims should be missed: exact laws, and simulated families of known tolerance."""

import numpy as np
import pytest
from scipy import stats
from studies.paper import Measured, claims, judge
from studies.paper.claim import claim_of
from studies.paper.family import family, miss_probability, number_law, shared_numbers


def claim(name, rules, **more):
    table = {"says": "s", "kind": "flow", "value": 1.0, "error": 0.1, "rules": rules, "by": "x", **more}
    return claim_of(name, "section", table)


def test_the_law_of_equal_events_is_binomial():
    law = number_law(np.full(30, 0.2))
    np.testing.assert_allclose(law, stats.binom.pmf(np.arange(31), 30, 0.2), atol=1e-12)


def test_a_tolerance_of_two_errors_of_a_difference_is_missed_in_one_case_of_22():
    # 20,000 replications: five standard errors are 0.0074.
    p = miss_probability(claim("a", [{"within": 2 * 2**0.5 * 0.1}]))
    assert p == pytest.approx(2 * stats.norm.sf(2), abs=0.0074)
    inequality = miss_probability(claim("b", [{"low": 0.9}]))
    assert inequality == pytest.approx(stats.norm.cdf(-0.1 / (0.1 * 2**0.5)), abs=0.018)


def test_a_cell_of_the_gain_varies_around_one_half():
    cell = claims()["grid.pn.faint.B4.1.D1"]
    assert cell.parts["value"] > 0.58
    assert miss_probability(cell) == pytest.approx(2 * stats.norm.sf(0.08 / 0.0354), abs=0.006)


def test_claims_without_an_error_have_no_rate():
    table = {"says": "s", "kind": "flow", "value": 1.0, "rules": [{"within": 1}], "by": "x"}
    assert np.isnan(miss_probability(claim_of("a", "section", table)))


def test_events_that_move_together_spread_more_and_average_the_same():
    p = np.full(60, 0.05)
    together, alone = shared_numbers(p, ["one"] * 60), shared_numbers(p, list(map(str, range(60))))
    # 4,000 families: five standard errors of a mean are 0.13 alone and some 0.3 together.
    assert alone.mean() == pytest.approx(3, abs=0.15)
    assert together.mean() == pytest.approx(3, abs=0.4)
    assert together.var() > 1.5 * alone.var()


@pytest.fixture(scope="module")
def cells():
    return [entry for entry in claims().values() if entry.id.startswith("grid.pn.medium.")]


def test_a_faithful_replication_misses_what_it_may(cells):
    """100 replications of 48 cells: the p-value is small as rarely as it says (5 sd of a binomial)."""
    rng = np.random.default_rng(5)
    small = 0
    for _ in range(100):
        drawn = [
            judge(cell, Measured(rng.normal(cell.known.get("value", cell.value), cell.error["value"] * 2**0.5
                  if not cell.known else cell.error["value"])))
            for cell in cells
        ]  # fmt: skip
        small += family(drawn).p_value <= 0.1
    assert small <= 10 + 5 * 3


def test_flows_that_see_the_gain_miss_too_much(cells):
    seen = [judge(cell, Measured(0.75 if cell.id.split(".")[3] == "B4" else cell.value)) for cell in cells]
    found = family(seen)
    assert (found.claims, found.misses) == (48, 12)
    assert found.expected < 3
    assert found.p_value < 1e-4
    assert found.p_shared < 0.01


def test_only_measured_claims_on_flows_are_counted(cells):
    exact = judge(claims()["ns.n"], Measured(76))
    assert family([exact, judge(cells[0], None)]) is None
