"""Lines put together: by one factor, by what is at rest beside them, by multiples; never by chance."""

import numpy as np
import pytest

from gaugeblock.discovery.name.shifted import Measured, harmonics, shifted, together
from gaugeblock.simulators.library import Known
from gaugeblock.simulators.xray.library.known import absorption_lines, emission_lines

BAND, REACH = (0.5, 10.0), 0.0165
KNOWN = emission_lines("EPN")
REST = {one.name: one.energy for one in KNOWN}
SILICON = ("Si XIII resonance line", "Si XIV Lyman alpha", "S XV resonance line")
GOLD = "Au M alpha of the detector"


def line(energy, error=0.002, known=KNOWN, stretch=1.0, band=BAND):
    return Measured(energy, error, known, band, stretch)


@pytest.mark.parametrize("redshift", [0.0, 0.05])
def test_lines_off_by_one_factor_are_named_and_gain_or_motion_both_stay(redshift):
    stretch = 1.0 + redshift
    lines = [line(1.006 * REST[name] / stretch, stretch=stretch) for name in SILICON]
    chosen, said = shifted(lines, REACH)
    assert chosen == (0, 1, 2)
    assert tuple(one.name for one in said.lines) == SILICON
    assert said.low < 1.006 < said.high
    assert said.high - said.low < 0.004
    assert said.chance <= 0.01
    assert said.causes == ("gain", "motion")
    away = [1000.0 * 0.006 * REST[name] / stretch for name in SILICON]
    assert [one.shift_ev for one in said.lines] == pytest.approx(away)


def test_what_is_at_rest_in_the_detector_tells_them_apart():
    moving = [line(1.012 * REST[name]) for name in SILICON]
    for factor, cause in ((1.0, "motion"), (1.012, "gain")):
        _, said = shifted([*moving, line(factor * REST[GOLD])], REACH)
        assert said.causes == (cause,)
        assert said.lines[-1].frame == "detector"
        assert said.low < 1.012 < said.high


def test_a_factor_beyond_reach_names_nothing():
    assert shifted([line(1.05 * REST[name]) for name in SILICON], REACH) is None


def test_lines_of_nothing_are_put_together_in_one_of_a_hundred():
    rng = np.random.default_rng(8)
    named = [
        shifted([line(energy, 0.005) for energy in rng.uniform(0.6, 9.9, size=2 + i % 2)], REACH)
        for i in range(40)
    ]
    # Binomial: with 1% more than three of forty is one case in a thousand.
    assert sum(one is not None for one in named) <= 3


def test_one_known_line_is_not_two():
    known = (Known("a", 3.0, 0), Known("b", 8.0, 1))
    assert shifted([line(3.0, known=known), line(3.003, known=known)], REACH) is None


def test_the_factor_is_that_of_what_it_moves_by_its_errors():
    known = (Known("a", 2.0, 0), Known("b", 4.0, 0), Known("c", 6.0, 0, frame="detector"))
    lines = [line(2.02, 0.002, known), line(4.08, 0.2, known), line(6.0, 0.001, known)]
    said = together(lines, known, ("motion",), 0.001)
    assert said.factor == pytest.approx(1.01, abs=3e-4)
    assert together(lines, known, ("gain",), 0.001).factor == pytest.approx(1.003, abs=3e-3)
    error = (said.high - said.low) / (2 * 1.645)
    assert error == pytest.approx(np.hypot(0.002, 1e-3 * 2.02) / 2.0, rel=0.02)


def test_harmonics_are_multiples_of_one_energy():
    known, band = absorption_lines(), (3.0, 79.0)
    fundamental, multiples, chance = harmonics(
        [line(25.02, 0.1, known, band=band), line(50.0, 0.1, known, band=band)]
    )
    assert multiples == (1, 2)
    assert fundamental == pytest.approx(25.01, abs=0.02)
    assert chance <= 0.01
    three = harmonics([line(energy, 0.1, known, band=band) for energy in (36.0, 12.0, 24.05)])
    assert three[1] == (3, 1, 2)
    # By chance one of a hundred is as near.
    assert harmonics([line(25.0, 0.1, known, band=band), line(47.0, 0.1, known, band=band)]) is None
    assert harmonics([line(25.0, 0.1, known, band=band)]) is None
    drawn = np.random.default_rng(4).uniform(*band, size=(150, 2))
    named = [harmonics([line(energy, 0.1, known, band=band) for energy in pair]) for pair in drawn]
    assert sum(one is not None for one in named) <= 6
