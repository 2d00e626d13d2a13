"""The flows that ship and their final audits: promised for all, opened once, put together whole."""

import json
import re
import shutil
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("jaxspec")
pytest.importorskip("torch")
from studies import shipped
from studies.__main__ import main
from studies.kit.results import DOCS, RESULTS, read

import gaugeblock as gb
from gaugeblock.core.errors import InputError
from gaugeblock.estimators.npe.shipped import reference_model_path
from gaugeblock.validate import Outcome
from gaugeblock.validate.trials import group_trials

MODELS = reference_model_path().parent
FLOW = "epic-pn-medium"
COMMITS = {"HEAD": "c0ffee", "HEAD~1": "decade"}
"""In place of git's: the seeds of a test do not change with every commit, and need no history."""


@pytest.fixture(scope="module", autouse=True)
def commits():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shipped, "committed", lambda root, name: COMMITS[name])
        yield


def test_every_flow_that_ships_is_promised():
    assert set(shipped.PROMISES) == {path.parent.name for path in MODELS.glob("*/model.json")}
    assert shipped.PROMISES["epic-pn-bright"].policy == "strict"
    assert shipped.PROMISES["nicer-bright"].policy == "default"
    assert shipped.PROMISES["epic-pn-bright"].trials == 10_000
    assert shipped.PROMISES["epic-pn-bright"].importance_draws == 4_000
    assert shipped.PROMISES["nicer-bright"].trials == 4_000
    assert {promise.trainings for promise in shipped.PROMISES.values()} == {3}
    more = {name: promise.further for name, promise in shipped.PROMISES.items() if promise.further}
    assert more == {"epic-pn-bright-gain": 1}


def test_every_training_is_in_the_log(capsys):
    assert main(["shipped", "--log"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name, promise in shipped.PROMISES.items():
        weights = json.loads((MODELS / name / "model.json").read_text())["sha256"][:12]
        mine = [line for line in lines if weights in line]
        assert sum("  training  " in line for line in mine) == 1, name
        assert any("  final " in line for line in mine), name
        assert all(re.match(r"2026-11-\d\d  ", line) for line in mine), name
        every = [line for line in lines if f" {name} " in line and "  training  " in line]
        assert 1 <= len(every) <= promise.trainings + promise.further, name
        openings = {line.split()[2] for line in lines if f" {name} " in line and "  final " in line}
        assert shipped.history(name) == {
            "trainings": len(every),
            "promised": promise.trainings,
            "final_audits": len(openings),
        }
    assert any("epic-pn-bright-gain" in line and "FAIL" in line for line in lines)
    assert any("epic-pn-faint" in line and "INCONCLUSIVE" in line for line in lines)
    assert sum("  final " in line and "108 to 1080 s" in line for line in lines) == 3


def audit_of(seed, number):
    rng = np.random.default_rng(seed)
    theta, draws = rng.normal(size=(number, 2)), rng.normal(size=(number, 30, 2))
    return gb.audit_draws(theta, draws, policy="strict", seed=1)


def test_two_audits_become_one_of_all_their_trials():
    parts = [audit_of(1, 40), audit_of(2, 60)]
    both = shipped.together(parts, [8, 9], command="this")
    for name in ("theta_true", "draws"):
        expected = np.concatenate([part.trials[name].values for part in parts])
        np.testing.assert_array_equal(both.trials[name].values, expected)
    assert both.gates["sbc.bias[theta_1]"].tolerance == 0.05
    assert both.gates["sbc.bias[theta_1]"].n_trials == 100
    assert both.verdict.provenance["command"] == "this"
    assert both.verdict.provenance["trials"] == {"number": 100, "seeds": ["8", "9"]}


def test_the_first_table_says_who_was_trained_or_opened_more_often():
    page = (DOCS / "training.md").read_text().partition("<!-- shipped flows -->")[2]
    said = dict(re.findall(r"^\| `([\w-]+)`.* \| (.*?) \|$", page.partition("<!-- /")[0], flags=re.MULTILINE))
    twice = "; final seeds opened twice"
    assert said == {
        **dict.fromkeys(("epic-pn-faint", "epic-pn-medium", "epic-pn-medium-gain"), "1"),
        **{"nicer-faint": "1", "nicer-medium": "1", "nicer-bright": "2", "epic-pn-bright": f"2{twice}"},
        "epic-pn-bright-gain": f"**4, 3 were promised**{twice}",
        "epic-pn-exposures": f"3{twice}",
    }


@pytest.fixture(scope="module")
def twin(tmp_path_factory, xray_data):
    """Two small audits of one flow, and one of both."""
    out = tmp_path_factory.mktemp("shipped")
    (out / "models" / FLOW).mkdir(parents=True)
    with pytest.MonkeyPatch.context() as patch:
        # A tenth of the draws: each has a likelihood.
        patch.setattr(shipped, "PROMISES", {**shipped.PROMISES, FLOW: shipped.Promise("strict", 60, 400)})
        assert main(["shipped", FLOW, "--out", str(out), "--models", str(out / "models")]) == 0
    return out


def test_a_flow_has_two_audits_and_one_of_both(twin):
    rows = shipped._rows(read(twin / "shipped.nc"))
    assert [row["audit"] for row in rows] == ["first", "second", "both"]
    assert [row["trials"] for row in rows] == [60, 60, 120]
    assert len({row["seed"] for row in rows}) == 2
    assert {row["policy"] for row in rows} == {"strict"}
    # So few trials settle nothing, and the flow is not bad enough to be blocked by them.
    assert {row["outcome"] for row in rows} == {"INCONCLUSIVE"}
    first, second, both = (row["efficiency"] for row in rows)
    assert min(first, second) <= both <= max(first, second)
    assert 0.8 < both < 1.0
    assert "sbc.log_width (5)" in rows[0]["open"]
    assert not rows[2]["failed"]


def test_trials_are_drawn_from_the_commit_and_both_groups_are_put_together(twin):
    from gaugeblock.auditing.stored import stored_audit

    folders = sorted((twin / "checkpoints").iterdir())
    assert len(folders) == 2
    audits = [stored_audit(folder) for folder in folders]
    groups = [group_trials(one.trials, name) for one in audits for name in ("importance", "joint")]
    assert [group.sizes["trial"] for group in groups] == [60] * 4
    assert [group.sizes["draw"] for group in groups] == [400, 100] * 2
    assert not np.array_equal(*(one.trials["theta_true"].values for one in audits))
    both = shipped.together(audits, [1, 2])
    for at, name in enumerate(("importance", "joint")):
        own = group_trials(both.trials, name)
        expected = np.concatenate([group["log_likelihood"].values for group in groups[at::2]])
        np.testing.assert_array_equal(own["log_likelihood"].values, expected)


def test_the_verdict_of_both_lies_beside_the_weights(twin):
    verdict = json.loads((twin / "models" / FLOW / "verdict.json").read_text())
    assert verdict["verdict"] == "INCONCLUSIVE"
    said = verdict["provenance"]
    assert said["estimator"]["sha256"] == json.loads((MODELS / FLOW / "model.json").read_text())["sha256"]
    assert {name: said["trials"][name] for name in ("number", "importance_number", "joint_number")} == {
        "number": 120,
        "importance_number": 120,
        "joint_number": 120,
    }
    assert said["trials"]["seeds"] == [row["seed"] for row in shipped._rows(read(twin / "shipped.nc"))][:2]
    assert said["command"] == f"python -m studies shipped {FLOW} --commit c0ffee"
    assert said["history"] == {"trainings": 1, "promised": 3, "final_audits": 1}


def test_final_trials_are_looked_at_once(twin, tmp_path, capsys):
    shutil.copy(twin / "shipped.nc", tmp_path)
    before = read(tmp_path / "shipped.nc")
    assert main(["shipped", FLOW, "--commit", "HEAD~1", "--out", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert f"{FLOW} was audited on trials of c0ffee" in said
    assert "--out" in said
    assert read(tmp_path / "shipped.nc").identical(before)


def test_a_flow_that_does_not_ship_is_named(tmp_path):
    with pytest.raises(InputError, match="no flow 'mine' ships; there are epic-pn-faint"):
        shipped._named(["mine"])
    assert shipped._named([]) == list(shipped.PROMISES)


def test_a_flow_for_many_exposures_is_audited_in_each_range_and_judged_by_the_worst(tmp_path, monkeypatch):
    ranges = ((1.0, 10.0), (10.0, 100.0), (100.0, 1000.0))
    promise = shipped.Promise("strict", 60, 400, exposures=ranges)
    parts = ["1 to 10 s", "10 to 100 s", "100 to 1000 s"]
    assert list(promise.parts) == parts
    assert promise.parts["10 to 100 s"] == {
        "exposure": {"distribution": "log_uniform", "low": 10.0, "high": 100.0}
    }
    seen = []

    def audited(name, part, seed, work):
        seen.append((part, seed))
        rng = np.random.default_rng(seed)
        theta, draws = rng.normal(size=(60, 1)), rng.normal(size=(60, 30, 1))
        # The second range is as wrong as can be.
        return gb.audit_draws(theta + 9.0 * (part == parts[1]), draws, policy="strict", seed=1)

    def row(name, part, which, seed, audit):
        outcome = audit.outcome.value
        return {"flow": name, "part": part, "audit": which, "seed": str(seed), "outcome": outcome}

    monkeypatch.setattr(shipped, "PROMISES", {FLOW: promise})
    for name, other in (("audited", audited), ("row", row), ("shown", lambda made: "")):
        monkeypatch.setattr(shipped, name, other)
    (tmp_path / "models" / FLOW).mkdir(parents=True)
    assert main(["shipped", FLOW, "--out", str(tmp_path), "--models", str(tmp_path / "models")]) == 0
    assert [part for part, _ in seen] == [part for part in parts for _ in range(2)]
    assert len({seed for _, seed in seen}) == 6
    rows = shipped._rows(read(tmp_path / "shipped.nc"))
    assert [(one["part"], one["audit"]) for one in rows] == [
        (part, which) for part in parts for which in shipped.AUDITS
    ]
    assert [one["outcome"] for one in rows] == [*["INCONCLUSIVE"] * 3, *["FAIL"] * 3, *["INCONCLUSIVE"] * 3]
    verdict = json.loads((tmp_path / "models" / FLOW / "verdict.json").read_text())
    assert verdict["verdict"] == "FAIL"
    assert shipped._called(rows[0]) == f"`{FLOW}`, 1 to 10 s"


def test_the_worst_of_several_audits_is_the_nearest_to_a_tolerance_of_those_with_the_worst_outcome():
    class Said:
        def __init__(self, outcome, **gates):
            self.outcome = Outcome(outcome)
            self.gates = {
                name: SimpleNamespace(id=name.replace("_", "."), statistic=statistic, tolerance=tolerance)
                for name, (statistic, tolerance) in gates.items()
            }

    near = Said("PASS", joint_likelihood=(-0.039, 0.03), draws_finite=(0.0, 0.0), sbc_bias=(0.04, 0.1))
    far = Said("PASS", joint_likelihood=(0.02, 0.03), importance_ess=(0.9, 0.1), sbc_bias=(-0.08, 0.1))
    assert shipped.worst([far, near]) is shipped.worst([near, far]) is near
    # Half of what is asked for is twice as far as may be.
    wasteful = Said("PASS", importance_ess=(0.05, 0.1), sbc_bias=(0.0, 0.1))
    assert shipped.worst([near, wasteful]) is wasteful
    failed = Said("FAIL", sbc_bias=(0.01, 0.1))
    assert shipped.worst([near, failed, wasteful]) is failed


def test_an_estimate_beyond_its_tolerance_is_bold_and_of_parts_one_has_a_verdict(tmp_path, monkeypatch):
    ranges = ((1.0, 10.0), (10.0, 100.0))
    monkeypatch.setattr(shipped, "PROMISES", {FLOW: shipped.Promise("strict", 60, 400, exposures=ranges)})
    own = {"distribution": "log_uniform", "low": 10.0, "high": 100.0}
    (tmp_path / FLOW).mkdir()

    def told(statistic):
        gate = {
            "id": "joint.likelihood",
            "statistic": statistic,
            "interval": [-0.05, 0.01],
            "tolerance": 0.03,
        }
        said = {"provenance": {"simulator": {"exposure": own}}, "gates": [gate]}
        (tmp_path / FLOW / "verdict.json").write_text(json.dumps(said))
        parts = ("1 to 10 s", "10 to 100 s")
        return [shipped._likelihood({"flow": FLOW, "part": part}, tmp_path) for part in parts]

    assert told(-0.0301) == ["", "**-0.030 (-0.050 to 0.010) of 0.03**"]
    assert told(-0.03) == ["", "-0.030 (-0.050 to 0.010) of 0.03"]


def test_an_audit_of_a_range_has_its_simulator_and_a_folder_of_its_own(tmp_path, monkeypatch):
    ranges = ((1.0, 10.0), (10.0, 100.0))
    monkeypatch.setattr(shipped, "PROMISES", {FLOW: shipped.Promise("strict", 60, 400, exposures=ranges)})
    asked = []
    monkeypatch.setattr(
        shipped.gb, "audit", lambda *given, out, **options: asked.append((given, out, options))
    )
    for part in shipped.PROMISES[FLOW].parts:
        shipped.audited(FLOW, part, 3, tmp_path)
    given, folders, options = zip(*asked, strict=True)
    table = json.loads((MODELS / FLOW / "model.json").read_text())["simulator_table"]
    assert [one[0] for one in given] == [f"shipped:{FLOW}"] * 2
    assert [one[1] for one in given] == [
        {**table, "exposure": {"distribution": "log_uniform", "low": low, "high": high}}
        for low, high in ranges
    ]
    assert len(set(folders)) == 2
    assert all(folder.parent == tmp_path for folder in folders)
    assert options[0]["trials"] == {"number": 60, "joint_number": 60, "importance_draws": 400}
    assert (options[0]["policy"], options[0]["seed"]) == ("strict", 3)


def test_the_page_shows_what_is_stored(twin, tmp_path):
    shutil.copy(DOCS / "training.md", tmp_path)
    folders = ["--out", str(twin), "--docs", str(tmp_path), "--models", str(twin / "models")]
    assert main(["shipped", "--page", *folders]) == 0
    page = (tmp_path / "training.md").read_text()
    gates = json.loads((twin / "models" / FLOW / "verdict.json").read_text())["gates"]
    gate = next(one for one in gates if one["id"] == "joint.likelihood")
    low, high = gate["interval"]
    said = f"{gate['statistic']:.3f} ({low:.3f} to {high:.3f}) of 0.03"
    assert f" | {said} |" in page or f" | **{said}** |" in page
    assert f"| `{FLOW}` | both | strict | 120 | INCONCLUSIVE | - | sbc" in page
    assert (
        f"| `{FLOW}` | default | 400,000 | 12,000 | - | -0.410 | INCONCLUSIVE, strict, 120 trials |" in page
    )


def test_the_page_is_of_what_is_committed(tmp_path):
    shutil.copy(DOCS / "training.md", tmp_path)
    assert main(["shipped", "--page", "--docs", str(tmp_path)]) == 0
    assert (tmp_path / "training.md").read_text() == (DOCS / "training.md").read_text()


def test_flows_whose_joint_likelihood_lies_beyond_what_is_tolerated_are_named_on_the_page():
    page = (DOCS / "training.md").read_text()
    bold = {line.split("`")[1] for line in page.splitlines() if re.match(r"\| `.*\*\*-0\.\d+ ", line)}
    others = {"epic-pn-medium", "epic-pn-bright", "nicer-medium"}
    assert bold == others | {"epic-pn-bright-gain", "epic-pn-exposures"}
    named = page.partition("Of five flows of nine")[2].partition("\n\n")[0]
    assert others == set(re.findall("`(.*?)`", named))
    assert len(shipped.PROMISES) == 9


@pytest.mark.parametrize("name", shipped.PROMISES)
def test_a_flow_ships_with_the_verdict_of_its_final_audits(name):
    made = read(RESULTS / "shipped.nc")
    rows = [row for row in shipped._rows(made) if (row["flow"], row["audit"]) == (name, "both")]
    promise = shipped.PROMISES[name]
    assert [row["part"] for row in rows] == list(promise.parts)
    verdict = json.loads((MODELS / name / "verdict.json").read_text())
    assert verdict["provenance"]["history"] == shipped.history(name)
    weights = json.loads((MODELS / name / "model.json").read_text())["sha256"][:12]
    assert {row["weights"] for row in rows} == {weights}
    assert {row["policy"] for row in rows} == {promise.policy}
    number = verdict["provenance"]["trials"]["number"]
    assert {row["trials"] for row in rows} == {2 * promise.trials} == {number}
    # The worst of its parts speaks for it, and of those alike the one that leaves most open.
    worst = next(
        said for said in ("FAIL", "INCONCLUSIVE", "PASS") if said in {row["outcome"] for row in rows}
    )
    assert verdict["verdict"] == worst
    own = verdict["provenance"]["simulator"].get("exposure")
    part = next(part for part, given in promise.parts.items() if given.get("exposure") == own)
    open_beside = {row["part"]: row["open_beside"] for row in rows if row["outcome"] == worst}
    assert len(open_beside[part].split(", ")) == max(len(said.split(", ")) for said in open_beside.values())
