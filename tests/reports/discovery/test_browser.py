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


def test_every_picture_has_a_size_nothing_overflows_and_nothing_is_fetched(
    page, chromium, framed, brightness
):
    found = chromium(framed(page), "--dump-dom").measured
    for width in (1200, 500, 390):
        measured = found[str(width)]
        assert measured["width"] == width
        assert measured["content"] <= width, "the page scrolls sideways"
        charts = [box for box in measured["boxes"] if box[0] == "chart"]
        assert len(charts) >= 10
        assert min(box[1] for box in charts) > 200, "a chart too small to be read"
        assert [box for box in measured["boxes"] if not (box[1] > 5 and box[2] > 5)] == []
        assert measured["cutOff"] == []
        assert measured["onEachOther"] == []
        assert measured["fetched"] == []
        assert measured["wordTop"] < 250
        assert brightness(measured) > 600
    assert found["labels"]["onEachOther"] == [["two", "one"]]


def test_every_ending_renders_without_complaints(tree, endings, chromium, tmp_path):
    """In frames, beside one with a script that its policy forbids, which alone is complained of."""
    texts = {name: discovery_html(tree, summary) for name, summary in endings.items()}
    texts["scripted"] = texts["named"].replace("</body>", "<script>document.title = 'ran'</script></body>")
    for name, text in texts.items():
        assert re.search(r'<div class="word"><span>.+</span>', text)
        (tmp_path / f"{name}.html").write_text(text)
    holder = tmp_path / "holder.html"
    holder.write_text("<!DOCTYPE html>" + "".join(f'<iframe src="{name}.html"></iframe>' for name in texts))
    complaints = chromium(holder, "--dump-dom").complaints
    assert complaints
    assert [line for line in complaints if "scripted.html" not in line] == []


def test_dark_rooms_get_a_dark_page(page, chromium, probed, brightness):
    dark = chromium(probed(page), "--dump-dom", "--blink-settings=preferredColorScheme=0").measured
    assert brightness(dark) < 150


def test_nothing_keeps_anybody_from_reading_it(page, violations):
    assert violations(page) == []
