"""From names to files and an exit code."""

import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from studies.paper import (
    Agreement,
    Measured,
    Setting,
    Untestable,
    claims,
    experiment,
    from_committed,
    judge,
    reproduce,
)
from studies.paper.claim import Counted
from studies.paper.document import DOCS, adopt, document
from studies.paper.experiment import committed
from studies.paper.experiments.evidence_pairs import summaries
from studies.paper.family import Family
from studies.paper.page import page
from studies.paper.paper_flow.shipped import FLOWS
from studies.paper.run import Reproduction, as_dataset, needed
from studies.paper.verdict_tables import before, changes

from gaugeblock.core.errors import InputError


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    folder = tmp_path_factory.mktemp("out")
    reproduce(["published"], folder, seed=3)
    return folder


def test_all_files_are_written(out):
    text = (out / "reproduction.md").read_text(encoding="utf-8")
    assert text.startswith("# ")
    assert "| recomputed | 42 | 39 | 3 |" in text
    with xr.open_datatree(out / "reproduction.nc", engine="netcdf4") as stored:
        assert set(stored.children) == {"published", "claims"}
        verdicts = stored["claims"].to_dataset().load()
    assert set(verdicts["verdict"].values.tolist()) == {"agrees", "differs"}
    assert set(verdicts["claim"].values.tolist()) == {
        name for name, claim in claims().items() if claim.by == "published"
    }
    for line in text.splitlines():
        if line.startswith("!["):
            assert (out / line.partition("(")[2].rstrip(")")).exists()


def test_only_what_measures_the_claims_that_are_asked_for_is_run(tmp_path, monkeypatch):
    monkeypatch.setattr("studies.paper.run.EXPERIMENTS", ("published", "counts"))
    names = {"gm.quad": claims()["gm.quad"], "tb.sigma": claims()["tb.sigma"]}
    assert needed(names) == ("published",)
    result = reproduce(["gm.quad", "tb.sigma"], tmp_path, seed=3)
    assert [item.verdict.value for item in result.judgements] == ["not measured yet", "agrees"]
    assert result.exit_code == 3


def test_an_unknown_name_runs_nothing(tmp_path):
    with pytest.raises(InputError, match="neither a claim nor an experiment"):
        reproduce(["gm.quad", "nothing"], tmp_path, seed=3)
    assert not list(tmp_path.iterdir())


def judged(*found):
    chosen = [claims()["ns.n"], claims()["gm.quad"], claims()["tb.sigma"]]
    return tuple(judge(claim, item) for claim, item in zip(chosen, found, strict=True))


@pytest.mark.parametrize(
    ("found", "code"),
    [
        ((Measured(76), Measured(0.017), Untestable("why")), 0),
        ((Measured(76), Measured(0.017), None), 3),
        ((Measured(75), Measured(0.017), None), 1),
        ((Measured(75, because="one spectrum was drawn twice"), Measured(0.017), Untestable("why")), 1),
        ((Measured(76), Measured(0.017), Measured(dict.fromkeys(("median", "min", "max"), 0.2))), 3),
    ],
)
def test_exit_codes(found, code):
    assert Reproduction({}, judged(*found), ()).exit_code == code


def test_too_many_misses_are_a_finding_of_their_own():
    few = Family(name="a", cells=48, paired=0, misses=5, expected=4.0, bare=2.0, most=9, p=0.4, adjusted=0.4)
    assert Reproduction({}, (), (few,)).exit_code == 0
    assert Reproduction({}, (), (few, replace(few, adjusted=0.009))).exit_code == 1


def test_an_interrupted_run_says_where(tmp_path, monkeypatch):
    from gaugeblock.core.interrupts import Interrupted

    def stop(experiment, *_, **__):
        raise Interrupted("interrupted")

    monkeypatch.setattr("studies.paper.run.made", stop)
    with pytest.raises(Interrupted, match=r"interrupted in published: 0 of 1 experiments are done"):
        reproduce(["gm.quad"], tmp_path, seed=3)
    assert not (tmp_path / "reproduction.nc").exists()


def test_the_page_says_every_verdict_and_reason():
    three = judged(Measured(75), Measured(0.017), Untestable("seeds are not published"))
    text = page({}, three, (), {})
    assert "Of 1 judged claims 0 agree, 0 differ, 0 are undecided, 1 cannot" in text
    assert "| recomputed | 2 | 1 | 1 |" in text
    assert "cannot be tested; seeds are not published" in text
    assert "- `tb.sigma`: seeds are not published" in text
    assert "differs; unexplained: nothing predicted this number before its run" in text


def test_what_was_noted_of_a_difference_stands_apart_from_a_reason():
    far = judge(claims()["ns.n"], Measured(75, because="one spectrum was drawn twice"))
    text = page({}, (far,), (), {})
    differs = text.partition("## What differs\n")[2].partition("\n## ")[0]
    assert "| noted since |" in differs
    assert "because" not in differs
    assert "| recomputed | one spectrum was drawn twice |" in differs
    assert "noted since: one spectrum was drawn twice" in text


def test_the_page_has_every_claim_once():
    every = tuple(judge(claim, None) for claim in claims().values())
    text = page({}, every, (), {})
    for name in claims():
        assert name.startswith("grid.") or text.count(f"| `{name}` |") == 1, name
    assert text.count("| medium | B4 |") == 8  # four strengths on two responses
    assert "0.757" in text


def test_verdicts_as_a_table_have_every_part():
    table = as_dataset(judged(Measured(75), Measured(0.017), Untestable("why", {"value": 0.2})))
    row = table.isel(row=(table["claim"] == "ns.n").values)
    assert (row["measured"].item(), row["published"].item(), row["verdict"].item()) == (75, 76, "differs")
    sigma = table.isel(row=(table["claim"] == "tb.sigma").values)
    assert sigma["part"].values.tolist() == ["median", "min", "max", "value"]
    assert np.isnan(sigma["measured"].values[:3]).all()


def test_only_full_runs_become_results(out, tmp_path):
    assert adopt(out, tmp_path) == ["published"]
    assert [path.name for path in tmp_path.iterdir()] == ["published.nc"]
    reproduce(["published"], tmp_path / "twin", seed=3, setting=Setting.TWIN)
    with pytest.raises(InputError, match="no full run"):
        adopt(tmp_path / "twin", tmp_path)
    with pytest.raises(InputError, match="no such file"):
        adopt(tmp_path / "nothing", tmp_path)


def test_the_document_says_what_the_results_say(tmp_path):
    pytest.importorskip("matplotlib")
    (tmp_path / "figures").mkdir()
    document(tmp_path)
    assert (tmp_path / "reproduction.md").read_text() == (DOCS / "reproduction.md").read_text()


def test_what_is_committed_differs_and_the_exit_code_says_so():
    result = from_committed(())
    assert result.exit_code == 1
    judged = [item for item in result.judgements if item.claim.counted is Counted.JUDGED]
    assert {item.claim.id for item in judged if item.verdict is Agreement.DIFFERS} == {
        "grid.pn.medium.B1.5e-06.D3"
    }
    assert [entry.name for entry in result.families] == [
        f"{response} {level}" for response in ("pn", "nicer") for level in ("faint", "medium", "bright")
    ]
    assert not [entry for entry in result.families if entry.adjusted < 0.05]
    # Each either decided, or with what would settle it.
    assert all(bool(item.settles) == (item.verdict is Agreement.UNDECIDED) for item in result.judgements)


def committed_page():
    return (DOCS / "reproduction.md").read_text(encoding="utf-8")


def front_page():
    return committed_page().partition("\n![")[0]


def test_the_front_page_is_read_in_five_minutes_and_names_no_claim():
    text = front_page()
    assert len(re.findall(r"[\w.+-]*\w[\w.+-]*", text)) < 920
    assert "`" not in text
    assert not [name for name in claims() if re.search(rf"(?<![\w.]){re.escape(name)}(?![\w.])", text)]
    order = [text.index(f"## {title}") for title in (
        "What becomes of its conclusions", "What differs, and what was wrong", "What nobody can test",
        "What is not yet made",
    )]  # fmt: skip
    assert order == sorted(order)


def test_a_conclusion_that_holds_rests_on_claims_that_agree_and_none_that_differs():
    judgements = {item.claim.id: item for item in from_committed(()).judgements}
    rests = {
        "The checks see an iron line": ("tab4.D1.B1.medium", "tab4.D1.B1.bright", "tab1.best.medium.B1"),
        "An embedding sees partial covering": (
            "tab1.best.medium.B2",
            "tab1.best.bright.B2",
            "tab1.best.bright.B3",
        ),
        "A gain of 3 per cent biases": ("gm.lin.medium", "gm.lin.bright"),
        "Marginalising leaves the bias": ("xc.fisher",),
        "At bright a flow loses": ("xc.bright.capture",),
        "A missed line biases": ("det.B1.dGamma.medium",),
    }
    rows = [line for line in front_page().splitlines() if "| **Holds" in line]
    told = [row for row in rows if "as far as it is decided" not in row]
    assert len(told) == len(rests)
    for start, names in rests.items():
        assert any(row.startswith(f"| {start}") for row in told), start
        for name in names:
            assert judgements[name].verdict is Agreement.AGREES, name
    null = [item.verdict for name, item in judgements.items() if re.match(r"grid\.pn\..*\.B4\.", name)]
    shown = sum(verdict is Agreement.AGREES for verdict in null)
    assert f"{shown} of {len(null)} cells are shown to lie near chance, none elsewhere" in front_page()
    assert Agreement.DIFFERS not in null


def test_rank_tests_of_bright_trainings_are_counted_on_both_responses():
    table = committed("calibration_nicer")
    mine = table["claim"].values == "cal.sbc.nicer.bright"
    nicer = (table["trained"].values[:, mine] < 0.05).sum(axis=1)
    table = committed("calibration_published")
    mine = (table["claim"].values == "tab2.production") & (table["part"].values == "failures")
    pn = table["trained"].values[:, mine].ravel()
    assert (len(pn), len(nicer)) == (4, 3)
    assert (pn.min(), pn.max(), nicer.min(), nicer.max()) == (2, 4, 3, 3)
    assert (
        "Of five rank tests at 5 per cent bright trainings fail 2 to 4 on EPIC-pn (4 trainings) and 3 on "
        "NICER (3 trainings)." in front_page()
    )


def test_cells_on_nicer_are_counted_on_the_front_page():
    cells = [item for item in from_committed(()).judgements if item.claim.id.startswith("grid.nicer.")]
    agree, differ = (sum(item.verdict is verdict for item in cells)
                     for verdict in (Agreement.AGREES, Agreement.DIFFERS))  # fmt: skip
    assert (len(cells), differ) == (117, 0)
    assert f"{agree} of 117 cells agree, none differ; AUCs of the line " in front_page()


def test_the_page_says_what_was_counted_twice_and_what_was_picked():
    text = committed_page()
    assert "its 3 of 5 are 2 of 4 networks" in text
    said = " ".join(text.split())
    assert "`xc.i22.flat` is 5.4 nats in the study's box and 0.37 in the wider one" in said
    # Counted from the kept shrinks of the pool.
    pool = committed("cross_check")["pool_medium"].values
    share = sum(0.9 <= value <= 1.03 for value in pool) / len(pool)
    assert f"a median of {sorted(pool)[len(pool) // 2]:.3f} by importance weights, and {share:.0%} of" in said
    rare = sum(value < 0.723 for value in pool) / len(pool)
    assert f"A share of {rare:.1%} of the medium ones" in said


def test_what_was_wrong_in_the_paper_is_in_its_text(shared_file):
    """Words in quotes are the paper's own, but for how they are broken into lines."""
    wrong = front_page().partition("Wrong in the paper")[2].partition("\n## ")[0]
    quoted = re.findall(r'"([^"]*)"', " ".join(wrong.split()))
    assert len(quoted) >= 6
    paper = " ".join(
        shared_file("paper/000_9b1c1b119f3046bf.txt").read_text(encoding="utf-8").split()
    ).lower()
    for words in quoted:
        assert words.lower() in paper, words


def test_numbers_of_what_was_wrong_are_measured():
    judgements = {item.claim.id: item for item in from_committed(()).judgements}
    gain = judgements["gm.g.width"].ours
    assert 0.875 < gain["least of all"] < gain["most of all"] < 0.905
    assert gain["least of all"] == pytest.approx(0.9 * gain["least"])
    assert gain["least"] > 0.95
    assert judgements["det.D3_floor_acc"].ours["value"] == pytest.approx(2 / 3)
    best = float(committed("detection")["best_of_nothing"].values[0])
    assert f"{best:.2f} by chance" in front_page()
    assert judgements["gm.PL.invariant"].ours["value"] < 1e-12
    twin = summaries(committed("evidence_pairs"))
    assert twin["medium", "seeded"]["scatter"] > 2**0.5 * twin["medium", "coupled"]["scatter"]
    swept = [claims()[f"is.sweep.{amplitude}pc"] for amplitude in (1, 10)]
    fall = abs(swept[0].value - 0.5) - abs(swept[1].value - 0.5)
    assert fall < np.hypot(*(claim.error["value"] for claim in swept))


def test_the_page_says_which_trainings_there_are_not():
    """34 were fixed: five on EPIC-pn and three on NICER at each level, five with a gain at two of them."""
    said = " ".join(committed_page().split())
    stopped = ("cut", "uncapped")
    made = [path.stem for path in FLOWS.glob("*.json") if path.stem.rpartition("-")[2] not in stopped]
    gain, nicer = (sum(word in name for name in made) for word in ("-gain", "nicer-"))
    plain = len(made) - gain - nicer
    assert nicer == 9
    assert (
        f"Of 34 trainings of its network fixed beforehand {len(made)} are made; lacking are "
        f"{15 - plain} on EPIC-pn with a fixed one, {10 - gain} with a free gain." in said
    )
    for recipe, planned in (("epic-pn-faint", 5), ("epic-pn-bright", 5), ("epic-pn-bright-gain", 5)):
        there = sum(name.partition("-seed")[0] == recipe for name in made)
        assert f"{planned - there} of `{recipe}`" in said
    curve = committed("learning_curve") is not None
    assert ("9 more trainings, is not made either" in said, "## Its learning curve" in said) == (
        not curve,
        curve,
    )


def test_every_change_of_the_judge_is_on_the_page_with_what_it_did():
    text = committed_page()
    rows = text.partition("## Rules that were made or changed")[2].partition("\n## ")[0]
    assert rows.count("| this list |") == 11
    for entry in changes()["change"]:
        assert entry["what"] in rows
        assert entry["did"] in rows
    decided = ("agrees", "differs", "undecided")
    judged = [item for item in from_committed(()).judgements if item.claim.counted is Counted.JUDGED]
    old = [before()[item.claim.id][1] for item in judged]
    new = [item.verdict.value for item in judged]
    counts = [", ".join(str(every.count(verdict)) for verdict in decided) for every in (old, new)]
    assert f"trained since, they took {counts[0]} to {counts[1]}" in " ".join(rows.split())


def test_the_capped_network_stands_beside_its_recipe():
    """In the range of 90 of 100 trainings, by ours; the published deviation is far outside."""
    text = committed_page().partition("## The capped network against its recipe")[2].partition("\n## ")[0]
    (row,) = [line for line in text.splitlines() if line.startswith("| `cal.dev.pn.bright`")]
    *_, published, ours, within, place, _ = (
        row.split(" | ") if row.endswith(" | ") else [*row.split(" | "), ""]
    )
    assert place.strip(" |") == "outside"
    assert published == "0.114"
    low, high = map(float, within.split(" to "))
    values = [float(value) for value in ours.split(", ")]
    assert len(values) == 4
    assert low < min(values) <= max(values) < high < 0.06


def test_the_page_names_flows_that_were_trained_again(monkeypatch):
    table = xr.Dataset(attrs={"says": "ours on NICER", "flows": '{"shipped:a": "one", "shipped:b": "two"}'})
    monkeypatch.setattr(experiment, "weights_of", {"shipped:a": "one", "shipped:b": "two"}.get)
    assert "| ours on NICER |" in page({"calibration_nicer": table}, {}, (), {})
    monkeypatch.setattr(experiment, "weights_of", {"shipped:a": "one", "shipped:b": "three"}.get)
    said = page({"calibration_nicer": table}, {}, (), {})
    assert "| ours on NICER; made before these were trained again: `shipped:b` |" in said
