import pytest

from gaugeblock.reports.discovery.best_fit import fit_chapter, fit_rows
from gaugeblock.reports.discovery.chapter import LeftOut
from gaugeblock.reports.discovery.headline import headline
from gaugeblock.reports.discovery.phrases import energy_range, global_p
from gaugeblock.reports.discovery.priors import prior_chapter, prior_rows
from gaugeblock.reports.discovery.size import amplitude_chapter
from gaugeblock.reports.words import NOTHING


def test_each_ending_has_its_kind_and_word(ending):
    name, summary = ending
    made = headline(summary)
    kind, word = {
        "named": ("named", "emission line"),
        "set": ("set", "emission line or partial covering"),
        "two": ("named", "emission line + gain slope"),
        "unnamed": ("unnamed", "Unnamed"),
        "withdrawn": ("withdrawn", "No name holds"),
        "nothing": ("nothing", "No disagreement"),
    }[name]
    assert (made.kind, made.word) == (kind, word)


def test_a_name_says_what_where_how_sure_and_how_much_the_gap_shrinks(summary):
    said = headline(summary).paragraph
    for part in (
        "disagree with tbabs*powerlaw", "none of 999 simulated", "6.08–6.72 keV", "more counts", "z = +8.7",
        "shrinks: mean Poisson deviance per channel 1.420 before, 1.020 after",
    ):  # fmt: skip
        assert part in said, part


def test_an_amplitude_says_what_it_was_measured_on(summary):
    """All counts chose the name, and a half of them the range of what has none."""
    (one,) = summary["amplitude"]
    for change, shown, row in (
        ({"held_out": True}, "from one half of the counts; all of them chose the name", "fitted again"),
        ({"held_out": False}, "in sample", "all data"),
        (
            {"held_out": True, "effect": "unnamed"},
            "from a half of the data that did not choose where",
            "a half",
        ),
    ):
        summary["amplitude"] = [one | change]
        assert headline(summary).figures[-1][2] == shown
        (table,) = amplitude_chapter(summary).tables
        assert row in table.groups[0].cells[0][-1]
        assert table.columns[-1].head == "Measured on"


def test_nothing_is_said_to_come_of_data_that_had_no_part_in_choosing_the_name(ending):
    made = headline(ending[1])
    said = " ".join([made.paragraph, *(word for figure in made.figures for word in figure)])
    assert "did not choose" not in said
    assert ("held out of its fits" in said) == (ending[0] in ("named", "set"))
    assert ("held out of their fits" in said) == (ending[0] == "two")


def test_a_gap_that_grows_is_not_said_to_shrink(summary):
    summary["gap"]["held_out"]["after"] = 1.5
    assert "does not shrink" in headline(summary).paragraph


def test_fewer_counts_are_fewer(summary):
    summary["disagreement"]["regions"][0]["z"] = -5.0
    assert "fewer counts than expected, z = −5.0" in headline(summary).paragraph


def test_every_statement_is_told_in_order(summary):
    summary["statements"] = [{"text": "A line is certain."}, {"text": "Beyond that, something remains."}]
    assert headline(summary).statements == ("A line is certain.", "Beyond that, something remains.")
    summary["named_all"] = ["emission_line", "gain_slope"]
    assert "With them in the model" in headline(summary).paragraph


def test_an_effect_that_was_added_twice_is_counted(summary):
    summary["named_all"] = ["emission_line", "emission_line"]
    assert headline(summary).word == "emission line (2 of them)"


def test_nothing_found_claims_nothing_more(ending):
    name, summary = ending
    if name == "nothing":
        said = headline(summary).paragraph
        assert "global p = 0.43" in said
        assert "no proof that nothing is there" in said
        assert "shrinks" not in said


def test_why_a_name_was_withdrawn_is_said(ending):
    name, summary = ending
    if name == "withdrawn":
        assert "did not hold: a random shape does as well" in headline(summary).paragraph


def test_holes_are_no_errors():
    assert headline({}).kind == "nothing"
    assert headline({"named": "x", "named_all": ["x"]}).word == "x"


@pytest.mark.parametrize(
    ("ends", "said"),
    [
        ((6.312, 6.498), "6.31–6.50 keV"),
        ((0.52001, 0.52009), "0.5200–0.5201 keV"),
        ((1.0, 1.0), "1.00–1.00 keV"),
    ],
)
def test_ends_of_a_range_can_be_told_apart(ends, said):
    assert energy_range(*ends) == said


def test_a_p_at_its_floor_says_so():
    assert "none of 199" in global_p(1 / 200, 199)
    assert "none" not in global_p(2 / 200, 199)


def test_the_best_fit_is_told_with_errors_before_and_after(summary):
    assert fit_rows(summary) == [
        ("powerlaw_1.alpha", "1.7 (1.65 to 1.75)", "1.8"),
        ("C / bins", "284.0 / 200", "204.0 / 200"),
    ]
    assert fit_rows({}) == []
    summary["fit"]["before"] |= {"w_statistic": 131.26, "w_bins": 100}
    assert fit_rows(summary)[2:] == [("W / bins, for comparison", "131.3 / 100", NOTHING)]
    assert "W, which XSPEC prints" in fit_chapter(summary).lead
    del summary["fit"]["before"]["w_statistic"]
    assert "XSPEC" not in fit_chapter(summary).lead
    shape = {
        f"background_{k}.{part}": {"value": 1.0} for k in (1, 3) for part in ("rate_1", "line_12", "level")
    }
    summary["fit"]["before"]["parameters"] |= shape
    assert [row[0] for row in fit_rows(summary, backgrounds=False)] == [
        "powerlaw_1.alpha", "background_1.level", "background_3.level", "C / bins",
    ]  # fmt: skip
    assert len(fit_rows(summary)) == 2 + len(shape)
    summary["fit"]["before"]["parameters"]["powerlaw_1.alpha"]["at_limit"] = True
    assert fit_rows(summary)[0][1] == "1.7 (1.65 to 1.75), at its prior's end"


def test_what_a_name_costs_beforehand_is_told_of_every_name_of_a_statement(summary):
    rows = [("emission line", "1", "equivalent width up to 0.3, energy 2 to 7 keV",
             "norm up to 0.0125, sigma up to 1 keV")]  # fmt: skip
    summary["statements"] = [
        {"indistinguishable": ["emission_line", "unnamed"]}, {"indistinguishable": ["emission_line", "edge"]}
    ]  # fmt: skip
    assert prior_rows(summary) == rows
    (table,) = prior_chapter(summary).tables
    assert table.groups[0].cells == tuple(rows)
    summary["effects"]["edge"] = {"prior": {"odds": 0.2, "usual": {}, "limits": {"depth": [-0.9, 0.9]}}}
    assert prior_rows(summary)[1] == ("edge", "0.2", NOTHING, "depth −0.9 to 0.9")
    del summary["statements"][0], summary["effects"]["edge"], summary["effects"]["emission_line"]
    assert isinstance(prior_chapter(summary), LeftOut)
