"""The real page in a real browser: headless Chromium, where there is one."""

from __future__ import annotations

import re
import struct
import zlib
from pathlib import Path

import pytest

from gaugeblock.reports import write_reports

pytestmark = pytest.mark.browser


@pytest.fixture
def page(audit, tmp_path: Path) -> Path:
    write_reports(audit.verdict, audit.findings, audit.trials, tmp_path / "out", title="An audit")
    return tmp_path / "out" / "report.html"


def test_it_renders_with_the_verdict_and_without_complaints(audit, page, chromium):
    visit = chromium(page, "--dump-dom")
    assert re.search(
        rf'<div class="word">.*?<span>{audit.verdict.outcome.value}</span>', visit.dom, flags=re.DOTALL
    )
    assert visit.dom.rstrip().endswith("</html>")
    assert visit.complaints == []


def test_a_complaint_would_be_seen_and_a_script_would_not_run(page, chromium):
    page.write_text(page.read_text().replace("</body>", "<script>document.title = 'ran'</script></body>"))
    visit = chromium(page, "--dump-dom")
    assert "<title>ran</title>" not in visit.dom
    assert any("Content Security Policy" in line for line in visit.complaints)


@pytest.mark.parametrize("width", [1200, 500])
def test_every_picture_has_a_size_nothing_overflows_and_nothing_is_fetched(page, chromium, probed, width):
    measured = chromium(probed(page), "--dump-dom", f"--window-size={width},900").measured
    assert measured["width"] == width
    assert measured["content"] <= width, "the page scrolls sideways"
    assert len(measured["boxes"]) > 10
    assert [box for box in measured["boxes"] if not (box[1] > 5 and box[2] > 5)] == []
    charts = [box for box in measured["boxes"] if box[0] == "chart"]
    assert charts
    assert min(box[1] for box in charts) > 200, "a chart too small to be read"
    assert measured["cutOff"] == []
    assert measured["onEachOther"] == []
    assert measured["fetched"] == []
    assert measured["wordTop"] < 250
    assert measured["wordSize"] > 30


def test_a_phone_s_width_does_not_overflow(page, chromium, probed, tmp_path):
    # Chromium's window is never narrower than 500 pixels; a frame can be.
    holder = tmp_path / "out" / "phone.html"
    probed(page)
    text = (tmp_path / "out" / "probed.html").read_text().replace("</script>", PASS_ON + "</script>")
    (tmp_path / "out" / "inner.html").write_text(text)
    holder.write_text(HOLDER)
    measured = chromium(holder, "--dump-dom", "--window-size=800,900").measured
    assert measured["width"] == 390
    assert measured["content"] <= 390, "the page scrolls sideways"
    assert min(box[1] for box in measured["boxes"] if box[0] == "chart") > 200
    assert measured["cutOff"] == []
    assert measured["onEachOther"] == []


def test_labels_on_each_other_would_be_seen(page, chromium, probed):
    label = '<svg class="chart" width="90" height="20"><text y="12">one</text><text y="14">two</text></svg>'
    page.write_text(page.read_text().replace("</main>", f"{label}</main>"))
    assert chromium(probed(page), "--dump-dom").measured["onEachOther"] == [["two", "one"]]


PASS_ON = """
addEventListener("load", () => parent.postMessage(document.getElementById("measured").textContent, "*"));
"""
HOLDER = """<!DOCTYPE html><title>phone</title><body style="margin:0">
<script>addEventListener("message", message => {
  const place = document.createElement("pre");
  place.id = "measured"; place.textContent = message.data; document.body.append(place);
});</script>
<iframe src="inner.html" style="width:390px;height:800px;border:0"></iframe></body>"""


def test_dark_rooms_get_a_dark_page(passing, tmp_path, chromium, probed):
    write_reports(passing.verdict, passing.findings, passing.trials, tmp_path, title="An audit")
    copy = probed(tmp_path / "report.html")
    light = chromium(copy, "--dump-dom").measured["ground"]
    dark = chromium(copy, "--dump-dom", "--blink-settings=preferredColorScheme=0").measured["ground"]
    brightness = [sum(map(int, re.findall(r"\d+", colour)[:3])) for colour in (light, dark)]
    assert brightness[0] > 600
    assert brightness[1] < 150


def inked(png: bytes) -> float:
    """Share of a PNG's bytes that differ from their neighbours: row filters turn sameness into zeros."""
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    data, place = b"", 8
    while place < len(png):
        (length,) = struct.unpack(">I", png[place : place + 4])
        if png[place + 4 : place + 8] == b"IDAT":
            data += png[place + 8 : place + 8 + length]
        place += 12 + length
    pixels = zlib.decompress(data)
    return 1 - pixels.count(0) / len(pixels)


def test_the_screenshot_is_not_blank(page, chromium, tmp_path):
    (tmp_path / "blank.html").write_text(
        "<!DOCTYPE html><title>blank</title><body style='background:#f4f4f1'>"
    )
    shares = []
    for name, address in (("page.png", page), ("blank.png", tmp_path / "blank.html")):
        chromium(address, f"--screenshot={tmp_path / name}", "--window-size=1200,1600")
        shares.append(inked((tmp_path / name).read_bytes()))
    assert shares[0] > 0.01
    assert shares[1] < 0.005


@pytest.mark.parametrize("kind", ["failing", "undecided"])
def test_it_prints_on_four_pages(request, chromium, tmp_path, kind):
    audit = request.getfixturevalue(kind)
    write_reports(audit.verdict, audit.findings, audit.trials, tmp_path, title="An audit")
    page = tmp_path / "report.html"
    chromium(page, f"--print-to-pdf={tmp_path / 'page.pdf'}", "--no-pdf-header-footer")
    pages = re.findall(rb"/Type\s*/Page\b", (tmp_path / "page.pdf").read_bytes())
    assert 1 <= len(pages) <= 4


@pytest.mark.parametrize(("picked", "shown"), [("0", {"1", "2"}), ("2", {"2"})])
def test_a_picked_parameter_hides_the_others(page, chromium, picked, shown):
    said = """<script>addEventListener("load", () => {
      document.getElementById("pick-PICKED").checked = true;
      document.querySelectorAll("details").forEach(fold => { fold.open = true; });
      const seen = [...document.querySelectorAll("[data-p]")].filter(one => one.offsetParent !== null);
      const place = document.createElement("pre");
      place.id = "measured"; place.textContent = JSON.stringify([...new Set(seen.map(one => one.dataset.p))]);
      document.body.append(place);
    });</script>""".replace("PICKED", picked)
    policy = r'<meta http-equiv="Content-Security-Policy"[^>]*>'
    page.write_text(re.sub(policy, lambda _: said, page.read_text()))
    assert set(chromium(page, "--dump-dom").measured) == shown
