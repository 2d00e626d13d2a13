from xml.etree import ElementTree

import numpy as np
import pytest
import xarray as xr

from gaugeblock.core.errors import InputError
from gaugeblock.reports.discovery import gain_headline
from gaugeblock.reports.discovery.axes import energy_axis, linear_axis, log_axis
from gaugeblock.reports.discovery.before_after import identified
from gaugeblock.reports.discovery.read import Stretch
from gaugeblock.reports.discovery.rebin import binned_residual, display_bins
from gaugeblock.reports.discovery.spectrum_figure import Line, Span, residual_height, spectrum_figure


def elements(picture, class_):
    return [e for e in ElementTree.fromstring(str(picture)).iter() if e.get("class", "").endswith(class_)]


def test_bins_for_the_eye_keep_every_count():
    rng = np.random.default_rng(1)
    sides = np.geomspace(0.3, 10, 3001)
    expected = 2.0 / np.arange(1.0, 3001)
    counts = rng.poisson(expected).astype(float)
    bins = display_bins(sides[:-1], sides[1:], np.log10(sides), expected)
    assert bins.sum(counts).sum() == counts.sum()
    assert bins.held.sum() == 3000
    assert len(bins.start) <= 150
    assert np.all(bins.sum(expected) >= 8)
    np.testing.assert_array_equal(bins.low[1:], bins.high[:-1])


def test_few_channels_are_drawn_as_they_are():
    sides = np.geomspace(0.5, 8, 51)
    residual = np.linspace(-3, 3, 50)
    bins = display_bins(sides[:-1], sides[1:], np.log10(sides), np.full(50, 20.0))
    drawn = binned_residual(bins, np.full(50, 22.0), np.full(50, 20.0), residual)
    np.testing.assert_array_equal(drawn, residual)


def test_residuals_of_summed_channels_have_unit_variance_and_no_bias():
    rng = np.random.default_rng(2)
    expected = np.full(40_000, 0.4)
    counts = rng.poisson(expected).astype(float)
    bins = display_bins(np.arange(40_000.0), np.arange(1.0, 40_001), np.arange(40_001.0), expected)
    from gaugeblock.discovery.locate import normal_score

    z = binned_residual(bins, counts, expected, normal_score(counts - expected, expected, expected))
    assert abs(z.mean()) < 4 / np.sqrt(len(z))
    assert z.std() == pytest.approx(1.0, abs=4 / np.sqrt(2 * len(z)))


def test_a_fit_that_took_scatter_makes_drawn_residuals_larger():
    expected, counts = np.full(400, 30.0), np.random.default_rng(1).poisson(30.0, 400).astype(float)
    sides = np.arange(401.0)
    bins = display_bins(sides[:-1], sides[1:], sides, expected)
    assert bins.held.max() > 1
    plain = (counts - expected) / np.sqrt(expected)
    one, other = (binned_residual(bins, counts, expected, factor * plain) for factor in (1.0, 1.25))
    np.testing.assert_allclose(other, 1.25 * one, rtol=0.1)


def figure(counts, expected, **options):
    sides = np.geomspace(0.5, 8, len(counts) + 1)
    part = Stretch("pn", "keV", "source", np.arange(len(counts)), sides[:-1], sides[1:])
    residual = (counts - expected) / np.sqrt(expected)
    return spectrum_figure(part, counts, expected, residual, key="k", name="n", **options)


def test_a_region_is_shaded_where_it_lies():
    counts = np.full(100, 50.0)
    whole, half = (figure(counts, counts, spans=[Span(low, 8.0, True, "note")]) for low in (0.5, 2.0))
    widths = [float(elements(picture, "more")[0].get("width")) for picture in (whole, half)]
    assert widths[1] / widths[0] == pytest.approx(0.5, abs=0.01)  # 2 keV is the logarithmic middle


def test_residuals_after_stand_below_those_before_on_the_same_scale():
    counts = np.full(100, 50.0)
    expected = np.where(np.arange(100) == 50, 10.0, 50.0)
    picture = figure(counts, expected, after=(counts, np.zeros(100)), half_height=20.0)
    _, before, after = (element.get("d") for element in elements(picture, "datum"))
    heights = [
        np.array([float(point.split()[1].partition("h")[0]) for point in drawn.split("M")[1:]])
        for drawn in (before, after)
    ]
    assert np.ptp(heights[0]) > 20, "the residual before sticks out"
    assert np.ptp(heights[1]) == 0
    assert heights[1].min() > heights[0].max()
    assert len(elements(picture, "model was")) == len(elements(picture, "model")) == 1


def test_identified_lines_stand_where_they_are_and_their_names_beside_each_other():
    counts = np.full(100, 50.0)
    lines = [Line(2.0, "middle"), Line(2.01, "close by"), Line(30.0, "beyond")]
    picture = figure(counts, counts, lines=lines)
    drawn = elements(picture, "identified")
    assert len(drawn) == 2
    across = [float(element.get("d")[1:].split()[0]) for element in drawn]
    assert across[0] == pytest.approx((66 + 948) / 2, abs=1)  # 2 keV is the logarithmic middle of 0.5 to 8
    names = [(each.text, each.get("y")) for each in elements(picture, "note")]
    assert [name for name, _ in names] == ["middle", "close by"]
    assert names[0][1] != names[1][1], "one above the other"


def test_lines_are_those_that_statements_identify():
    named = [{"name": "Fe K", "energy_kev": 6.4, "chance": 0.01}, {"name": "less likely", "energy_kev": 6.5}]
    summary = {"statements": [{"identification": named}, {"identification": []}, {}]}
    assert identified(summary) == (Line(6.4, "Fe K"),)
    assert identified({}) == ()


def test_lines_are_drawn_where_they_are_recorded():
    """At a redshift of 0.3, in a model that has gains of its own, of one instrument or of both."""
    line = {"identification": [{"name": "Fe K", "energy_kev": 6.4}]}
    summary = {"statements": [line | {"parameters": {"energy": {"value": 4.923}}}], "amplitude": []}
    assert identified(summary) == (Line(4.923, "Fe K"),)
    gains = [("gain_slope", 1.02), ("gain_offset[pn]", 0.05), ("gain_curve", 0.01), ("effective_area", 0.3)]
    summary["amplitude"] = [{"effect": effect, "value": value} for effect, value in gains]
    for name, offset in (("pn", 0.05), ("mos", 0.0), ("", 0.0)):
        scaled = 1.02 * 4.923 + offset
        (drawn,) = identified(summary, name)
        assert drawn.energy == pytest.approx(scaled + 0.01 * scaled * (scaled - 5.9) / 5.9)


def test_channels_without_counts_are_no_points_but_have_residuals():
    counts = np.r_[np.zeros(50), np.full(50, 40.0)]
    picture = figure(counts, np.full(100, 20.0))
    above, below = (element.get("d").count("M") for element in elements(picture, "datum"))
    assert above < below


def test_residuals_share_a_scale_that_holds_them():
    assert residual_height(np.array([0.5])) == 4.0
    assert residual_height(np.array([0.5]), np.array([-30.0])) > 30.0


@pytest.mark.parametrize(
    ("axis", "labels"),
    [
        (energy_axis([0.3], [10.0], "keV"), ["0.5", "1", "2", "5", "10"]),
        (energy_axis([6.0], [7.0], "keV"), ["6", "6.2", "6.4", "6.6", "6.8", "7"]),
        (energy_axis([0.0], [100.0], "channel"), ["0", "20", "40", "60", "80", "100"]),
        (log_axis(2.0, 3e6, "", decades=True), ["10", "100", "1,000", "10,000", "10⁵", "10⁶"]),
    ],
)
def test_ticks_are_those_that_people_expect(axis, labels):
    assert list(axis.ticks.values()) == labels
    assert all(axis.low - 1e-3 <= at <= axis.high + 1e-3 for at in axis.ticks)


def test_an_axis_that_begins_at_zero_has_a_logarithm_all_the_same():
    axis = energy_axis([0.0, 0.1], [0.1, 10.0], "keV")
    assert np.isfinite(axis.at([0.0, 0.05, 10.0])).all()
    assert linear_axis(1.0, 1.0, "").low < 1.0


def gain_table(**changes):
    table = xr.Dataset(
        {
            "value": (("scheme", "case"), [[0.4, 0.5], [0.2, np.nan], [10.1, -8.0]]),
            "null_low": (("scheme", "case"), [[-1.9, -1.9], [-1.0, -1.0], [-2.0, -2.0]]),
            "null_high": (("scheme", "case"), [[1.9, 1.9], [1.0, 1.0], [2.0, 2.0]]),
            "threshold": (("scheme", "case"), np.full((3, 2), 3.0)),
        },
        coords={"scheme": ["posterior shift", "SBC", "score test"], "case": ["bright", "medium"]},
    )
    return table.assign(**changes)


def test_the_gain_figure_fills_what_was_seen_and_leaves_out_what_was_not_run():
    picture = gain_headline(gain_table())
    assert len(elements(picture.replace('xmlns="http://www.w3.org/2000/svg" ', ""), "unseen")) == 3
    seen = [e for e in ElementTree.fromstring(str(picture)).iter() if e.get("class") == "seen"]
    assert len(seen) == 2  # on either side
    assert 'xmlns="http://www.w3.org/2000/svg"' in picture
    text = "".join(ElementTree.fromstring(str(picture)).itertext())
    for said in ("posterior shift", "bright", "10.1", "seen from here"):
        assert said in text


def test_the_gain_figure_refuses_a_table_it_cannot_draw():
    with pytest.raises(InputError, match="lacks threshold"):
        gain_headline(gain_table().drop_vars("threshold"))
    with pytest.raises(InputError, match="above the centre"):
        gain_headline(gain_table(threshold=(("scheme", "case"), np.full((3, 2), -1.0))))
