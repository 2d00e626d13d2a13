"""What was fixed is what is committed, and what is judged by."""

import json

import pytest
from studies.paper import claims
from studies.paper.claim import Counted
from studies.paper.fixed import DIGEST, FILE, digest, text
from studies.paper.registry import repeats
from studies.paper.verdict_tables import before, changes


def test_rules_margins_and_seeds_are_those_that_were_committed():
    assert FILE.read_text(encoding="utf-8") == text()
    assert DIGEST.read_text().strip() == digest(text())


def test_every_claim_is_in_it_with_its_margins():
    content = json.loads(text())
    assert content["confidence"] == 0.9
    assert list(content["claims"]) == list(claims())
    cell = content["claims"]["grid.pn.faint.B4.1.D1"]
    assert cell["margins"] == [["value", "", pytest.approx(0.42), pytest.approx(0.58)]]
    assert content["claims"]["tab3.bright.B1.seed0"]["margins"][0] == ["value", "", 0.74, 0.9]
    assert {entry["seed"] for entry in content["claims"].values()} == {20260611}


def test_every_recipe_is_trained_as_often_as_was_said():
    trainings = json.loads(text())["trainings"]
    of_bright = {name: entry for name, entry in trainings.items() if name.startswith("epic-pn-bright")}
    assert trainings["epic-pn-bright"]["data_seed"] == 20260611 + 13
    assert trainings["epic-pn-medium-gain-seed404"] == {
        "response": "epic-pn", "level": "medium", "data_seed": 404, "torch_seed": 404, "cap": 150,
        "simulations": 50_000, "gain": True,
    }  # fmt: skip
    assert sum(entry["gain"] for entry in of_bright.values()) == 5
    assert len([name for name in of_bright if name.endswith(("bright", "gain", "1", "2", "3", "4"))]) == 10
    assert sum(name.startswith("nicer-") for name in trainings) == 9


def test_classes_are_counted():
    numbers = {kind: sum(claim.counted is kind for claim in claims().values()) for kind in Counted}
    assert numbers == {
        Counted.JUDGED: 362, Counted.REPORTED: 13, Counted.REPEATED: 56, Counted.RECOMPUTED: 46,
    }  # fmt: skip
    assert {name for name, claim in claims().items() if claim.chosen} == {
        "xc.bright.sigma_eff", "xc.med.shrink", "xc.i22.flat",
    }  # fmt: skip
    assert repeats("tab4.IS.B1.bright") == "tab3.*.seed0"
    assert not repeats("tab3.bright.B1.seed0")


def test_what_the_list_only_asks_to_report_is_reported(shared_file):
    targets = json.loads(shared_file("paper/paper_targets.json").read_text())["targets"]
    asked = {t["id"] for t in targets if str(t["tolerance"].get("must_hold", "")).startswith("report")}
    assert asked == {name for name, claim in claims().items() if claim.counted is Counted.REPORTED}


def test_the_verdicts_of_both_judges_before_are_kept():
    assert set(before()) == set(claims())
    first, second = ([verdicts[k] for verdicts in before().values()] for k in (0, 1))
    assert first.count("agrees") == 427
    judged = [before()[name][1] for name, claim in claims().items() if claim.counted is Counted.JUDGED]
    assert [judged.count(word) for word in ("agrees", "differs", "undecided")] == [87, 3, 269]
    assert len(second) == 477
    assert len(changes()["digest_before"]) == 64
    assert changes()["digest_before"] != digest(text())


def test_rules_say_whose_network_they_speak_of():
    content = json.loads(text())["claims"]
    of = {name: entry["network"] for name, entry in content.items() if "network" in entry}
    assert sorted(name for name, network in of.items() if network == "undertrained") == [
        "cal.conformal.pn.bright", "cal.cov.pn.bright.50", "cal.cov.pn.bright.68", "cal.cov.pn.bright.90",
        "cal.dev.pn.bright", "cal.recovery.r", "cal.sbc.pn.bright", "is.essfrac.bright",
        "is.khat.bright.clean", "is.lowess.bright", "tab2.production",
    ]  # fmt: skip
    assert of["tab2.reseed101"] == "stopped"
    assert set(of.values()) == {"undertrained", "stopped"}
    # What needs no flow is of no network.
    assert not {"gm.lin.medium", "xc.fisher", "gm.prior"} & set(of)
    # Of the study's network, trained again.
    assert not {name for name in of if name.startswith(("gm.", "cf.", "xc.")) or "nicer" in name}


def test_every_rule_of_the_list_for_an_undertrained_flow_is_taken_as_one(shared_file):
    targets = json.loads(shared_file("paper/paper_targets.json").read_text())["targets"]
    asked = {
        t["id"]
        for t in targets
        if "undertrained" in str(t["tolerance"].get("must_hold", "")).partition("; production-like")[0]
    }
    assert asked == {
        "cal.dev.pn.bright", "cal.sbc.pn.bright", "is.lowess.bright", "is.essfrac.bright",
        "is.khat.bright.clean",
    }  # fmt: skip
    assert {claims()[name].network for name in asked} == {"undertrained"}
