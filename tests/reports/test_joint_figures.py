from __future__ import annotations

from gaugeblock.reports.joint_figures import joint_section


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
