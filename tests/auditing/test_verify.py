"""Every edit of a file that is derived from the trials shows, and nothing else does."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from gaugeblock.auditing.audit import audit
from gaugeblock.auditing.audit_draws import audit_draws
from gaugeblock.auditing.compare import NEAR
from gaugeblock.auditing.config import TrialsTable
from gaugeblock.auditing.judging import judge
from gaugeblock.auditing.verify import verify
from gaugeblock.cli import app
from gaugeblock.core.digest import file_digest
from gaugeblock.core.errors import InputError
from gaugeblock.estimators.exact import Exact
from gaugeblock.simulators import build_simulator
from gaugeblock.validate import (
    make_policy,
    make_trials,
    read_findings,
    read_policy,
    read_trials,
    write_findings,
    write_trials,
)

SELECT = ("draws", "sbc", "coverage", "importance")


@pytest.fixture(scope="module")
def audited(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a small audit, which no test may change."""
    folder = tmp_path_factory.mktemp("audited")
    simulator = build_simulator("linear_gaussian", parameters=1, data=1)
    plan = TrialsTable(number=60, draws=40, importance_number=50, importance_draws=60, seed=4)
    policy = read_policy("default")
    audit(Exact(simulator), simulator, trials=plan, out=folder, policy=policy, validators=SELECT)
    return folder


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an audit that takes no time."""
    folder = tmp_path_factory.mktemp("tiny")
    draws = np.random.default_rng(2).standard_normal((12, 5, 1))
    write_trials(make_trials(np.zeros((12, 1)), draws, ["a"]), folder / "t.nc")
    audit_draws(folder / "t.nc", out=folder / "out", validators=("draws",))
    return folder / "out"


@pytest.fixture
def folder(audited: Path, tmp_path: Path) -> Path:
    """A copy to be edited."""
    return Path(shutil.copytree(audited, tmp_path / "copy"))


def rewritten(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def edited(path: Path, change: Any) -> None:
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content, indent=2, sort_keys=True, ensure_ascii=False) + "\n")


def test_an_audit_as_it_was_written_is_the_same(audited: Path) -> None:
    found = verify(audited)
    assert found.differences == ()
    assert found.notes == ()
    assert verify(audited, trials_sha256=found.trials_sha256.upper()).differences == ()


def test_an_anytime_audit_is_the_same(tmp_path: Path) -> None:
    simulator = build_simulator("linear_gaussian", parameters=1, data=1)
    plan = TrialsTable(number=100, draws=40, block=50, importance_number=0, joint_number=0)
    policy = read_policy("default")
    audit(
        Exact(simulator),
        simulator,
        trials=plan,
        out=tmp_path,
        policy=policy,
        validators=("draws", "sbc"),
        anytime=True,
    )
    assert "anytime" in json.loads((tmp_path / "verdict.json").read_text())["provenance"]["validators"]
    assert verify(tmp_path).differences == ()


def test_draws_from_disk_and_what_was_judged_again_are_the_same(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    x = rng.standard_normal((300, 2))
    theta, draws = x + rng.standard_normal((300, 2)), x[:, None] + rng.standard_normal((300, 50, 2))
    write_trials(make_trials(theta, draws, ["a", "b"]), tmp_path / "t.nc")
    policy = read_policy("default")
    audit_draws(tmp_path / "t.nc", out=tmp_path / "first", policy=policy, seed=3, validators=("draws", "sbc"))
    assert verify(tmp_path / "first").differences == ()
    strict = make_policy({"tolerance": {"bias": 0.02}}, source="here", base=policy)
    judge(tmp_path / "first", strict, out=tmp_path / "second", seed=8)
    with pytest.raises(InputError, match="give the audit's Trials with --trials"):
        verify(tmp_path / "second")
    assert verify(tmp_path / "second", trials=tmp_path / "first" / "trials.nc").differences == ()
    judge(tmp_path / "first", strict, out=tmp_path / "first", seed=8)
    assert verify(tmp_path / "first").differences == ()


def test_one_edit_in_each_file_is_one_line_of_that_file(folder: Path) -> None:
    """A statistic's last bit, the verdict, a status, a line, a number, a value of the card; and no more."""
    findings, not_checked = read_findings(folder / "findings.nc")
    chosen = next(finding for finding in findings if finding.id == "sbc.bias[theta_1]")
    chosen.estimate[0] = np.nextafter(chosen.estimate[0], 1.0)
    write_findings(findings, not_checked, folder / "findings.nc")
    content = json.loads((folder / "verdict.json").read_text())
    edited(folder / "verdict.json", lambda content: content.update(verdict="FAIL"))
    rewritten(folder / "junit.xml", 'failures="0"', 'failures="1"')
    rewritten(folder / "summary.md", "| trials |", "| trails |")
    rewritten(folder / "report.html", f"{abs(content['gates'][1]['statistic']):.3f}", "0.000")
    rewritten(folder / "model_card.md", f"value: {content['verdict']}", "value: GOOD")
    lines = verify(folder).differences
    said = dict(line.split(": ", 1) for line in lines)
    assert len(said) == len(lines) == 6
    assert "sbc.bias[theta_1]: estimate is" in said["findings.nc"]
    assert "verdict is 'FAIL', should be" in said["verdict.json"]
    assert 'failures="1"' in said["junit.xml"]
    assert "line 5 is" in said["summary.md"]
    assert said["report.html"].startswith("line")
    assert "line 18 is" in said["model_card.md"]
    assert not [line for line in lines if "\n" in line]


def test_a_finding_that_was_taken_out(folder: Path) -> None:
    findings, not_checked = read_findings(folder / "findings.nc")
    write_findings(findings[:-1], not_checked, folder / "findings.nc")
    found = verify(folder).differences
    assert any(f"{findings[-1].id} is missing" in line for line in found)


def test_gates_of_the_verdict(folder: Path) -> None:
    def change(content: Any) -> None:
        content["gates"][0].update(message="all is well")
        content["gates"][1].update(verdict="FAIL", tolerance=9.0)
        content["gates"].pop()

    edited(folder / "verdict.json", change)
    missing, message, tolerance, word = sorted(
        verify(folder).differences, key=lambda line: "is missing" not in line
    )
    assert missing.startswith("verdict.json: ")
    assert "is missing" in missing
    assert "gates[draws.finite].message is 'all is well', should be 'no draw" in message
    assert tolerance == "verdict.json: gates[sbc.bias[theta_1]].tolerance is 9.0, should be 0.1"
    assert word.startswith("verdict.json: gates[sbc.bias[theta_1]].verdict is 'FAIL'")


def test_the_space_between(folder: Path) -> None:
    rewritten(folder / "verdict.json", "{\n", "{\n\n")
    assert verify(folder).differences == ("verdict.json: other bytes, the same content",)


def test_a_file_that_is_gone_or_empty(folder: Path) -> None:
    (folder / "report.html").unlink()
    (folder / "summary.md").write_text("")
    (folder / "findings.nc").write_bytes(b"CDF")
    said = dict(line.split(": ", 1) for line in verify(folder).differences)
    assert set(said) == {"findings.nc", "summary.md", "report.html"}
    assert said["findings.nc"].startswith("cannot be read as NetCDF")
    assert "is missing" in said["summary.md"]
    assert "cannot be read" in said["report.html"]


def test_what_is_recorded_of_the_estimator_and_the_policy(folder: Path) -> None:
    def change(content: Any) -> None:
        content["provenance"]["estimator"]["class"] = "somebody.Else"

    edited(folder / "verdict.json", change)
    found = verify(folder).differences
    assert any("provenance: sha256.estimator" in line for line in found)
    assert any(line.startswith("report.html") for line in found)


def test_another_policy_or_seed_in_the_record(folder: Path) -> None:
    def change(content: Any) -> None:
        content["provenance"]["policy"]["tolerance"]["bias"] = 0.5
        content["provenance"]["seed"] = 5

    edited(folder / "verdict.json", change)
    found = verify(folder).differences
    assert any("sha256.policy" in line for line in found)
    assert any(line.startswith("verdict.json: gates[sbc.bias[theta_1]].tolerance is 0.1") for line in found)
    assert any(line.startswith("findings.nc: sbc.uniform[theta_1]") for line in found)


def test_an_edit_of_the_trials_shows_against_either_digest(folder: Path) -> None:
    kept = verify(folder).trials_sha256
    tree = read_trials(folder / "trials.nc")
    tree["theta_true"][0, 0] += 1.0
    write_trials(tree, folder / "trials.nc")
    found = verify(folder).differences
    assert f"verdict.json says {kept}" in found[0]
    assert any(line.startswith("findings.nc: sbc.bias[theta_1]") for line in found)
    # Whoever makes everything anew is only seen against what is kept elsewhere.
    record = json.loads((folder / "verdict.json").read_text())["provenance"]
    audit_draws(folder / "trials.nc", out=folder, seed=record["seed"], validators=SELECT)
    assert verify(folder).differences == ()
    (line,) = verify(folder, trials_sha256=kept).differences
    assert line.startswith("trials.nc: ")
    assert line.endswith("that was kept elsewhere")


def test_other_versions_mean_a_tolerance_and_that_is_said(folder: Path) -> None:
    def change(content: Any) -> None:
        content["provenance"]["versions"]["numpy"] = "1.0"
        content["gates"][1]["statistic"] *= 1 + 1e-9
        content["gates"][2]["statistic"] *= 1.01

    edited(folder / "verdict.json", change)
    found = verify(folder)
    assert "numpy 1.0 there" in found.notes[0]
    assert "numbers are compared to 1e-06 only" in found.notes[0]
    assert any("gates[sbc.bias[theta_1]]" in line for line in verify(folder, tolerance=0.0).differences)
    said = [line for line in found.differences if line.startswith("verdict.json: gates")]
    (line,) = said
    assert "gates[sbc.log_width[theta_1]].statistic" in line


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda record: record.update(policy=3), "provenance.policy is no table"),
        (lambda record: record["policy"].update(error_budget=7), "error_budget = 7"),
        (lambda record: record.update(validators=["magic"]), "unknown validator magic"),
        (lambda record: record.update(validators="sbc"), "must be a list of names"),
        (lambda record: record.update(seed="one"), "must be a whole number"),
    ],
)
def test_a_record_that_cannot_be(tiny: Path, tmp_path: Path, change: Any, says: str) -> None:
    folder = Path(shutil.copytree(tiny, tmp_path / "copy"))
    edited(folder / "verdict.json", lambda content: change(content["provenance"]))
    with pytest.raises(InputError, match=says):
        verify(folder)


@pytest.mark.parametrize(
    "name", ["sha256", "trials", "versions", "listing", "estimator", "confinement", "title"]
)
@pytest.mark.parametrize("value", [3, ["\x1b[31m"], {"pickles": "x", "imports": 1}, None])
def test_a_record_that_somebody_made_up_is_different_and_no_more(
    tiny: Path, tmp_path: Path, name: str, value: Any
) -> None:
    copy = Path(shutil.copytree(tiny, tmp_path / "copy"))
    edited(copy / "verdict.json", lambda content: content["provenance"].update({name: value}))
    done = CliRunner().invoke(app, ["verify", str(copy)])
    assert done.exit_code == 1
    assert "\x1b" not in done.stdout


def test_an_audit_of_0_1_0_is_refused_in_one_line(tiny: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(tiny, tmp_path / "copy"))
    edited(copy / "verdict.json", lambda content: content["provenance"].pop("format"))
    error = CliRunner().invoke(app, ["verify", str(copy)]).exception
    assert isinstance(error, InputError)
    assert "an audit of gaugeblock 0.1.0" in str(error)
    assert "\n" not in str(error)


def test_the_command(tiny: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(tiny, tmp_path / "copy"))
    runner = CliRunner()
    done = runner.invoke(app, ["verify", str(folder)])
    assert (done.exit_code, done.stdout.splitlines()[0][:5]) == (0, "SAME:")
    *_, kept, asked = done.stdout.splitlines()
    assert asked == "An edit of trials.nc itself shows against a digest kept elsewhere: --trials-sha256 HEX"
    again = runner.invoke(app, ["verify", str(folder), "--trials-sha256", kept.split()[-1]])
    assert again.stdout.splitlines() == done.stdout.splitlines()[:-1]
    edited(folder / "verdict.json", lambda content: content.update(verdict="FAIL"))
    done = runner.invoke(app, ["verify", str(folder)])
    assert done.exit_code == 1
    assert done.stdout.startswith("verdict.json: verdict is 'FAIL'")
    for broken in (tmp_path / "none", tmp_path):
        assert isinstance(runner.invoke(app, ["verify", str(broken)]).exception, InputError)
    bad = runner.invoke(app, ["verify", str(folder), "--trials-sha256", "abc"])
    assert "64 hexadecimal digits" in str(bad.exception)
    (folder / "trials.nc").write_bytes(b"no")
    assert isinstance(runner.invoke(app, ["verify", str(folder)]).exception, InputError)


def told(folder: Path, change: Any, **options: Any) -> list[str]:
    """What of verdict.json differs once its provenance is changed; pages, which hold that too, aside."""
    path = folder / "verdict.json"
    before = path.read_bytes()
    edited(path, change)
    try:
        lines = verify(folder, **options).differences
    finally:
        path.write_bytes(before)
    return [line for line in lines if line.startswith(("verdict.json: ", "trials.nc: ", "findings.nc: "))]


def in_record(**changes: Any) -> Any:
    return lambda content: content["provenance"].update(changes)


def test_digests_that_were_kept_in_any_letters(tiny: Path) -> None:
    kept = file_digest(tiny / "trials.nc")
    assert verify(tiny).trials_sha256 == kept
    assert verify(tiny, trials_sha256=f" {kept.upper()}\n").differences == ()
    for length in (63, 65):
        with pytest.raises(InputError) as caught:
            verify(tiny, trials_sha256=(kept * 2)[:length])
        assert str(caught.value) == (
            f"--trials-sha256 {(kept * 2)[:length]}: must be 64 hexadecimal digits, as the audit printed"
        )
    (line,) = verify(tiny, trials_sha256="0" * 64).differences
    assert line == f"trials.nc: has sha256 {kept}, not the {'0' * 64} that was kept elsewhere"
    (line,) = verify(tiny, estimator_sha256="A" * 64).differences
    assert line == f"verdict.json: sha256.estimator is None, not the {'a' * 64} that was kept elsewhere"
    lines = told(tiny, in_record(sha256={}))
    assert lines[0] == f"trials.nc: has sha256 {kept}, verdict.json says None"
    assert lines[1].startswith("verdict.json: provenance: sha256.policy is None, should be ")
    assert len(lines) == 2


@pytest.mark.parametrize(
    ("trials", "lines"),
    [
        ({"number": 12, "draws": 5}, []),
        ({"number": 13}, ["trials.number is 13, should be 12"]),
        ({"number": 13, "draws": 6}, ["trials.number is 13, should be 12", "trials.draws is 6, should be 5"]),
        ({"number": 13, "anytime": True, "used": 12}, []),
        ({"number": 12, "anytime": True, "used": 11}, ["trials.used is 11, should be 12"]),
        ({"used": 11}, []),
    ],
)
def test_sizes_that_the_record_states(tiny: Path, trials: dict[str, Any], lines: list[str]) -> None:
    assert told(tiny, in_record(trials=trials)) == [f"verdict.json: provenance: {line}" for line in lines]


def test_how_near_numbers_must_be(tiny: Path) -> None:
    assert verify(tiny).notes == ()
    assert verify(tiny, tolerance=0.0).notes == ()
    assert verify(tiny, tolerance=1e-4).notes == ("numbers are compared to 0.0001",)
    versions = json.loads((tiny / "verdict.json").read_text())["provenance"]["versions"]
    other = {**versions, "numpy": "1.0", "more": "3"}
    del other["scipy"]
    edited(tiny / "verdict.json", in_record(versions=other))
    try:
        said = [verify(tiny, tolerance=tolerance).notes for tolerance in (None, 0.0, 1e-3)]
    finally:
        edited(tiny / "verdict.json", in_record(versions=versions))
    assert said == [
        (
            f"versions differ (numpy 1.0 there, {versions['numpy']} here; scipy absent there, "
            f"{versions['scipy']} here; more 3 there, absent here), so numbers are compared to {near:g} only",
        )
        for near in (NEAR, 0.0, 1e-3)
    ]


def test_looks_end_at_the_trials_that_there_are(tiny: Path) -> None:
    def change(content: Any) -> None:
        content["looks"]["trials"] = [12, 13]

    assert told(tiny, change)[0] == (
        "verdict.json: looks: the last is at 13 trials, which is not how many there are"
    )


def test_policies_that_were_asked_for(tiny: Path) -> None:
    assert verify(tiny, policy="default").differences == ()
    lines = verify(tiny, policy={"error_budget": 0.01}).differences
    assert lines == (
        "verdict.json: provenance: policy: error_budget is 0.05, should be 0.01 in the policy that was asked "
        "for",
    )
    # However little another one differs.
    (line,) = verify(tiny, policy={"error_budget": 0.049999}).differences
    assert "error_budget is 0.05, should be 0.049999 in the policy" in line
    assert verify(tiny).policy == "the default policy"
    assert verify(tiny).outcome == "INCONCLUSIVE"


def test_validators_that_an_old_record_does_not_name(tiny: Path) -> None:
    """All of them then, or those that watch."""
    lines = told(tiny, lambda content: content["provenance"].pop("validators"))
    assert any(line.startswith("findings.nc: ") for line in lines)
    assert any("validators" in line or "not_checked" in line for line in lines)
    for seed in (True, -1, "one"):
        for name in ("seed", "judge_seed"):
            with pytest.raises(InputError) as caught:
                told(tiny, in_record(**{name: seed}))
            assert str(caught.value) == (
                f"verdict.json: provenance.{name} is {seed!r}; it must be a whole number"
            )


def test_trials_and_findings_that_lie_elsewhere(tiny: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(tiny, tmp_path / "copy"))
    (copy / "trials.nc").rename(tmp_path / "kept.nc")
    with pytest.raises(InputError) as caught:
        verify(copy)
    assert str(caught.value) == (
        f"{copy / 'trials.nc'}: no such file; give the audit's Trials with --trials FILE.nc"
    )
    (copy / "findings.nc").unlink()
    assert verify(copy, trials=tmp_path / "kept.nc").differences == ()
    (tmp_path / "kept.nc").rename(copy / "trials.nc")
    (line,) = verify(copy).differences
    assert line.startswith("findings.nc: ")
    with pytest.raises(InputError) as caught:
        verify(tiny, statement=tmp_path / "s.json")
    assert str(caught.value) == (
        f"--statement {tmp_path / 's.json'}: say whose it should be: --signer PUBLIC.pem"
    )
