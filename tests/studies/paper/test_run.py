"""From names to files and an exit code."""

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
from studies.paper.family import Family
from studies.paper.page import page
from studies.paper.paper_flow.shipped import FLOWS
from studies.paper.run import Reproduction, as_dataset, needed

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
    few = Family(name="a", cells=48, paired=0, misses=5, expected=4.0, most=9, p=0.4, adjusted=0.4)
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
    assert "unexplained" in text


def test_the_page_has_every_claim_once():
    every = tuple(judge(claim, None) for claim in claims().values())
    text = page({}, every, (), {})
    for name in claims():
        assert name.startswith("grid.") or text.count(f"`{name}`") == 1, name
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
        "cal.dev.pn.bright", "is.khat.bright.clean", "grid.pn.medium.B1.5e-06.D3",
    }  # fmt: skip
    assert not [entry for entry in result.families if entry.adjusted < 0.05]
    # Each either decided, or with what would settle it.
    assert all(bool(item.settles) == (item.verdict is Agreement.UNDECIDED) for item in result.judgements)


def test_the_front_page_says_what_was_counted_twice_and_what_was_picked():
    text = (DOCS / "reproduction.md").read_text()
    assert "its 3 of 5 are 2 of 4 networks" in text
    said = " ".join(text.split())
    assert "`xc.i22.flat` is 5.4 nats in the study's box and 0.37 in the wider one" in said
    # Counted from the kept shrinks of the pool.
    pool = committed("cross_check")["pool_medium"].values
    share = sum(0.9 <= value <= 1.03 for value in pool) / len(pool)
    assert f"a median of {sorted(pool)[len(pool) // 2]:.3f} by importance weights, and {share:.0%} of" in said
    rare = sum(value < 0.723 for value in pool) / len(pool)
    assert f"A share of {rare:.1%} of the medium ones" in said


def test_the_front_page_says_what_scripts_and_outputs_have_otherwise():
    text = (DOCS / "reproduction.md").read_text()
    wrong = text.partition("## What was wrong")[2].partition("\n## ")[0]
    assert "`tab2.reseed101` (another seed, 101" in wrong
    assert "drew training sets of their own, against the caption" in wrong
    assert "`pair.sd`" in wrong
    assert "the same seed is not the same noise" in wrong
    for section in ("Count-controlled residuals", "Time"):
        assert f"(*{section}*)" in " ".join(wrong.split())
        assert f"\n**{section}" in text


def test_the_front_page_says_which_trainings_there_are_not():
    """34 were fixed: five on EPIC-pn and three on NICER at each level, five with a gain at two of them."""
    said = " ".join((DOCS / "reproduction.md").read_text().split())
    stopped = ("cut", "uncapped")
    made = [path.stem for path in FLOWS.glob("*.json") if path.stem.rpartition("-")[2] not in stopped]
    assert f"Of 34 trainings of the study's network that were fixed beforehand {len(made)} are made." in said
    for recipe, planned in (("epic-pn-bright", 5), ("nicer-medium", 3), ("epic-pn-bright-gain", 5)):
        there = sum(name.partition("-seed")[0] == recipe for name in made)
        assert f"{planned - there} of `{recipe}`" in said
    assert "9 more trainings, is not made either" in said


def test_the_page_names_flows_that_were_trained_again(monkeypatch):
    table = xr.Dataset(attrs={"says": "ours on NICER", "flows": '{"shipped:a": "one", "shipped:b": "two"}'})
    monkeypatch.setattr(experiment, "weights_of", {"shipped:a": "one", "shipped:b": "two"}.get)
    assert "| ours on NICER |" in page({"calibration_nicer": table}, {}, (), {})
    monkeypatch.setattr(experiment, "weights_of", {"shipped:a": "one", "shipped:b": "three"}.get)
    said = page({"calibration_nicer": table}, {}, (), {})
    assert "| ours on NICER; made before these were trained again: `shipped:b` |" in said
