from __future__ import annotations

import numpy as np
import pytest

from gaugeblock.reports.figures import joint_section, local_section
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


def test_the_section_shows_a_panel_for_the_parameters_and_one_per_feature(findings):
    section = local_section(findings, 0.1)
    assert section is not None
    assert section.wide
    headings = [panel.heading for panel in section.panels]
    assert headings[:2] == ["By each parameter's own posterior", "By total"]
    assert "p < 0.01" in section.what or "p = 0.00" in section.what


def test_the_worst_region_is_written_deepest_and_named_in_its_tooltip(findings):
    section = local_section(findings, 0.1)
    panel = next(panel for panel in section.panels if panel.heading == "By total")
    deep = [line for line in panel.picture.split("<g>") if 'fill-opacity="0.75"' in line]
    assert deep
    assert any("bias +" in line for line in deep)
    assert "total" in deep[-1]


def test_no_local_findings_make_no_section():
    assert local_section([], None) is None


def test_every_joint_region_has_its_panel(passing):
    section = joint_section(passing.findings)
    assert section is not None
    assert [panel.heading for panel in section.panels] == ["Balls around references"]
    assert "regions hold" in section.panels[0].remark
    assert "p = " in section.panels[0].remark


def test_posteriors_too_narrow_leave_the_band(failing):
    panel = joint_section(failing.findings).panels[0]
    assert 'class="line astray"' in panel.picture


def test_no_joint_findings_make_no_section():
    assert joint_section([]) is None
