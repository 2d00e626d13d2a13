"""The GitHub action, run here: what it passes on, refuses and tells, and that it evaluates nothing."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

# The exact estimator on ten trials, of which the policy asks no more than finite draws: PASS within a second.
AUDIT = """
validators = ["draws", "sbc"]
simulator = {name = "linear_gaussian", parameters = 1, data = 1}
estimator = {name = "exact"}
trials = {number = 10, draws = 10}
policy = {required = ["draws.finite"]}
"""
NASTY = "a b 'c' \"d\" $(touch pwned) `touch pwned` ;touch pwned; \n::set-output name=x::y\n%0A *"


@pytest.fixture
def place(tmp_path):
    (tmp_path / "audit.toml").write_text(AUDIT)
    return tmp_path


@pytest.fixture
def action(workflow):
    return workflow(ROOT / "action.yml")


def test_inputs_reach_the_shell_through_its_environment_only(action):
    steps = [step for step in action["runs"]["steps"] if "run" in step]
    assert len(steps) == 2
    used = set()
    for step in steps:
        assert "${{" not in step["run"]
        assert step["shell"] == "bash"
        script = (ROOT / "action" / re.search(r"/action/(\w+\.sh)", step["run"])[1]).read_text()
        assert set(step["env"]) == set(re.findall(r"INPUT_[A-Z_]+", script))
        for variable, text in step["env"].items():
            name = re.fullmatch(r"\$\{\{ inputs\.([a-z-]+) \}\}", text)[1]
            assert variable == "INPUT_" + name.upper().replace("-", "_")
            used.add(name)
    # The others decide whether a step runs, or go to another action.
    assert set(action["inputs"]) - used == {"python-version", "install"}


def test_it_uploads_nothing_and_its_outputs_are_set(action):
    uses = [step["uses"] for step in action["runs"]["steps"] if "uses" in step]
    assert [name.partition("@")[0] for name in uses] == ["actions/setup-python"]
    script = (ROOT / "action" / "run.sh").read_text()
    for name, entry in action["outputs"].items():
        assert entry["value"] == f"${{{{ steps.audit.outputs.{name} }}}}"
        assert re.search(rf"^ *output {name} ", script, re.MULTILINE)
    for entry in (*action["inputs"].values(), *action["outputs"].values()):
        assert entry["description"]


def test_no_script_evaluates_anything():
    for path in (ROOT / "action").glob("*.sh"):
        code = re.sub(r"^\s*#.*$", "", path.read_text(), flags=re.MULTILINE)
        assert not re.search(r"\beval\b|\bsource\b|\bbash -c\b|\bsh -c\b", code)


def test_a_pass_is_summarised_and_given_on(place, runner):
    done = runner.action({"config": "audit.toml", "out": "kept", "seed": "7", "trials": "12"}, place)
    assert done.code == 0, done.stderr
    kept = place / "kept"
    assert done.outputs == {
        "verdict": "PASS",
        "exit-code": "0",
        "out": str(kept),
        "report": str(kept / "report.html"),
    }
    assert done.summary == (kept / "summary.md").read_text()
    assert Path(done.outputs["report"]).exists()
    provenance = json.loads((kept / "verdict.json").read_text())["provenance"]
    assert (provenance["seed"], provenance["trials"]["number"]) == (7, 12)


def test_what_the_estimator_prints_cannot_command_the_runner(place, runner):
    done = runner.action({"config": "audit.toml"}, place)
    first, *_, last = [line for line in done.stdout.splitlines() if line]
    token = re.fullmatch(r"::stop-commands::(gaugeblock-[0-9a-f]{32})", first)[1]
    assert last == f"::{token}::"
    assert runner.action({"config": "audit.toml"}, place).stdout.splitlines()[0] != first


def test_settings_one_a_line(place, runner):
    lines = 'trials.seed=5\n\n  \npolicy.tolerance.bias=0.3\nestimator.name = "exact"\n'
    assert runner.action({"config": "audit.toml", "set": lines, "out": "kept"}, place).code == 0
    provenance = json.loads((place / "kept" / "verdict.json").read_text())["provenance"]
    assert provenance["seed"] == 5
    assert provenance["policy"]["tolerance"]["bias"] == 0.3


def test_a_ledger_counts_the_audits_of_a_project(place, runner):
    inputs = {"config": "audit.toml", "ledger": "ledger.json", "out": "kept"}
    assert runner.action({**inputs, "seed": "5"}, place).code == 0
    assert runner.action({**inputs, "release": "true"}, place).code == 0
    recorded = json.loads((place / "kept" / "verdict.json").read_text())["provenance"]["ledger"]
    assert (recorded["earlier"], recorded["release"]) == (1, True)
    refused = runner.action({"config": "audit.toml", "release": "true"}, place)
    assert (refused.code, refused.outputs["verdict"]) == (2, "ERROR")


def annotations(done, kind):
    """What stands beside the job: after the audit's own output, which cannot command the runner."""
    token = re.search(r"::stop-commands::(gaugeblock-[0-9a-f]{32})", done.stdout)
    after = done.stdout.rpartition(f"::{token[1]}::")[2] if token else done.stdout
    return re.findall(rf"^::{kind} title=gaugeblock::(.*)$", after, flags=re.MULTILINE)


INCONCLUSIVE = {"config": "audit.toml", "set": 'policy.required=["sbc"]'}


def test_exit_codes_are_kept(place, runner):
    (place / "mine.py").write_text(
        "import numpy as np\nfrom gaugeblock.estimators.exact import Exact\n"
        "class Broken(Exact):\n    def sample(self, x, n, rng):\n"
        "        return np.full((len(x), n, 1), np.nan)\n    log_prob = None\n"
    )
    failed = runner.action({"config": "audit.toml", "set": "estimator.name=mine:Broken"}, place)
    assert (failed.code, failed.outputs["verdict"]) == (1, "FAIL")
    assert "draws.finite" in failed.summary
    (said,) = annotations(failed, "error")
    assert said.startswith("FAIL: draws.finite: ")
    undecided = runner.action(INCONCLUSIVE, place)
    assert (undecided.code, undecided.outputs["verdict"]) == (3, "INCONCLUSIVE")
    (said,) = annotations(undecided, "error")
    assert said.startswith("INCONCLUSIVE: sbc.")
    # The folder holds the report of the run before: it must not pass for this one's.
    wrong = runner.action({"config": "nowhere.toml"}, place)
    assert (wrong.code, wrong.outputs["verdict"], wrong.outputs["report"]) == (2, "ERROR", "")
    assert "nowhere.toml: cannot be read" in wrong.stderr
    assert wrong.summary.startswith("gaugeblock could not audit:\n\n    nowhere.toml: cannot be read")
    assert annotations(wrong, "error")[0].startswith("nowhere.toml: cannot be read")
    assert "INCONCLUSIVE" not in wrong.summary


def test_an_inconclusive_audit_need_not_block(place, runner):
    done = runner.action({**INCONCLUSIVE, "fail-on-inconclusive": "false"}, place)
    assert (done.code, done.outputs["verdict"], done.outputs["exit-code"]) == (0, "INCONCLUSIVE", "3")
    assert done.stdout.splitlines()[-1].startswith("::warning title=gaugeblock::INCONCLUSIVE")
    assert "INCONCLUSIVE" in done.summary


def test_paths_with_anything_in_them_are_paths(place, runner):
    folder = place / 'it\'s a "folder" $(touch pwned)\n`touch pwned` ; touch pwned'
    folder.mkdir()
    (folder / "con fig $(touch pwned).toml").write_text(AUDIT)
    inputs = {
        "config": "con fig $(touch pwned).toml",
        "out": "o'u t\n::warning::$(touch pwned)",
        "ledger": "-l $(touch pwned)",
    }
    done = runner.action({**inputs, "working-directory": folder.name}, place)
    assert done.code == 0, done.stderr
    assert done.outputs["out"] == str(folder / inputs["out"])
    assert (folder / inputs["out"] / "verdict.json").exists()
    assert (folder / inputs["ledger"]).exists()
    assert not list(place.rglob("pwned"))


@pytest.mark.parametrize(
    "name",
    [
        *("config", "trials-file", "policy", "seed", "trials", "release", "set"),
        *("working-directory", "fail-on-inconclusive", "allow-module"),
    ],
)
@pytest.mark.parametrize("value", [NASTY, "--help", "-x"])
def test_a_value_is_never_run_and_never_an_option(name, value, place, runner):
    before = sorted(place.iterdir())
    done = runner.action({"config": "audit.toml", name: value}, place)
    assert (done.code, done.outputs["verdict"]) == (2, "ERROR")
    assert done.outputs["exit-code"] == "2"
    assert sorted(place.iterdir()) == before
    assert "Usage" not in done.stdout
    (said,) = annotations(done, "error")
    assert said.strip()
    assert done.summary.startswith("gaugeblock could not audit:\n\n    ")
    assert len(done.summary.splitlines()) == 3
    assert not any(line.startswith("::set-output") for line in done.stdout.splitlines())


STUB = """
[[ $1 == -I ]] && { echo FAIL; exit; }
for argument in "$@"; do [[ $argument == --out=* ]] && out=${argument#--out=}; done
mkdir -p "$out"
sleep 0.05
echo '{"verdict": "FAIL"}' >"$out/verdict.json"
echo page >"$out/report.html"
"""


@pytest.mark.parametrize("bytes_before", [0, 500_000, 1_048_000])
def test_a_long_summary_is_cut_at_a_line_end(bytes_before, place, runner):
    runner.command(
        "python",
        STUB + 'for n in {1..9000}; do printf "| %-140s é |\\n" "$n"; done >"$out/summary.md"; exit 1',
    )
    script = f"printf '%{bytes_before}s' '' >\"$GITHUB_STEP_SUMMARY\"\n" if bytes_before else ""
    runner.command("before", script)
    done = runner.action({}, place, BASH_ENV=str(runner.bin / "before"))
    assert done.code == 1
    whole = (place / "gaugeblock-audit" / "summary.md").read_text()
    assert len(whole.encode()) > 2**20
    assert len(done.summary.encode()) < 2**20
    written = done.summary[bytes_before:]
    if bytes_before > 1_040_000:
        assert written == ""
        return
    kept, note, rest = written.partition("\n\n\nCut here: ")
    assert note
    assert "`summary.md`" in rest
    assert whole.startswith(kept + "\n")
    assert len(done.summary.encode()) > 2**20 - 5000


def test_a_killed_audit_is_an_error(place, runner):
    runner.command("python", "kill -9 $$")
    done = runner.action({}, place)
    assert (done.code, done.outputs["verdict"]) == (137, "ERROR")
    assert annotations(done, "error") == ["exit code 137, and not a word; the log of this step may say more"]


def test_a_reason_cannot_command_the_runner(place, runner):
    """Whatever stands in the last line of stderr: one annotation, and nothing of it is markup."""
    runner.command("python", 'printf "gaugeblock: 100%% \\r::set-output name=x::y\\e[31m\\n" >&2; exit 2')
    done = runner.action({}, place)
    (said,) = annotations(done, "error")
    assert said == "100%25 ::set-output name=x::y [31m"
    assert not re.search(r"^::set-output", done.stdout, flags=re.MULTILINE)
    assert done.summary.splitlines()[-1] == "    100% ::set-output name=x::y [31m"


@pytest.mark.parametrize(("undecided", "code"), [("true", 3), ("false", 0)])
def test_the_job_of_gitlab(undecided, code, place, runner, workflow):
    job = workflow(ROOT / "action" / "gitlab.yml")[".gaugeblock"]
    (script,) = job["script"]
    assert job["artifacts"]["reports"]["junit"] == "$GAUGEBLOCK_OUT/junit.xml"
    variables = {**job["variables"], "GAUGEBLOCK_CONFIG": "audit.toml"}
    assert set(re.findall(r"GAUGEBLOCK_[A-Z_]+", script + "".join(job["before_script"]))) == set(variables)
    passed = runner.run(script, place, variables)
    assert passed.code == 0, passed.stderr
    assert (place / variables["GAUGEBLOCK_OUT"] / "junit.xml").exists()
    (place / "audit.toml").write_text(AUDIT.replace('"draws.finite"', '"sbc"'))
    variables["GAUGEBLOCK_FAIL_ON_INCONCLUSIVE"] = undecided
    assert runner.run(script, place, variables).code == code
    variables |= {"GAUGEBLOCK_CONFIG": "--help", "GAUGEBLOCK_POLICY": NASTY}
    assert runner.run(script, place, variables).code == 2
    assert not list(place.rglob("pwned"))


@pytest.mark.parametrize(
    ("extras", "requirement"),
    [("", "{}"), ("sbi", "{}[sbi]"), ("sbi, xray", "{}[sbi,xray]"), ("$(touch pwned)", None)],
)
def test_it_installs_itself_with_the_extras_asked_for(extras, requirement, place, runner):
    runner.command("python", 'printf "%s\\n" "$@" >asked')
    environment = {"GITHUB_ACTION_PATH": str(ROOT), "INPUT_EXTRAS": extras}
    done = runner.run(f"bash '{ROOT}/action/install.sh'", place, environment)
    if requirement is None:
        assert done.code == 2
        assert [path.name for path in place.iterdir()] == ["audit.toml"]
    else:
        assert (place / "asked").read_text().splitlines()[-1] == requirement.format(ROOT)
