"""What an effect keeps beside every other shape, and beside a smooth continuum."""

import numpy as np
import pytest

from gaugeblock.discovery import Candidates, Sources
from gaugeblock.discovery.counts import Counts
from gaugeblock.discovery.engine import Comparison, Round
from gaugeblock.discovery.name.beside import effect_part
from gaugeblock.simulators.effects import Effect

THETA = np.array([200_000.0, 1.5])


@pytest.fixture(scope="module")
def library(power_law):
    return Candidates.of(power_law(), THETA[None])


def beside(library, effect, key):
    """What the named effect loses its significance beside, and the fit of it, on noise-free counts."""
    mean = library.simulator.with_effect(effect).expected(THETA[None])
    sources = Sources.of(library.simulator, np.round(mean))
    engine = Counts(sources, rng=np.random.default_rng(1), replicates=99, proposed=library)
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
