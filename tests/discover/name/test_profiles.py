"""Profiles at gross misfits: where a tangent leads astray, draws of the prior find the valley."""

import numpy as np
import pytest

pytest.importorskip("jaxspec")

from gaugeblock.discovery import Candidates, Sources
from gaugeblock.discovery.counts import Counts
from gaugeblock.discovery.engine import Thresholds, promising
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name import profiles
from gaugeblock.discovery.name.profiles import profile
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray import reference
from gaugeblock.simulators.xray.published import REFERENCE_PRIOR

COVERED = {"nh": 2.5, "fraction": 0.9}
NAMES = ("tbabs_1.nh", "powerlaw_1.alpha", "powerlaw_1.norm")
THETA = np.array([[0.26, 1.98, 1.1e-3]])


@pytest.fixture(scope="module")
def covered():
    """A power law seen by EPIC-pn for long, partly covered, and the look at what a bare one leaves."""
    prior = Prior({name: REFERENCE_PRIOR.marginals[name] for name in NAMES})
    model = reference("epic-pn", "bright", model="tbabs*powerlaw", prior=prior)
    hidden = model.with_effect(Effect("partial_covering", COVERED))
    scale = np.array([100.0])
    counts = np.random.default_rng(5).poisson(hidden.expected(THETA) * scale[:, None]).astype(float)
    sources = Sources.of(model, counts, scale=scale)
    library = Candidates.of(model, THETA, only=("partial_covering", "effective_area", "high_energy_cutoff"))
    engine = Counts(sources, rng=np.random.default_rng(6), replicates=399, proposed=library)
    return sources, engine.look()


def test_where_the_misfit_is_gross_fits_begin_at_draws_of_the_prior_too(covered, monkeypatch):
    # Whether the tangent alone leads into the right valley hangs on the path of a fit: it is not asked.
    tried = []
    monkeypatch.setattr(
        profiles, "fit", lambda *a, start, **k: tried.append(start.shape[1]) or fit(*a, start=start, **k)
    )
    sources, seen = covered
    at = seen.state
    candidate = at.candidates["partial_covering"]
    given = (candidate, sources, at.fit, at.templates, at.scores)
    truth = candidate.at(THETA, np.array(list(COVERED.values())))
    best = fit(candidate.simulator, sources.counts, scale=sources.scale, start=truth)
    most = float(at.fit.objective[0] - best.objective[0])
    profile(*given)
    assert profile(*given, far=True).gain == pytest.approx(most, abs=0.01)
    assert tried[1] == tried[0] + profiles.DRAWN


def test_a_gross_misfit_leaves_no_candidate_out(covered):
    _, seen = covered
    thresholds = Thresholds()
    assert seen.gross(thresholds)
    assert seen.z.max() ** 2 / 2 > thresholds.far
    assert set(promising(seen, thresholds, None)) == set(seen.entries)
