"""Templates by hand: what a typical amplitude of each effect changes in each source."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.library import Candidates
from gaugeblock.discovery.name.shapes import templates
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators import Uniform

THETA = np.array([[2000.0, 1.5], [900.0, 2.0], [500.0, 1.0]])


@pytest.mark.parametrize("number", [1, 3])
def test_templates_are_what_a_typical_amplitude_changes_at_energies_as_each_source_shows_them(
    power_law, number
):
    simulator = power_law()
    scale, redshift = np.array([1.0, 2.0, 0.5])[:number], np.array([0.5, 0.0, 1.0])[:number]
    sources = Sources.of(simulator, np.ones((number, 60)), scale=scale, redshift=redshift)
    entries = simulator.effect_library(THETA)
    entries["edge"] = replace(
        entries["edge"], parameters={"energy": Uniform(0.6, 7.5), "depth": Uniform(-3.0, 0.0)}, step=-0.1
    )
    plain = simulator.expected(THETA[:number]) * scale[:, None]
    base = replace(
        fit(simulator, plain, scale=scale, start=THETA[:number]), theta=THETA[:number], expected=plain
    )
    found = templates(Candidates(simulator, entries), sources, base)
    assert found.owner.tolist() == ["line"] * 36 + ["dip"] * 36 + ["edge"] * 36
    assert found.node.tolist() == [*range(36)] * 3
    assert found.sign.tolist() == [1] * 36 + [0] * 36 + [-1] * 36
    energies = np.geomspace(0.7, 7.0, 36)
    at, width = np.sqrt(sources.edges.prod(axis=1)), np.diff(sources.edges, axis=1)[:, 0]
    for i in range(number):
        for k in (0, 17, 35):
            shown = energies[k] / (1.0 + redshift[i] * (number > 1))
            line = scale[i] * width * np.exp(-0.5 * ((at - shown) / 0.15) ** 2)
            np.testing.assert_allclose(found.values[i, k], line, rtol=1e-6, atol=1e-9)
            # Of the instrument, so at one energy for all.
            dip = plain[i] * np.exp(-0.5 * ((at - energies[k]) / 0.4) ** 2)
            np.testing.assert_allclose(found.values[i, 36 + k], dip, rtol=1e-6, atol=1e-9)
            edge = plain[i] * np.where(energies[k] < at, np.expm1(0.1) / -0.1, 0.0)
            np.testing.assert_allclose(found.values[i, 72 + k], edge, rtol=1e-6, atol=1e-9)
