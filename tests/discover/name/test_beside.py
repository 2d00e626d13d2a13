"""What an effect keeps beside every other shape, and beside a smooth continuum."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from gaugeblock.discovery import Candidates, Sources
from gaugeblock.discovery.counts import Counts
from gaugeblock.discovery.engine import Comparison, Round
from gaugeblock.discovery.fitting import Fit
from gaugeblock.discovery.name.beside import Part, effect_part, loses
from gaugeblock.discovery.name.shapes import Templates
from gaugeblock.simulators import Uniform
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.library import LibraryEffect

THETA = np.array([200_000.0, 1.5])


@pytest.fixture(scope="module")
def library(power_law):
    return Candidates.of(power_law(), THETA[None])


def beside(library, effect, key):
    """What the named effect loses its significance beside, and the fit of it, on noise-free counts."""
    mean = library.simulator.with_effect(effect).expected(THETA[None])
    sources = Sources.of(library.simulator, np.round(mean))
    engine = Counts(sources, rng=np.random.default_rng(1), replicates=399, proposed=library)
    (model,) = engine.fitted(engine.look(), [key], None)
    made = [Round(engine.look(), (Comparison(model, 0.0, 0.0),))]
    return engine.lost(made)[0], model, mean, engine


def test_a_bright_narrow_line_stands_beside_everything(library):
    # No dip within its prior does so much, and no free continuum is as narrow.
    lost, model, mean, engine = beside(library, Effect("line", {"energy": 3.3, "counts": 60_000.0}), "line")
    assert lost == ()
    part = effect_part(model, 0)
    assert part.change == pytest.approx(mean[0] - engine.simulator.expected(THETA[None])[0], abs=40.0)
    assert part.rest.jacobian.shape[-1] == 2
    low, high = engine.place(model, 0)
    assert low < 3.3 < high
    assert 0.2 < high - low < 0.6


def test_a_faint_line_is_lost_beside_a_dip_of_its_shape(library):
    lost, *_ = beside(library, Effect("line", {"energy": 3.3, "counts": 1_500.0}), "line")
    assert "dip" in lost


CHANNELS = np.linspace(-1.0, 1.0, 40)


def bump(place, width=0.3):
    return np.exp(-0.5 * ((CHANNELS - place) / width) ** 2)


def named(name, low, high, neutral, scanned=(0.0,)):
    return LibraryEffect(
        name=name, parameters={"at": Uniform(-1.0, 1.0), "size": Uniform(low, high)}, amplitude="size",
        neutral=neutral, step=0.01, scanned={"at": scanned}, cause="", typical="",
    )  # fmt: skip


def z_beside(part, counts, column=None, low=-np.inf, high=np.inf, curves=()):
    """z of the effect's own size in a bounded least-squares fit of everything at once."""
    mean = part.rest.expected[0]
    columns = [*part.rest.jacobian[0].T, part.change, *curves]
    bounds = [(-np.inf, np.inf)] * len(columns)
    if column is not None:
        columns, bounds = [*columns, column], [*bounds, (low, high)]
    design = np.array(columns).T / np.sqrt(mean)[:, None]
    found = lsq_linear(design, (counts - mean) / np.sqrt(mean), np.array(bounds).T, tol=1e-14)
    # What stands at a bound is as if it were not fitted.
    free = found.active_mask == 0
    at = part.rest.jacobian.shape[-1]
    error = np.sqrt(np.linalg.inv(design[:, free].T @ design[:, free])[at, at])
    return (1.0 + found.x[at]) / error


def test_what_is_lost_is_what_a_bounded_fit_of_both_says():
    """Lines, faint and bright, beside broad bumps, some of them stopped at a bound, and a continuum."""
    rng = np.random.default_rng(4)
    entries = {
        "own": named("own", 0.0, 99.0, 0.0), "near": named("near", -0.9, 0.9, 0.0, (0.3, -0.5)),
        "stopped": named("stopped", 0.9, 1.5, 1.0), "kept": named("kept", -0.9, 0.9, 0.0),
    }  # fmt: skip
    owner, places = np.array(["own", "near", "near", "stopped", "kept"]), (0.0, 0.3, -0.5, 0.1, 0.0)
    lost = {"near": 0, "stopped": 0, "unnamed": 0}
    for _ in range(150):
        base = 20.0 * np.exp(rng.uniform(-0.5, 0.5) * CHANNELS)
        shapes = np.array([base * bump(place, rng.uniform(0.3, 0.6)) for place in places])
        change = rng.uniform(6.0, 26.0) * bump(0.0, 0.2)
        mean = base + change
        jacobian = np.stack([base, base * CHANNELS], axis=-1)
        rest = Fit(np.zeros((1, 2)), mean[None], jacobian[None], np.zeros(2), *np.zeros((2, 1)), np.ones(1))
        part, counts = Part("own", change, rest), rng.poisson(mean)
        smooth = np.stack([CHANNELS**2, CHANNELS**3], axis=-1)
        templates = Templates(shapes[None], owner, np.zeros(5, dtype=int), np.zeros(5, dtype=int))
        found = loses(part, counts, templates, entries, smooth, kept=frozenset({"kept"}))
        expected = []
        for key in ("near", "stopped"):
            low, high = (end - entries[key].neutral for end in entries[key].support)
            z = []
            for shape in shapes[owner == key]:
                most = 0.5 / np.max(shape / mean)
                z.append(z_beside(part, counts, shape, max(low, -most), min(high, most)))
            expected += [key] if min(z) < 3.0 else []
        alone = z_beside(part, counts, curves=smooth.T * base)
        expected += ["unnamed"] if alone < 5.0 else []
        assert found == tuple(expected)
        for key in found:
            lost[key] += 1
    assert all(10 < number < 140 for number in lost.values()), lost
