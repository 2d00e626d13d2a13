"""The calibration map is drawn as its numbers are: cells by share of trials, the outline around the worst."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.reports.calibration import calibration_picture
from gaugeblock.reports.pictures import CalibrationMap

MAP = CalibrationMap(
    name="a",
    x_label="x[3]",
    y_label="total",
    x_edge=np.array([0.0, 0.25, 1.0]),
    y_edge=np.array([0.0, 0.5, 1.0]),
    x_cut=np.array([1.7]),
    y_cut=np.array([200.0]),
    gap=np.array([[0.01, -0.2], [0.0, 0.1]]),
    counted=np.array([[0.02, -0.42], [0.0, 0.21]]),
    n=np.array([[100.0, 300.0], [0.0, 400.0]]),
    worst=np.array([[0.0, 1.0], [0.0, 0.2]]),
    region="x[3] > 1.7 and total <= 200",
    remark="",
)


def boxes(picture):
    return [
        {name: float(value) for name, value in re.findall(r'(x|y|width|height|fill-opacity)="([\d.]+)"', box)}
        for box in re.findall(r"<rect[^>]*>", picture)
    ]


def test_cells_are_as_wide_as_their_share_and_as_deep_as_their_gap():
    found = boxes(calibration_picture(MAP, limit=0.21, key="k"))
    assert found[1]["width"] == pytest.approx(3 * found[0]["width"], rel=0.01)
    assert [box["fill-opacity"] for box in found] == [0.07, 0.75, 0.0, 0.75]
    assert found[0]["y"] > found[2]["y"]  # small values are below


def test_the_outline_goes_around_the_worst_cell_alone():
    picture = calibration_picture(MAP, limit=0.21, key="k")
    box = boxes(picture)[1]
    path = re.search(r'<path d="([^"]*)" class="worst"', picture).group(1)
    sides = re.findall(r"M([\d.]+) ([\d.]+)([HV])([\d.]+)", path)
    assert len(sides) == 4
    for x, y, way, end in sides:
        along = {float(x), float(end)} if way == "H" else {float(y), float(end)}
        start, length = (box["x"], box["width"]) if way == "H" else (box["y"], box["height"])
        assert sorted(along) == pytest.approx([start, start + length], abs=0.15)


def test_thresholds_and_names_are_written_and_empty_cells_are_not():
    picture = calibration_picture(MAP, limit=0.21, key="k")
    for words in ("1.7", "200", "x[3]", "total", "\N{MINUS SIGN}0.20", "+0.10"):
        assert words in picture
    assert "0 trials: gap <" in picture
    assert "Outlined: x[3] &gt; 1.7 and total &lt;= 200." in picture


def test_one_feature_is_a_strip():
    strip = replace(
        MAP, y_label="", y_edge=np.array([0.0, 1.0]), y_cut=np.empty(0),
        **{name: getattr(MAP, name)[:1] for name in ("gap", "counted", "n", "worst")},
    )  # fmt: skip
    picture = calibration_picture(strip, limit=0.21, key="k")
    assert len(boxes(picture)) == 2
    assert 'height="120"' in picture or "420 120" in picture
