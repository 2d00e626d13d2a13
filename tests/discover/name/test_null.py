"""The p of a search holds its level and uses it up, also where half of the channels are nearly empty."""

import numpy as np
import pytest
from scipy.stats import binom

from gaugeblock.discovery import Candidates, Sources
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.locate.windows import share_beyond
from gaugeblock.discovery.name.null import largest_null
from gaugeblock.discovery.name.score import allowed, scores
from gaugeblock.discovery.name.shapes import templates

NUMBER = 600


@pytest.mark.parametrize(("norm", "nearly_empty"), [(60.0, 30), (20_000.0, 0)])
def test_p_holds_its_level_and_uses_it_up(power_law, norm, nearly_empty):
    simulator, theta = power_law(), np.array([[norm, 2.5]])
    mean = simulator.expected(theta)
    assert np.sum(mean < 1.0) == nearly_empty
    sources = Sources.of(simulator, np.random.default_rng(41).poisson(np.repeat(mean, NUMBER, axis=0)))
    # Every data set is fitted exactly, its replicates to first order: as a search does it.
    fitted = fit(simulator, sources.counts, start=np.repeat(theta, NUMBER, axis=0))
    # Both may only go one way, so that the sides that an effect may take count too.
    candidates = Candidates.of(simulator, theta, only=("line", "edge"))
    found = templates(candidates, sources, fitted)
    tested = scores(sources.counts, fitted, found.values)
    largest = allowed(tested.z, found.sign).max(axis=1)
    p = np.empty(NUMBER)
    for i, rng in enumerate(np.random.default_rng(42).spawn(NUMBER)):
        null = largest_null(fitted.expected[i], tested.shape[i], found.sign, replicates=199, rng=rng)
        p[i] = share_beyond(null, largest[i])
    for level in (0.01, 0.05, 0.2):
        low, high = binom.ppf([0.001, 0.999], NUMBER, level)
        assert low <= np.sum(p <= level) <= high, f"{np.sum(p <= level)} at {level}"
