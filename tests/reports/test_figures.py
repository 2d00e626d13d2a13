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


def test_the_section_shows_a_map_per_parameter(findings):
    section = local_section(findings, 0.21)
    assert section is not None
    assert section.wide
    assert [panel.heading for panel in section.panels] == ["a", "b"]
    assert "p < 0.01" in section.what or "p = 0.00" in section.what
    assert "a tree over 9 features" in section.what


def test_the_worst_region_is_deepest_named_and_outlined(findings):
    panel = local_section(findings, 0.21).panels[1]
    deep = [line for line in panel.picture.split("<g>") if 'fill-opacity="0.75"' in line]
    assert deep
    assert "gap +0." in deep[-1]
    assert "the lower half, worst where" in panel.remark
    assert 'class="worst"' in panel.picture
    assert "Outlined: " in panel.picture


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
