"""The page of a discovery in a real browser: headless Chromium, where there is one."""

import re

import pytest

from gaugeblock.reports.discovery import discovery_html

pytestmark = pytest.mark.browser


@pytest.fixture
def page(catalogue, summary, tmp_path):
    path = tmp_path / "report.html"
    path.write_text(discovery_html(catalogue, summary))
    return path


@pytest.mark.parametrize("width", [1200, 500])
def test_every_picture_has_a_size_nothing_overflows_and_nothing_is_fetched(page, chromium, probed, width):
    measured = chromium(probed(page), "--dump-dom", f"--window-size={width},900").measured
    assert measured["content"] <= width, "the page scrolls sideways"
    charts = [box for box in measured["boxes"] if box[0] == "chart"]
    assert len(charts) >= 10
    assert min(box[1] for box in charts) > 200, "a chart too small to be read"
    assert [box for box in measured["boxes"] if not (box[1] > 5 and box[2] > 5)] == []
    assert measured["cutOff"] == []
    assert measured["onEachOther"] == []
    assert measured["fetched"] == []
    assert measured["wordTop"] < 250


def test_every_ending_renders_without_complaints(tree, ending, chromium, tmp_path):
    path = tmp_path / "report.html"
    path.write_text(discovery_html(tree, ending[1]))
    visit = chromium(path, "--dump-dom")
    assert visit.complaints == []
    assert re.search(r'<div class="word"><span>.+</span>', visit.dom)


def test_dark_rooms_get_a_dark_page(page, chromium, probed):
    copy = probed(page)
    light = chromium(copy, "--dump-dom").measured["ground"]
    dark = chromium(copy, "--dump-dom", "--blink-settings=preferredColorScheme=0").measured["ground"]
    brightness = [sum(map(int, re.findall(r"\d+", colour)[:3])) for colour in (light, dark)]
    assert brightness[0] > 600
    assert brightness[1] < 150


def test_nothing_keeps_anybody_from_reading_it(page, violations):
    assert violations(page) == []
