"""Between scanned values: the likeliest place and amplitude, by the score on a grid as fine as one likes."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.library import Candidates
from gaugeblock.discovery.name.catalogue import Members
from gaugeblock.discovery.name.shared_refined import refined
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators import Effect

SCANNED = np.array([0.8, 1.4, 2.2, 2.6, 4.0])
SIZE, SEED = 12, 3


@pytest.fixture(scope="module", name="truth")
def truth_fixture():
    rng = np.random.default_rng(SEED)
    return np.column_stack([rng.uniform(2000, 9000, SIZE), rng.uniform(1.0, 2.5, SIZE)])


def catalogue(power_law, truth, hidden):
    """Two blocks of noise-free sources, the dip and the line at a few scanned energies."""
    plain = power_law()
    counts = np.round(plain.with_effect(hidden).expected(truth))
    groups = []
    for rows in (slice(0, 5), slice(5, None)):
        sources = Sources.of(plain, counts[rows])
        library = plain.effect_library(truth)
        entries = {name: replace(library[name], scanned={"energy": SCANNED}) for name in ("dip", "line")}
        found = fit(plain, sources.counts, start=truth[rows])
        groups.append(Members(sources, found, Candidates(plain, entries)))
    return groups


def scored(groups, energy, *, width, times):
    """z and amplitude of a bell at an energy, sources' own parameters off it; `times` the mean or counts."""
    score = information = 0.0
    for group in groups:
        edges = group.sources.edges
        middle = np.sqrt(edges.prod(axis=1))
        bell = np.exp(-0.5 * ((middle - energy) / width) ** 2)
        for counts, mean, own in zip(
            group.sources.counts, group.fit.expected, group.fit.jacobian, strict=True
        ):
            root = np.sqrt(mean)
            shape = bell * (root if times else np.diff(edges, axis=1)[:, 0] / root)
            own = own / root[:, None]
            unit = own / np.linalg.norm(own, axis=0)
            shape = shape - unit @ np.linalg.lstsq(unit, shape, rcond=None)[0]
            score += shape @ ((counts - mean) / root)
            information += shape @ shape
    return score / np.sqrt(information), score / information


@pytest.mark.parametrize("depth", [-0.06, 0.06])
def test_an_effect_of_either_sign_is_found_between_scanned_values(power_law, truth, depth):
    groups = catalogue(power_law, truth, Effect("dip", {"energy": 2.07, "depth": depth}))
    node = next(one for one in groups[0].candidates.entries["dip"].nodes if one[0] == 2.2)
    best, away = refined(groups, "dip", node)
    near = np.linspace(1.8, 2.6, 161)
    z, amplitude = np.array([scored(groups, at, width=0.4, times=True) for at in near]).T
    at = int(np.argmax(np.abs(z)))
    # Half a spacing to 2.6 is cut into halves, and these again.
    assert best[0] == pytest.approx(near[at], abs=0.2 / 2**2)
    assert away == pytest.approx(amplitude[at], rel=0.05)


def test_a_line_is_sought_as_emission(power_law, truth):
    groups = catalogue(power_law, truth, Effect("line", {"energy": 3.4, "counts": 60.0}))
    node = next(one for one in groups[0].candidates.entries["line"].nodes if one[0] == 4.0)
    best, away = refined(groups, "line", node)
    near = np.linspace(2.8, 4.7, 381)
    z, amplitude = np.array([scored(groups, at, width=0.15, times=False) for at in near]).T
    at = int(np.argmax(z))
    assert best[0] == pytest.approx(near[at], abs=0.7 / 2**3)
    assert away == pytest.approx(amplitude[at], rel=0.1)
    assert away > 0


def test_a_pass_that_gains_less_than_half_a_nat_is_the_last(power_law, truth):
    """Three of a bright line between scanned energies; two of one that stands where it is scanned."""
    for energy, counts, most in ((3.4, 900.0, 3), (4.0, 60.0, 2)):
        groups = catalogue(power_law, truth, Effect("line", {"energy": energy, "counts": counts}))
        passes = []

        def each(asked, *rows, passes=passes):
            passes.append(asked)
            return list(map(asked, *rows))

        node = next(one for one in groups[0].candidates.entries["line"].nodes if one[0] == 4.0)
        refined(groups, "line", node, each=each)
        assert len(passes) == most
