"""The real page in a real browser: headless Chromium, where there is one."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import struct
import subprocess
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from gaugeblock.reports import write_reports

pytestmark = pytest.mark.browser

FLAGS = [
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--disable-dev-shm-usage",
    "--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-extensions",
    "--hide-scrollbars", "--enable-logging=stderr", "--v=0", "--virtual-time-budget=2000",
]  # fmt: skip

# Measures the page and writes what it found into it; runs in a test's copy, from which the policy that
# forbids every script has been taken out.
PROBE = """<script>
addEventListener("load", () => {
  const boxes = [...document.querySelectorAll("svg")].map(svg => {
    const box = svg.getBoundingClientRect();
    return [svg.getAttribute("class") || "key", box.width, box.height];
  });
  const texts = [...document.querySelectorAll("svg.chart")].flatMap(svg => {
    const frame = svg.getBoundingClientRect();
    return [...svg.querySelectorAll("text")].filter(text => {
      const box = text.getBoundingClientRect();
      return box.left < frame.left - 1 || box.right > frame.right + 1 || box.bottom > frame.bottom + 1;
    }).map(text => text.textContent);
  });
  const word = document.querySelector(".verdict .word");
  const found = {
    boxes, cutOff: texts,
    width: innerWidth, content: document.documentElement.scrollWidth,
    fetched: performance.getEntriesByType("resource").map(entry => entry.name),
    wordSize: parseFloat(getComputedStyle(word).fontSize),
    wordTop: word.getBoundingClientRect().top,
    ground: getComputedStyle(document.body).backgroundColor,
  };
  const place = document.createElement("pre");
  place.id = "measured";
  place.textContent = JSON.stringify(found);
  document.body.append(place);
});
</script>"""


@dataclass(frozen=True)
class Visit:
    dom: str
    log: str

    @property
    def complaints(self) -> list[str]:
        """Lines of the page's console, errors and refusals included."""
        return [line for line in self.log.splitlines() if "CONSOLE" in line]

    @property
    def measured(self) -> dict:
        found = re.search(r'<pre id="measured">(.*?)</pre>', self.dom, flags=re.DOTALL)
        assert found, "the probe did not run"
        return json.loads(html.unescape(found.group(1)))


@pytest.fixture(scope="session")
def chromium(
    missing: Callable[[str], None], tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., Visit]:
    program = next(
        (p for p in map(shutil.which, ("chromium", "google-chrome", "chromium-browser")) if p), None
    )
    if program is None:
        missing("neither chromium nor google-chrome is on the PATH (Debian: apt-get install chromium)")
    profile = tmp_path_factory.mktemp("profile")

    def visit(page: Path, *flags: str) -> Visit:
        done = subprocess.run(
            [str(program), *FLAGS, f"--user-data-dir={profile}", *flags, page.as_uri()],
            capture_output=True, text=True, errors="replace", timeout=120, check=False,
            env={**os.environ, "LC_ALL": "C.UTF-8"},
        )  # fmt: skip
        return Visit(done.stdout, done.stderr)

    return visit


@pytest.fixture
def page(audit, tmp_path: Path) -> Path:
    write_reports(audit.verdict, audit.findings, audit.trials, tmp_path / "out", title="An audit")
    return tmp_path / "out" / "report.html"


def probed(page: Path) -> Path:
    text, taken = re.subn(r'<meta http-equiv="Content-Security-Policy"[^>]*>', PROBE, page.read_text())
    assert taken == 1
    copy = page.with_name("probed.html")
    copy.write_text(text)
    return copy


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
def test_every_picture_has_a_size_nothing_overflows_and_nothing_is_fetched(page, chromium, width):
    measured = chromium(probed(page), "--dump-dom", f"--window-size={width},900").measured
    assert measured["width"] == width
    assert measured["content"] <= width, "the page scrolls sideways"
    assert len(measured["boxes"]) > 10
    assert [box for box in measured["boxes"] if not (box[1] > 5 and box[2] > 5)] == []
    charts = [box for box in measured["boxes"] if box[0] == "chart"]
    assert charts
    assert min(box[1] for box in charts) > 200, "a chart too small to be read"
    assert measured["cutOff"] == []
    assert measured["fetched"] == []
    assert measured["wordTop"] < 250
    assert measured["wordSize"] > 30


def test_a_phone_s_width_does_not_overflow(page, chromium, tmp_path):
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


PASS_ON = """
addEventListener("load", () => parent.postMessage(document.getElementById("measured").textContent, "*"));
"""
HOLDER = """<!DOCTYPE html><title>phone</title><body style="margin:0">
<script>addEventListener("message", message => {
  const place = document.createElement("pre");
  place.id = "measured"; place.textContent = message.data; document.body.append(place);
});</script>
<iframe src="inner.html" style="width:390px;height:800px;border:0"></iframe></body>"""


def test_dark_rooms_get_a_dark_page(passing, tmp_path, chromium):
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
