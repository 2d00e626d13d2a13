from __future__ import annotations

import numpy as np
import pytest
from scipy import special

from gaugeblock.reports.figures import joint_section, local_section, sections
from gaugeblock.reports.pictures import rank_tolerance
from gaugeblock.validate import make_trials, run_validators


@pytest.fixture(scope="module")
def findings():
    """Two parameters, data that tell where the posterior is; `b` lies too high for bright data."""
    rng = np.random.default_rng(1)
    x = rng.normal(size=(1200, 2)) + [0.0, 10.0]
    truth = x + rng.normal(size=x.shape)
    draws = x[:, None] + rng.normal(size=(1200, 40, 2))
    draws[x[:, 1] > 10.5, :, 1] += 1.0
    return run_validators(make_trials(truth, draws, ["a", "b"], x=x), seed=1, select=["local"])[0]


def gates_of(audit):
    return {gate.id: gate for gate in audit.verdict.gates}


def test_the_section_shows_a_map_per_parameter(findings):
    section = local_section(findings, {})
    assert section is not None
    assert section.wide
    assert [panel.heading for panel in section.panels] == ["a", "b"]
    assert "p < 0.01" in section.what or "p = 0.00" in section.what
    assert "a tree over 9 features" in section.what


def test_the_worst_region_is_deepest_named_and_outlined(findings):
    panel = local_section(findings, {}).panels[1]
    deep = [line for line in panel.picture.split("<g>") if 'fill-opacity="0.75"' in line]
    assert deep
    assert "gap +0." in deep[-1]
    assert "the lower half, worst where" in panel.remark
    assert 'class="worst"' in panel.picture
    assert "Outlined: " in panel.picture


def test_no_local_findings_make_no_section():
    assert local_section([], {}) is None


def test_every_joint_region_has_its_panel(passing):
    section = joint_section(passing.findings, gates_of(passing))
    assert section is not None
    assert [panel.heading for panel in section.panels] == ["Balls around references"]
    assert "regions hold" in section.panels[0].remark
    assert "p = " in section.panels[0].remark


def test_posteriors_too_narrow_leave_the_band(failing):
    panel = joint_section(failing.findings, gates_of(failing)).panels[0]
    assert 'class="line astray"' in panel.picture


def test_every_rank_and_coverage_plot_draws_what_is_tolerated(passing, failing):
    for audit in (passing, failing):
        shown = {section.anchor: section for section in sections(audit.verdict, audit.findings, None)}
        for anchor in ("ranks", "coverage", "joint"):
            for panel in shown[anchor].panels:
                assert panel.picture.count('class="tolerance"') == 2, (anchor, panel.heading)


def test_edges_of_tolerance_are_where_faults_of_that_size_put_ranks():
    """Against draws of normal posteriors with that bias, and with that width."""
    rng = np.random.default_rng(3)
    at = np.array([0.1, 0.3, 0.5, 0.8])
    biased = special.ndtr(rng.normal(size=400_000) - 0.2)
    wide = special.ndtr(rng.normal(size=400_000) * np.exp(-0.1))
    off = [np.abs((ranks[:, None] <= at).mean(0) - at) for ranks in (biased, wide)]
    np.testing.assert_allclose(rank_tolerance(at, 0.2, 0.0), off[0], atol=0.004)
    np.testing.assert_allclose(rank_tolerance(at, 0.0, 0.1)[[0, 1, 3]], off[1][[0, 1, 3]], atol=0.006)
    assert (rank_tolerance(at, 0.2, 0.1) >= rank_tolerance(at, 0.2, 0.0)).all()


def test_no_joint_findings_make_no_section():
    assert joint_section([], {}) is None
