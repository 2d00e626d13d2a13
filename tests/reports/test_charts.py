import re
from dataclasses import replace
from xml.etree import ElementTree as tree

import numpy as np
import pytest

from gaugeblock.reports.charts import curve_with_band, forest, gate_bar, histogram, scatter
from gaugeblock.reports.pictures import Curve, Histogram, Intervals, farthest
from gaugeblock.reports.svg import Frame, round_ticks, tag

NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


def elements(picture: str, class_: str) -> list[tree.Element]:
    return [e for e in tree.fromstring(str(picture)).iter() if e.get("class") == class_]


def box(picture: str, class_: str) -> tuple[float, float]:
    (found,) = elements(picture, class_)
    start = float(found.get("x", ""))
    return start, start + float(found.get("width", ""))


def bar(statistic, half, *, tolerance=0.1, sense="two-sided", half_pass=None):
    inner = half / 2 if half_pass is None else half_pass
    picture = gate_bar(
        statistic, (statistic - half, statistic + half), (statistic - inner, statistic + inner),
        tolerance, sense, key="k", name="n",
    )  # fmt: skip
    assert picture is not None
    return picture


def test_a_gate_inside_its_tolerance_is_drawn_inside_the_shaded_range():
    picture = bar(0.02, 0.05)
    low, high = box(picture, "tolerated")
    for mark in ("whisker", "box"):
        start, end = box(picture, mark)
        assert low < start < end < high


def test_a_gate_outside_its_tolerance_is_drawn_outside():
    picture = bar(-0.2, 0.03)
    assert box(picture, "whisker")[1] < box(picture, "tolerated")[0]


def test_an_estimate_beyond_the_frame_becomes_an_arrow_head():
    assert [e.tag for e in elements(bar(5.0, 0.1), "dot")] == ["path"]
    assert [e.tag for e in elements(bar(0.0, 0.1), "dot")] == ["circle"]


def test_at_least_and_at_most_shade_opposite_sides():
    at_least, at_most = (
        bar(0.8, 0.05, sense="at-least", tolerance=0.3),
        bar(0.8, 0.05, sense="at-most", tolerance=0.3),
    )
    assert box(at_least, "tolerated")[0] == pytest.approx(box(at_most, "tolerated")[1], abs=0.2)
    assert box(at_least, "tolerated")[0] < box(at_least, "box")[0]
    assert box(at_most, "tolerated")[1] < box(at_most, "box")[0]


def test_open_ends_reach_the_frame():
    picture = gate_bar(0.8, (0.7, float("inf")), (0.75, float("inf")), 0.1, "at-least", key="k", name="n")
    assert box(str(picture), "whisker")[1] == box(str(picture), "tolerated")[1]


@pytest.mark.parametrize(("statistic", "tolerance"), [(float("nan"), 0.1), (0.1, float("nan")), (1.0, 0.0)])
def test_without_an_estimate_or_a_scale_there_is_no_bar(statistic, tolerance):
    assert gate_bar(statistic, (0, 1), (0, 1), tolerance, "two-sided", key="k", name="n") is None


def curve(y, *, failed=False):
    x = np.linspace(0, 1, len(y))
    shown = Curve(name="n", x=x, y=y, low=-np.ones_like(y), high=np.ones_like(y), x_label="x", y_label="y")
    return curve_with_band(shown, key="k", name="n", failed=failed)


def test_a_curve_that_leaves_its_band_is_said_and_drawn_to_do_so():
    inside, outside = curve(np.zeros(50)), curve(np.r_[np.zeros(25), 2 * np.ones(25)])
    assert "inside its band everywhere" in inside
    assert "outside its band at 25 points" in outside
    assert elements(inside, "line")
    assert elements(outside, "line noticed"), "red is what FAILs, and nothing else"
    assert elements(curve(np.r_[np.zeros(25), 2 * np.ones(25)], failed=True), "line astray")


def test_a_pointer_over_a_curve_is_told_its_numbers():
    tips = re.findall(r'class="tip">([^<]*)<', curve(np.linspace(0, 0.5, 50)))
    assert len(tips) == 24
    assert tips[0] == "rank 0.00: 0.000"
    assert tips[-1] == "rank 1.00: +0.500"


def test_a_forest_is_red_where_an_interval_is_wholly_outside():
    shown = Intervals(
        name="f", rows=("in", "near", "out"), estimate=np.array([0.0, 0.15, 0.5]),
        low=np.array([-0.05, 0.05, 0.4]), high=np.array([0.05, 0.25, 0.6]), x_label="bias",
        tolerated=(-0.1, 0.1),
    )  # fmt: skip
    drawn = forest(shown, key="f", failed=True)
    assert len(elements(drawn, "line")) == 2
    assert len(elements(drawn, "line astray")) == 1
    assert "out: 0.5 (0.4 to 0.6)" in drawn
    assert farthest(shown, 2).rows == ("near", "out")
    assert farthest(replace(shown, estimate=np.array([-0.9, 0.15, 0.5])), 1).rows == ("in",)


def test_a_long_curve_is_thinned_but_still_said_right():
    y = np.zeros(20_001)
    y[7777] = 2.0
    picture = curve(y)
    assert len(picture) < 30_000
    assert "outside its band at 1 point." in picture, "thinning must not hide the one point outside"


def test_every_coordinate_lies_in_the_frame_and_is_finite():
    rng = np.random.default_rng(0)
    error = rng.normal(size=3000) * 3
    picture = scatter(
        np.linspace(0, 1, 3000), error, key="k", name="n", x_label="x", y_label="y", x_ticks={0.5: "half"}
    )
    (dots,) = elements(picture, "dots")
    places = re.findall(r"M([-\d.]+) ([-\d.]+)h0", dots.get("d", ""))
    assert len(places) == 800
    assert all(0 <= float(a) <= 320 and 0 <= float(b) <= 210 for a, b in places)
    assert "nan" not in picture


def test_a_histogram_counts_every_finite_value():
    values = np.array([0.2] * 30 + [0.9] * 10 + [np.nan])
    shown = Histogram(name="n", values=values, marks={"median": 0.2}, x_label="x", range=(0, 1))
    picture = histogram(shown, key="k")
    (bars,) = elements(picture, "bar")
    tops = [float(v) for v in re.findall(r"V([\d.]+)H", bars.get("d", ""))]
    heights = sorted((192 - top for top in tops), reverse=True)
    assert heights[0] / heights[1] == pytest.approx(3, rel=0.01)
    assert max(heights[2:]) < 0.1
    assert "over 40 trials" in picture


def test_few_trials_make_a_scatter_without_running_lines():
    picture = scatter(
        [0.1, 0.9], [0.0, 1.0], key="k", name="n", x_label="x", y_label="y", x_ticks={0.5: "half"}
    )
    assert not elements(picture, "quantile")


def test_pictures_carry_title_and_description_for_screen_readers():
    root = tree.fromstring(str(curve(np.zeros(5))))
    ids = (root.get("aria-labelledby") or "").split()
    assert root.get("role") == "img"
    assert [child.get("id") for child in root[:2]] == ids
    assert all(child.text for child in root[:2])


def test_text_and_attributes_are_escaped():
    picture = tag("text", "<b>", x='"><script>')
    assert tree.fromstring(str(picture)).get("x") == '"><script>'
    assert "<b>" not in picture


@pytest.mark.parametrize(
    ("low", "high"), [(0, 1), (-0.031, 0.031), (-3, 17), (1e-9, 3e-9), (-5e7, 5e7), (0, 0)]
)
def test_ticks_are_few_inside_and_evenly_spaced(low, high):
    ticks = round_ticks(low, high)
    assert 1 <= len(ticks) <= 8
    assert all(low - 1e-12 <= tick <= high + 1e-12 for tick in ticks)
    if len(ticks) > 2:
        np.testing.assert_allclose(np.diff(ticks), ticks[1] - ticks[0], rtol=1e-6)


def test_a_frame_maps_its_corners_to_its_corners():
    frame = Frame(x=(0, 10), y=(-1, 1), width=100, height=50, left=10, right=5, top=2, bottom=8)
    assert frame.across([0, 10, 99]).tolist() == [10, 95, 95]
    assert frame.down([-1, 1, -99]).tolist() == [42, 2, 42]
