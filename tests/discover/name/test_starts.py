"""Where fits of an effect begin, on scores made by hand."""

from dataclasses import replace

import numpy as np

from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.library import Candidate
from gaugeblock.discovery.name.profiles import starts
from gaugeblock.discovery.name.score import ScoreTests
from gaugeblock.discovery.name.shapes import Templates
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators import Uniform

THETA = np.array([[2000.0, 1.5], [900.0, 2.0], [500.0, 1.0]])


def begun(power_law, z, *, two_sided=True, step=0.1, redshift=0.0):
    """Starts of a dip by z at eight energies, of which one unit of amplitude is worth two."""
    simulator = power_law()
    low, high = (-0.9, 2.0) if two_sided else (0.0, 2.0) if step > 0 else (-0.9, 0.0)
    entry = replace(
        simulator.effect_library(THETA)["dip"],
        parameters={"energy": Uniform(0.6, 7.5), "depth": Uniform(low, high)},
        step=step, scanned={"energy": np.arange(1.0, 7.9, 0.8)}, energies=("energy",),
    )  # fmt: skip
    sources = Sources.of(simulator, np.ones((1, 60)), redshift=redshift)
    base = fit(simulator, np.round(simulator.expected(THETA[:1])), start=THETA[:1])
    size = len(entry.nodes)
    z = np.concatenate([[9.0], z, np.zeros(size - len(z))])[None]
    tested = ScoreTests(2.0 * z, np.full(z.shape, 4.0), z, 0.0 * z, None)
    owner = np.array(["line"] + ["dip"] * size)
    sign = np.full(1 + size, 0 if two_sided else int(np.sign(step)))
    found = Templates(None, owner, np.arange(-1, size), sign)
    candidate = Candidate("dip", entry, simulator.with_effect(entry.effect()))
    made = starts(candidate, sources, base, found, tested)
    np.testing.assert_array_equal(made[0, :, :2], np.tile(base.theta, (made.shape[1], 1)))
    return [tuple(one) for one in made[0, :, 2:].round(6).tolist()]


def test_fits_begin_at_the_three_best_peaks_a_step_along_the_score(power_law):
    z = [1.0, 0.5, -3.0, -2.9, 0.1, 1.5, 0.2, 0.6]
    assert begun(power_law, z) == [(2.6, -0.899997), (5.0, 0.75), (1.0, 0.5)]
    # Of one source they are those of its band, whatever its redshift.
    assert begun(power_law, z, redshift=1.0) == begun(power_law, z)
    # Two that are alike are both peaks.
    assert begun(power_law, [0.2, 1.0, 1.0, 0.2])[:2] == [(1.8, 0.5), (2.6, 0.5)]


def test_no_fit_begins_at_neutral_or_on_the_side_that_is_not_allowed(power_law):
    assert begun(power_law, [0.001, 0.0])[0] == (1.0, 0.005)
    assert begun(power_law, [-0.001, 0.0])[0] == (1.0, -0.005)
    assert begun(power_law, [0.001, 0.0], step=-0.1)[0] == (1.0, 0.005)
    assert begun(power_law, [-3.0, 1.0, -2.0], two_sided=False)[0] == (1.8, 0.5)
    assert begun(power_law, [3.0, -1.0, 2.0], two_sided=False, step=-0.1)[0] == (1.8, -0.5)
    all_wrong = begun(power_law, [-1.0] * 9, two_sided=False)
    assert {amplitude for _, amplitude in all_wrong} == {0.005}
