"""Sealing, scoring, targets, runs that go on, the page; and a twin of the study with three effects."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

pytest.importorskip("astropy")

from studies.hidden.document import FIGURE, MAKERS, PAGE, blocks, document
from studies.hidden.runner import run, seed_of, so_far
from studies.hidden.score import FoundNames, scored, stated, table
from studies.hidden.seal import Answer, SealedCase, cases, opened, seal
from studies.hidden.targets import by_effect, eligible, target, targets
from studies.hidden.truth import Truth
from studies.kit.page import filled
from studies.kit.results import DOCS, RESULTS, clopper_pearson, read, write
from studies.kit.statements import Said
from studies.kit.statements import table as statements_table

from gaugeblock.core.errors import InputError

TRUTH = Truth((0.2, 2.0, 1e-3), 3534.0, (("gain_slope", {"slope": 1.02}),), notes={"level": "bright"})
ANSWER = Answer(
    "s", "listed", ("gain_slope",), (TRUTH,), {"nothing": 9.0, "gain_slope": 0.1, "gain_offset": 6.0}
)
SILENT = FoundNames(0, "", (), (), 0.4, {}, (float("nan"), float("nan")), "", "", 1.0)
NAMED = replace(
    SILENT,
    named="gain_slope",
    named_all=("gain_slope",),
    alike=("gain_slope",),
    amplitude={"gain_slope": (1.019, 1.01, 1.03)},
    gap=(1.4, 1.1),
)


def test_the_right_name_alone_counts_one_and_one_of_two_a_half():
    row = scored(ANSWER, NAMED)
    assert (row["right"], row["confident"], row["wrong"], row["nearest"], row["rival"]) == (
        1.0,
        True,
        False,
        6.0,
        "gain_offset",
    )
    assert (row["amplitude_true"], row["amplitude_low"], row["amplitude_high"]) == (1.02, 1.01, 1.03)
    pair = scored(ANSWER, replace(NAMED, named="gain_offset", alike=("gain_offset", "gain_slope")))
    assert (pair["right"], pair["confident"], pair["wrong"]) == (0.5, False, False)
    three = scored(ANSWER, replace(NAMED, alike=("gain_slope", "gain_offset", "gain_curve")))
    assert three["right"] == 0.0
    assert row["log_score"] > pair["log_score"] > three["log_score"] > scored(ANSWER, SILENT)["log_score"]
    other = scored(ANSWER, replace(NAMED, named="gain_offset", alike=("gain_offset",)))
    assert (other["right"], other["wrong"]) == (0.0, True)
    assert np.isnan(other["amplitude_true"])


def test_what_the_library_lacks_may_be_unnamed_or_a_set_but_not_one_name():
    truth = replace(TRUTH, hidden=(("two_edges", {"energy": 1.0, "apart": 0.2, "ratio": 1.0, "depth": 1.0}),))
    answer = Answer("u", "unlisted", ("two_edges",), (truth,), {"nothing": 20.0, "absorption_edge": 7.0})
    edge = replace(NAMED, named="absorption_edge", named_all=("absorption_edge",), alike=("absorption_edge",))
    assert scored(answer, edge)["wrong"]
    assert scored(answer, edge)["nearest"] == 7.0
    assert not scored(answer, replace(edge, named_all=("absorption_edge", "absorption_edge")))["wrong"]
    assert not scored(answer, replace(edge, alike=("absorption_edge", "unnamed")))["wrong"]
    assert not scored(answer, replace(edge, named="unnamed", alike=("unnamed",)))["wrong"]
    assert not scored(answer, SILENT)["wrong"]


def test_a_statement_holds_if_the_truth_is_in_its_set_and_only_once():
    slope = Said("gain_offset", ("gain_offset", "gain_slope"), True, 0.99)
    line = Said("emission_line", ("emission_line",), False, 0.9)
    unnamed = Said("unnamed", ("unnamed", "reflection"), False, 0.5)
    found = replace(NAMED, statements=(line, slope, slope, unnamed))
    assert stated(ANSWER, found) == (found.statements, [False, True, False, False])
    pair = replace(ANSWER, kind="pair", names=("gain_slope", "emission_line"))
    assert stated(pair, found)[1] == [True, True, False, False]
    bare = replace(ANSWER, kind="nothing", names=(), stratum="nothing, bright")
    assert stated(bare, found)[1] == [False] * 4
    # A curve of the area that is wrong is one, or something without a name.
    area = replace(bare, stratum="nothing, area wrong by 3%")
    assert stated(area, found)[1] == [False, False, False, True]
    # What the library lacks takes as many statements as it takes.
    edges = replace(ANSWER, kind="unlisted", names=("two_edges",))
    edge = Said("absorption_edge", ("absorption_edge",), True, 0.9)
    assert stated(edges, replace(found, statements=(edge, edge, line, unnamed)))[1] == [
        True,
        True,
        False,
        True,
    ]
    made = statements_table({"7": stated(ANSWER, found)})
    assert made["case"].values.tolist() == ["7"] * 4
    assert made["at"].values.tolist() == [0, 1, 2, 3]
    assert made["right"].values.tolist() == [False, True, False, False]
    assert made["alike"].values.tolist()[1] == "gain_offset gain_slope"
    assert made["probability"].values.tolist() == [0.9, 0.99, 0.99, 0.5]


def rows():
    """Every kind of answer, in numbers that a person can count."""
    far = {"nothing": 20.0, "absorption_line": 7.0}
    bare = replace(TRUTH, hidden=())
    nothing = Answer("nothing", "nothing", (), (bare,), {})
    unlisted = Answer("u", "unlisted", ("notch",), (bare,), far)
    pair = replace(ANSWER, kind="pair", names=("gain_slope", "resolution"))
    near = replace(ANSWER, distances={"nothing": 9.0, "gain_offset": 3.0})
    found = [(ANSWER, NAMED)] * 9 + [(ANSWER, SILENT)] + [(near, SILENT)] * 5
    found += [(nothing, SILENT)] * 19 + [(nothing, NAMED)]
    found += [(unlisted, replace(NAMED, named="unnamed", alike=("unnamed",)))] * 3 + [(unlisted, NAMED)]
    found += [(pair, NAMED)]
    return [scored(answer, one) for answer, one in found]


def test_targets_count_fair_cases_only():
    named, given, wrong, covered, shrunk = targets(table(rows()))
    assert (named.rate, named.number) == (pytest.approx(0.9), 10)
    assert (given.rate, given.number) == (pytest.approx(0.05), 20)
    assert (wrong.rate, wrong.number) == (pytest.approx(0.25), 4)
    assert (covered.rate, covered.number) == (1.0, 9)
    assert (shrunk.rate, shrunk.number) == (1.0, 9)
    assert all(one.met for one in (named, given, covered, shrunk))


def test_a_target_is_missed_beyond_what_chance_allows_and_not_before():
    """At the 99% limit of 400 cases: 31 of 400 for 5%, 345 of 400 for 90%."""
    assert target("", 31, 400, high=0.05).met
    assert not target("", 32, 400, high=0.05).met
    assert target("", 345, 400, low=0.9).met
    assert not target("", 344, 400, low=0.9).met
    assert not target("", 400, 400, low=0.85, high=0.95).met
    assert not target("", 300, 400, low=0.85, high=0.95).met


def test_effects_weigh_the_same_however_many_cases_they_have():
    listed = table([row for row in rows() if row["kind"] == "listed" and row["nearest"] >= 5])
    more = table(
        [
            *[row for row in rows() if row["kind"] == "listed" and row["nearest"] >= 5],
            *[row | {"truth": "resolution", "right": 0.0} for row in rows()[:2]],
        ]
    )
    assert by_effect(listed)[0] == pytest.approx(0.9)
    mean, worth = by_effect(more)
    assert mean == pytest.approx(0.45)
    assert worth == pytest.approx(4 / (1 / 10 + 1 / 2))


@pytest.fixture
def folder(tmp_path):
    data = [SealedCase(k, "one", np.arange(6.0).reshape(1, 6) + k, np.array([3534.0])) for k in range(5)]
    hashes = seal(tmp_path / "sealed", data, [ANSWER] * 5, seed=7)
    assert hashes["cases"] == 5
    return tmp_path / "sealed"


def test_what_was_sealed_comes_out_again(folder):
    seed, answers = opened(folder)
    assert seed == 7
    assert answers == [ANSWER] * 5
    assert [case.number for case in cases(folder)] == list(range(5))
    np.testing.assert_array_equal(cases(folder)[2].counts, [np.arange(6.0) + 2])


@pytest.mark.parametrize("name", ["answers.json", "cases.nc"])
def test_a_broken_seal_is_noticed(folder, name):
    with open(folder / name, "ab") as file:
        file.write(b" ")
    with pytest.raises(InputError, match="not the file that was sealed"):
        opened(folder)


def test_the_hash_of_the_answers_gives_nothing_away(folder, tmp_path):
    again = seal(tmp_path / "again", cases(folder), [ANSWER] * 5, seed=7)
    first = json.loads((folder / "seal.json").read_text())
    assert again["answers.json"] != first["answers.json"]


ASKED: list[int] = []


def toy():
    """An engine that remembers what it was asked, and answers with the seed."""

    def search(case, seed):
        ASKED.append(case.number)
        return replace(SILENT, number=case.number, p_global=seed / 2**63)

    return search


def test_a_run_goes_on_where_it_stopped(folder):
    ASKED.clear()
    asked = {"seed": 3, "settings": {"a": 1}}
    with pytest.raises(InputError, match="no case has been searched"):
        so_far(folder, **asked)
    run(folder, toy, **asked, numbers=[0, 1])
    found = run(folder, toy, **asked)
    assert ASKED == [0, 1, 2, 3, 4]
    assert [found[k].p_global for k in range(5)] == [seed_of(k, 3) / 2**63 for k in range(5)]
    assert len({seed_of(k, 3) for k in range(5)}) == 5
    assert repr(so_far(folder, **asked)) == repr(found)
    for other in ({"seed": 4}, {"settings": {"a": 2}}):
        with pytest.raises(InputError, match="no case has been searched"):
            so_far(folder, **{**asked, **other})


@pytest.fixture
def stored():
    attributes = {
        "sealed": json.dumps({"answers.json": "a" * 64, "cases.nc": "b" * 64, "cases": 41}),
        "generator_seed": "12",
        "command": "python -m studies.hidden",
    }
    return table(rows()).assign_attrs(attributes)


def test_the_page_is_made_of_the_table(stored):
    text = (DOCS / PAGE).read_text(encoding="utf-8")
    for name in MAKERS:
        assert text.count(f"<!-- spectra {name} -->") == text.count(f"<!-- /spectra {name} -->") == 1
    once = filled(text, blocks(stored, "spectra"))
    assert filled(once, blocks(stored, "spectra")) == once
    assert "| `gain_slope` | 10 of 15 | 90% | 9 / 0 / 1 |" in once
    assert "at most 5% | 20 | 5.0%" in once
    assert "| met |" not in blocks(stored, "spectra")["spectra targets"]
    assert "40 of 41 sealed cases" in once
    assert "This is 98% of the set" in once
    assert "too few cases to say" in once


def test_figures_are_drawn(stored, tmp_path):
    pytest.importorskip("matplotlib")
    write({"": stored}, tmp_path / "hidden.nc")
    (tmp_path / PAGE).write_text("<!-- spectra pairs --><!-- /spectra pairs -->")
    document(tmp_path, tmp_path)
    written = {path.name for path in (tmp_path / "figures").iterdir()}
    assert written == {f"hidden-spectra-{name}.svg" for name in FIGURE}
    assert "| cases |" in (tmp_path / PAGE).read_text()


ONLY = ("emission_line", "gain_slope", "absorption_edge")


@pytest.mark.slow
def test_a_twin_of_the_study(tmp_path, xray_data):
    """Three effects, one component, two cases each, and ten without: a fixed set, so no chance is involved.

    At most one of the six may be misnamed, and of the ten at most one named.
    """
    from studies.hidden import engine
    from studies.hidden.generate import generate
    from studies.hidden.setups import laboratory
    from studies.hidden.strata import Stratum

    strata = (
        Stratum("listed", "listed", "one", 2, hidden=ONLY),
        Stratum("nothing", "nothing", "one", 10, level="bright"),
    )
    generate(
        tmp_path, laboratory(), partial(engine.apart, only=ONLY), engine.apart_shared, seed=1, strata=strata
    )
    found = run(tmp_path, partial(engine.engine, only=ONLY), seed=2, settings=None)
    _, answers = opened(tmp_path)
    made = table([scored(answers[number], one) for number, one in sorted(found.items())])
    listed, nothing = made["kind"].values == "listed", made["kind"].values == "nothing"
    assert (made["nearest"].values[listed] >= 5).sum() >= 4
    assert made["right"].values[listed].sum() >= 5
    assert (made["named"].values[nothing] != "").sum() <= 1


def test_what_is_told_of_todays_search_is_in_its_tables():
    """Names that were lost, by what stands beside them; statements by what is hidden; the part before."""
    text, how = (
        " ".join((DOCS / name).read_text(encoding="utf-8").split()) for name in (PAGE, "discovery.md")
    )
    was, now, part = (read(RESULTS / f"{name}.nc") for name in ("hidden", "hidden-today", "hidden-a106d8e"))
    fair = np.isin(was["number"].values, eligible(was, "listed")["number"].values)
    lost = fair & (was["right"].values == 1) & (now["right"].values < 1)
    sets = [set(alike.replace(",", " ").split()) for alike in now["alike"].values]
    two = lost & (now["right"].values == 0.5)
    smooth = sum("unnamed" in sets[i] for i in np.flatnonzero(two))
    assert (int(lost.sum()), int(two.sum()), smooth) == (34, 26, 16)
    assert f"Of the {lost.sum()} that were lost, {two.sum()} are one of two now: {smooth} beside" in text
    assert int((lost & (now["named"].values == "unnamed")).sum()) == 1
    # The first 346 by the code before: the same names stand alone.
    first = part["number"].values
    alone = part["right"].values == 1
    np.testing.assert_array_equal(alone, now["right"].values[first] == 1)
    assert f"of these {(alone & fair[first]).sum()} right names of {fair[first].sum()} stood alone" in text
    said = read(RESULTS / "hidden-today.nc", "statements")
    kind = now["kind"].values[said["case"].values.astype(int)]
    certain, right = (said[name].values.astype(bool) for name in ("certain", "right"))
    known, unknown = (certain & (kind == one) for one in ("listed", "unlisted"))
    assert f"{right[known].sum()} of {known.sum()} statements hold of single effects" in text
    assert f"{right[unknown].sum()} of {unknown.sum()} of what it lacks" in text
    assert f"{right[certain].sum()} of {certain.sum()} certain statements hold" in how
    assert f"and {right[~certain].sum()} of {(~certain).sum()} others" in how


def test_what_is_printed_held_in_a_set_that_was_made_after():
    """The seal was there first; of what is certain and what is not, what was printed lies in the limits."""
    text = " ".join((DOCS / PAGE).read_text(encoding="utf-8").split())
    found, said = (read(RESULTS / "hidden-fresh.nc", group) for group in ("", "statements"))
    sealed = json.loads((RESULTS / "hidden-fresh-seal.json").read_text(encoding="utf-8"))
    assert json.loads(found.attrs["sealed"]) == sealed
    assert found.sizes["row"] == sealed["cases"]
    certain, right = (said[name].values.astype(bool) for name in ("certain", "right"))
    for of in (certain, ~certain):
        low, high = clopper_pearson(int(right[of].sum()), int(of.sum()))
        assert low < said["probability"].values[of].mean() < high
    counts = [f"{right[of].sum()} of {of.sum()}" for of in (certain, ~certain)]
    assert "**Both stand**: {} certain statements hold, and {} others.".format(*counts) in text
