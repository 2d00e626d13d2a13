"""Coverage deviations before and after recalibration: exact answers, floors and a repair."""

import numpy as np
import pytest
from studies.paper.calibration import LEVELS, deviation
from studies.paper.experiments.conformal import KINDS, claims_of, measured
from studies.paper.judge import Agreement, judge
from studies.paper.numbers import as_table, by_claim
from studies.paper.registry import claims


def test_levels_that_are_spread_evenly_deviate_by_nothing():
    even = (np.arange(2000)[:, None] + 0.5) / 2000
    assert float(deviation(even)) == pytest.approx(0.0, abs=6e-4)
    assert float(deviation(even, even)) == pytest.approx(0.0, abs=1e-3)


def test_truths_at_one_end_are_never_held():
    assert float(deviation(np.zeros((10, 3)))) == pytest.approx(np.mean(LEVELS))


def test_many_sets_at_once_are_the_same_as_one_by_one():
    rng = np.random.default_rng(0)
    level, other = rng.random((6, 50, 2)), rng.random((6, 40, 2))
    np.testing.assert_allclose(deviation(level), [deviation(one) for one in level])
    expected = [deviation(one, two) for one, two in zip(level, other, strict=True)]
    np.testing.assert_allclose(deviation(level, other), expected)


def test_recalibration_mends_narrow_posteriors_and_costs_good_ones():
    """The study's 0.0156 and 0.0220 are what uniform levels show with 400 spectra, calibrated or not."""
    rng = np.random.default_rng(1)
    level, other = rng.random((200, 400, 5)), rng.random((200, 400, 5))
    assert deviation(level).mean() == pytest.approx(0.0156, abs=0.0008)
    assert deviation(level, other).mean() == pytest.approx(0.0220, abs=0.0011)
    narrow, again = (rng.beta(0.4, 0.4, (400, 5)) for _ in range(2))
    assert deviation(narrow) > 0.08
    assert deviation(narrow, again) < 0.04


def replications(rng, bias, number):
    sd = np.full(number, 0.3) * rng.choice([0.5, 1.0], number)
    return [
        {"level": rng.random((number, 5)), "error": bias + sd * rng.normal(size=number), "sd": sd}
        for _ in range(2)
    ]


def estimates(found, calibration, rng):
    table = as_table(claims_of(found, calibration, rng))
    return by_claim(table), by_claim(table, "standard_error")


def test_a_bias_of_shifted_spectra_comes_out_with_its_error():
    rng = np.random.default_rng(2)
    found = {"gain": replications(rng, 0.1, 1000), "clean": replications(rng, 0.0, 1000)}
    assert tuple(found) == KINDS
    numbers, errors = estimates(found, 500, rng)
    for claim in ("cf.bias.prec", "cf.bias.unw"):
        error = errors[claim]["value"]
        assert numbers[claim]["value"] == pytest.approx(0.1, abs=4 * error)
        assert error < 0.016
    # Half of the spectra weigh four times the others.
    assert errors["cf.bias.prec"]["value"] < errors["cf.bias.unw"]["value"]
    assert numbers["cf.bias.unw"]["p"] < 0.001
    assert numbers["cf.bias.sigma"]["least"] <= numbers["cf.bias.sigma"]["most"]


def test_what_is_said_of_every_claim():
    rng = np.random.default_rng(4)
    table = as_table(claims_of({kind: replications(rng, 0.0, 800) for kind in KINDS}, 400, rng))
    said = measured(table)
    mine = {name: claim for name, claim in claims().items() if claim.by == "conformal"}
    assert set(said) == set(mine)
    assert not [name for name, claim in mine.items() if judge(claim, said[name]).verdict is Agreement.DIFFERS]


def test_no_bias_is_none():
    rng = np.random.default_rng(3)
    numbers, errors = estimates({kind: replications(rng, 0.0, 600) for kind in KINDS}, 300, rng)
    assert abs(numbers["cf.bias.unw"]["value"]) < 3 * errors["cf.bias.unw"]["value"]
    assert numbers["cf.bias.unw"]["p"] > 0.01
