"""The workflow on many sources that share an instrument."""

import numpy as np
import pytest

from gaugeblock.discover import Sources, discover_catalogue
from gaugeblock.simulators.effects import Effect


def catalogue(power_law, hidden, *, number=60, seed=1, counts=10_000.0):
    rng = np.random.default_rng(seed)
    plain = power_law()
    true = plain if hidden is None else plain.with_effect(hidden)
    theta = np.stack([counts * np.exp(rng.uniform(-1, 1, number)), rng.uniform(0.5, 2.5, number)], axis=1)
    return Sources.of(plain, true.simulate(theta, rng), redshift=rng.uniform(0.0, 2.0, number))


@pytest.fixture(scope="module")
def dip(power_law):
    """Sixty sources behind an area that is 12% too small around 1.7 keV."""
    return discover_catalogue(
        [catalogue(power_law, Effect("dip", {"energy": 1.7, "depth": -0.12}))], replicates=199
    )


def test_names_what_all_sources_share(dip):
    assert dip.named == "dip"
    gap = dip.summary["gap"]["held_out"]
    assert gap["after"] < gap["before"]
    low, high = dip.summary["amplitude"][0]["interval"]
    assert low < -0.12 < high or abs(dip.summary["amplitude"][0]["value"] + 0.12) < 0.02
    assert dip.candidate("dip")["z"] > 5


def test_says_that_it_stays_with_the_detector(dip):
    assert dip.summary["catalogue"]["fixed_to"] == "detector"
    assert dip.tree["catalogue"]["influence"].shape == (60,)


def test_an_error_of_the_amplitude_that_falls_with_the_number(dip):
    error = dip.tree["catalogue"]["amplitude_error"].values
    assert np.all(np.diff(error) <= 0)


def test_nothing_shared_is_nothing_named(power_law):
    # p <= 0.01 is asked for: three or more of twenty would happen in 0.1%.
    named = [
        discover_catalogue([catalogue(power_law, None, number=20, seed=seed)], replicates=199).named
        for seed in range(20)
    ]
    assert sum(name is not None for name in named) < 3


def test_the_same_seed_gives_the_same_answer(power_law, dip):
    again = discover_catalogue(
        [catalogue(power_law, Effect("dip", {"energy": 1.7, "depth": -0.12}))], replicates=199
    )
    assert again.summary == dip.summary
