"""The real page in a real browser: headless Chromium, where there is one."""

from __future__ import annotations

import re
import struct
import zlib
from pathlib import Path

import pytest

from gaugeblock.reports import write_reports

pytestmark = pytest.mark.browser
POLICY = r'<meta http-equiv="Content-Security-Policy"[^>]*>'
PICKED = """<script>addEventListener("load", () => {
  document.getElementById("pick-NUMBER").checked = true;
  document.querySelectorAll("details").forEach(fold => { fold.open = true; });
  const seen = [...document.querySelectorAll("[data-p]")].filter(one => one.offsetParent !== null);
  const place = document.createElement("pre");
  place.id = "measured"; place.textContent = JSON.stringify([...new Set(seen.map(one => one.dataset.p))]);
  document.body.append(place);
});</script>"""


def written(audit, folder: Path) -> Path:
    write_reports(audit.verdict, audit.findings, audit.trials, folder, title="An audit")
    return folder / "report.html"


def test_it_renders_measures_well_at_every_width_and_hides_what_is_not_picked(
    audit, tmp_path, chromium, framed, brightness
):
    """One visit to the page as it is, one to frames of it that measure themselves."""
    page = written(audit, tmp_path / "out")
    visit = chromium(page, "--dump-dom")
    assert re.search(
        rf'<div class="word">.*?<span>{audit.verdict.outcome.value}</span>', visit.dom, flags=re.DOTALL
    )
    assert visit.dom.rstrip().endswith("</html>")
    assert visit.complaints == []
    picks = {
        f"pick{number}": re.sub(
            POLICY, lambda _, number=number: PICKED.replace("NUMBER", number), page.read_text()
        )
        for number in ("0", "2")
    }
    found = chromium(framed(page, **picks), "--dump-dom").measured
    for width in (1200, 500, 390):
        measured = found[str(width)]
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
        assert brightness(measured) > 600
    assert found["labels"]["onEachOther"] == [["two", "one"]]
    assert set(found["pick0"]) == {"1", "2"}
    assert set(found["pick2"]) == {"2"}


def test_a_complaint_would_be_seen_and_a_script_would_not_run(failing, tmp_path, chromium):
    page = written(failing, tmp_path)
    page.write_text(page.read_text().replace("</body>", "<script>document.title = 'ran'</script></body>"))
    visit = chromium(page, "--dump-dom")
    assert "<title>ran</title>" not in visit.dom
    assert any("Content Security Policy" in line for line in visit.complaints)


def test_dark_rooms_get_a_dark_page(passing, tmp_path, chromium, probed, brightness):
    copy = probed(written(passing, tmp_path))
    dark = chromium(copy, "--dump-dom", "--blink-settings=preferredColorScheme=0").measured
    assert brightness(dark) < 150


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


def test_the_screenshot_is_not_blank(failing, chromium, tmp_path):
    page = written(failing, tmp_path)
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
    page = written(request.getfixturevalue(kind), tmp_path)
    chromium(page, f"--print-to-pdf={tmp_path / 'page.pdf'}", "--no-pdf-header-footer")
    pages = re.findall(rb"/Type\s*/Page\b", (tmp_path / "page.pdf").read_bytes())
    assert 1 <= len(pages) <= 4
