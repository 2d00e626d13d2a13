"""Pages in real Chromium, judged by axe-core: no violation, in light and in dark, with all of it open."""

from __future__ import annotations

import pytest

from gaugeblock.reports import write_reports

pytestmark = pytest.mark.browser


@pytest.mark.parametrize(("kind", "room"), [("failing", "light"), ("failing", "dark"), ("passing", "dark")])
def test_no_violation(request, tmp_path, violations, kind, room):
    audit = request.getfixturevalue(kind)
    write_reports(audit.verdict, audit.findings, audit.trials, tmp_path, title="An audit")
    flags = ["--blink-settings=preferredColorScheme=0"] if room == "dark" else []
    assert violations(tmp_path / "report.html", *flags) == []


def test_violations_would_be_seen_and_there_are_no_others(undecided, tmp_path, violations):
    write_reports(undecided.verdict, undecided.findings, undecided.trials, tmp_path, title="An audit")
    page = tmp_path / "report.html"
    poor = '<p style="color:#bbb;background:#fff">pale</p><input type="text"><img src="data:,">'
    page.write_text(page.read_text().replace("</main>", f"{poor}</main>"))
    found = {name: (number, first) for name, number, first in violations(page)}
    assert {name: number for name, (number, _) in found.items()} == {
        "color-contrast": 1,
        "label": 1,
        "image-alt": 1,
    }
    assert "pale" in found["color-contrast"][1]
