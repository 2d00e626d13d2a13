from dataclasses import replace

from gaugeblock.reports import report_html
from gaugeblock.reports.contents import contents

LISTED = {
    "kind": "pickle",
    "pickles": 1,
    "imports": ["numpy.dtype", "os.system"],
    "calls": ["os.system"],
    "notable": ["os.system"],
    "unresolved": 2,
    "left_out": 0,
    "problems": ["m.pkl: not a whole pickle"],
}


def test_what_a_file_would_import_in_sentences():
    assert contents(LISTED) == [
        "Of 1 pickle in it: loading would import 2 names and call 1.",
        "Imported: numpy.dtype and os.system.",
        "With these a program reaches out of itself: os.system.",
        "2 imports with a name that is only made while loading.",
        "Not read to the end: m.pkl: not a whole pickle.",
    ]
    for nothing in (None, {}, 3, {"kind": "other", "pickles": 0}):
        assert contents(nothing) == []


def test_the_report_has_a_chapter_on_it(passing):
    plain = report_html(passing.verdict, passing.findings, passing.trials, title="t")
    assert "What is in the file" not in plain
    verdict = replace(passing.verdict, provenance={"listing": {**LISTED, "imports": ["<script>"]}})
    page = report_html(verdict, passing.findings, passing.trials, title="t")
    assert "no proof of safety" in page
    assert "contained it" not in page
    assert "Imported: &lt;script&gt;." in page


def test_a_sandbox_is_claimed_only_where_there_was_one(passing):
    trusted = "none: trusted by whoever ran the audit"
    for sandbox, says, never in (
        ({"program": "bubblewrap"}, "What contained it is the sandbox.", "Nothing contained it"),
        (trusted, "Nothing contained it", "What contained it"),
    ):
        record = {"listing": LISTED, "confinement": {"sandbox": sandbox}}
        verdict = replace(passing.verdict, provenance=record)
        page = report_html(verdict, passing.findings, passing.trials, title="t")
        assert says in page
        assert never not in page


def test_pickles_in_values_are_counted():
    assert contents({**LISTED, "inside": 3})[0].startswith(
        "Of 1 pickle in it, and 3 pickles in values of it: "
    )
