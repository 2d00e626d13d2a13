"""What each command hands on of its options, and what it refuses; the work is tested where it is done."""

from __future__ import annotations

import io
import json
import shlex
import signal
import sys
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from tests.cli.inside import Said, inside

from gaugeblock.auditing import attest as attesting
from gaugeblock.auditing import audit as audits
from gaugeblock.auditing import audit_draws as draws_in_hand
from gaugeblock.auditing import checking, discovering, judging, planned, stored
from gaugeblock.auditing import verify as verifying
from gaugeblock.cli import commands
from gaugeblock.cli.options import command, stranger_settings
from gaugeblock.core.errors import InputError
from gaugeblock.core.interrupts import Interrupted
from gaugeblock.reports import comparison
from gaugeblock.reports.discovery import best_fit
from gaugeblock.validate import Outcome, read_policy

TOY = ("--set", "simulator.name=linear_gaussian", "--set", "estimator.name=exact")


class Asked(Exception):
    """A command has come to its work."""


class Calls:
    def __init__(self) -> None:
        self.given: tuple[Any, ...] = ()
        self.named: dict[str, Any] = {}
        self.answer: Any = Asked("so far")

    def __call__(self, *given: Any, **named: Any) -> Any:
        self.given, self.named = given, named
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Calls:
    """Stands where the work is done, and keeps what it was asked."""
    found = Calls()
    for module, name in (
        (audits, "audit_configured"),
        (draws_in_hand, "audit_draws"),
        (audits, "audit_part"),
        (audits, "commit"),
        (judging, "judge"),
        (checking, "check"),
        (discovering, "discover"),
    ):
        monkeypatch.setattr(module, name, found)
    return found


def asked(cwd: Path, *words: object) -> None:
    done = inside(*words, cwd=cwd)
    assert done.returncode == 2
    assert done.stderr == "gaugeblock: internal error: Asked: so far (--debug shows where)\n", done.stderr


def refused(cwd: Path, *words: object) -> str:
    done = inside(*words, cwd=cwd)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    return done.stderr.removeprefix("gaugeblock: ").rstrip("\n")


def test_an_audit_of_a_configuration(calls: Calls, tmp_path: Path) -> None:
    words = ("audit", *TOY, "--seed", 0, "--anytime", "--validator", "sbc", "--validator", "draws")
    asked(tmp_path, *words, "--baseline", "old", "--ledger", "l.json", "--allow-mixed")
    (config,) = calls.given
    assert (config.simulator.name, config.estimator.name) == ("linear_gaussian", "exact")
    assert (config.trials.seed, config.trials.anytime, config.validators) == (0, True, ("sbc", "draws"))
    assert calls.named == {
        "out": Path("gaugeblock-audit"),
        "policy": read_policy("default"),
        "baseline": Path("old"),
        "command": "gaugeblock "
        + " ".join(map(str, words))
        + " --baseline old --ledger l.json --allow-mixed",
        "progress": True,
        "ledger": Path("l.json"),
        "release": False,
        "executor": None,
        "allow_mixed": True,
    }
    asked(tmp_path, "audit", *TOY, "--quiet", "--release", "--policy", "strict", "--out", "o")
    assert calls.named["policy"] == "strict"
    assert (calls.named["progress"], calls.named["release"], calls.named["out"]) == (False, True, Path("o"))
    assert calls.named["allow_mixed"] is False
    config = calls.given[0]
    assert (config.trials.anytime, config.validators, "seed" in config.trials.model_fields_set) == (
        False, None, False
    )  # fmt: skip
    asked(tmp_path, "audit", *TOY, "--commit", "c.json", "--commit-text", "t.txt")
    assert calls.named["commitment"] == (Path("c.json"), Path("t.txt"))


def test_an_audit_of_somebodys_file(calls: Calls, tmp_path: Path) -> None:
    (tmp_path / "f.pt").write_text("")
    asked(
        tmp_path, "audit", "--estimator", "f.pt", "--simulator", "two_moons", "--estimator-python", "py",
        "--estimator-format", "sbi", "--estimator-builder", "b.py:make", "--i-trust-this-estimator",
    )  # fmt: skip
    config = calls.given[0]
    assert config.simulator.table == {"name": "two_moons"}
    assert config.estimator.table == {
        "name": "stranger", "path": "f.pt", "python": "py", "format": "sbi", "builder": "b.py:make",
        "trust": True,
    }  # fmt: skip
    asked(tmp_path, "audit", "--simulator", "xray", "--estimator-command", "run it")
    assert calls.given[0].estimator.table == {"name": "stranger", "command": "run it"}
    assert refused(tmp_path, "audit", "--estimator", "f.pt") == (
        "say what the estimator is for: --simulator NAME, or a configuration"
    )
    (tmp_path / "c.toml").write_text('[simulator]\nname = "two_moons"\n')
    asked(tmp_path, "audit", "c.toml", "--estimator", "f.pt", "--allow-module", "mine")
    assert calls.given[0].modules == {"mine"}
    assert calls.given[0].simulator.name == "two_moons"


def test_draws_from_disk(calls: Calls, tmp_path: Path) -> None:
    asked(
        tmp_path,
        "audit",
        "--trials",
        "d.nc",
        "--seed",
        5,
        "--validator",
        "sbc",
        "--baseline",
        "b",
        "--out",
        "o",
    )
    assert calls.given == (Path("d.nc"),)
    assert {name: calls.named[name] for name in ("seed", "validators", "out", "baseline")} == {
        "seed": 5, "validators": ("sbc",), "out": Path("o"), "baseline": Path("b")
    }  # fmt: skip
    assert not {"ledger", "executor"} & set(calls.named)
    asked(tmp_path, "audit", "--trials", "d.nc")
    assert (calls.named["seed"], calls.named["validators"]) == (0, None)
    for more in (("--ledger", "l"), ("--release",)):
        assert refused(tmp_path, "audit", "--trials", "d.nc", *more).startswith("a ledger counts audits")
    for more in (("--workers", 2), ("--scheduler", "tcp://a:1"), ("--part", "1/2"), ("--allow-mixed",)):
        assert refused(tmp_path, "audit", "--trials", "d.nc", *more) == (
            "draws from disk leave nothing to fill: leave out --workers, --scheduler, --part and "
            "--allow-mixed, or --trials"
        )


def test_a_commitment_alone(calls: Calls, tmp_path: Path) -> None:
    calls.answer = None
    for more, policy in (((), None), (("--policy", "strict"), "strict")):
        done = inside("audit", *TOY, "--commit", "c.json", *more, cwd=tmp_path)
        assert done.returncode == 0
        assert done.stdout == (
            "committed: c.json; publish it, and audit with a text that comes later: --commit-text\n"
        )
        assert (calls.given[1], calls.named) == (Path("c.json"), {"policy": policy})
    done = inside("audit", *TOY, "--commit", "c.json", "--json", cwd=tmp_path)
    assert json.loads(done.stdout) == {"commitment": "c.json"}
    assert refused(tmp_path, "audit", *TOY, "--commit-text", "t") == (
        "--commit-text goes with --commit FILE, what it was committed to"
    )
    for more in (("--trials", "d.nc"), ("--part", "1/2")):
        own = TOY if "--part" in more else ()
        assert refused(tmp_path, "audit", *own, "--commit", "c.json", *more) == (
            "a commitment is to a whole audit: leave out --trials and --part"
        )


def test_a_part_of_an_audit(calls: Calls, tmp_path: Path) -> None:
    calls.answer = 7
    done = inside("audit", *TOY, "--part", "2/5", "--ledger", "l", "--baseline", "b", "--quiet", cwd=tmp_path)
    assert done.stdout == "part 2/5: 7 blocks are filled; the same command without --part finishes\n"
    assert done.returncode == 0
    assert calls.named == {
        "part": (2, 5), "out": Path("gaugeblock-audit"), "policy": read_policy("default"), "progress": False,
        "ledger": Path("l"), "release": False, "executor": None, "allow_mixed": False,
    }  # fmt: skip
    done = inside("audit", *TOY, "--part", "2/5", "--json", cwd=tmp_path)
    assert json.loads(done.stdout) == {"part": "2/5", "blocks": 7}


def test_the_gate(calls: Calls, tmp_path: Path) -> None:
    asked(tmp_path, "gate", "done")
    assert calls.given == (Path("done"), "default")
    assert calls.named == {"out": Path("done"), "seed": None, "command": "gaugeblock gate done"}
    asked(tmp_path, "gate", "done", "--policy", "strict", "--out", "o", "--seed", 0)
    assert calls.given == (Path("done"), "strict")
    assert (calls.named["out"], calls.named["seed"]) == (Path("o"), 0)


def test_a_check(calls: Calls, tmp_path: Path) -> None:
    asked(tmp_path, "check", "--simulator", "xray", "--observation", "x.npy")
    assert calls.given == ("xray", Path("x.npy"), None)
    plain = {
        "trials": 999, "simulations": 4000, "level": 0.05, "sees": None, "views": None, "axes": (), "seed": 0,
        "out": Path("gaugeblock-check"), "progress": True,
    }  # fmt: skip
    assert {name: calls.named[name] for name in plain} == plain
    (tmp_path / "f.pt").write_text("")
    words = (
        "check --simulator xray --observation x.npy --estimator f.pt --trials 99 --simulations 500 "
        "--level 0.1 --sees noise=0.5 --sees line=2 --view a --axis day --seed 4 --out o --quiet "
        "--set simulator.level=bright --set estimator.device=cpu --estimator-format sbi"
    )
    asked(tmp_path, *words.split())
    assert calls.given == (
        {"name": "xray", "level": "bright"},
        Path("x.npy"),
        {"name": "stranger", "path": "f.pt", "format": "sbi", "device": "cpu"},
    )
    assert {name: calls.named[name] for name in plain} == {
        "trials": 99, "simulations": 500, "level": 0.1, "sees": {"noise": 0.5, "line": 2.0}, "views": ["a"],
        "axes": ["day"], "seed": 4, "out": Path("o"), "progress": False,
    }  # fmt: skip
    asked(tmp_path, "check", "--simulator", "a", "--observation", "x", "--estimator", "exact")
    assert calls.given[2] == "exact"
    calls.answer = SimpleNamespace(
        lines=["FAIL: words", "more"], to_json=lambda: {"a": 1}, outcome=Outcome.FAIL
    )
    done = inside("check", "--simulator", "a", "--observation", "x", "--out", "o", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (1, "FAIL: words\n  more\nReport: o/report.html\n")
    for more, said in (
        (
            ("--set", "trials.number=3"),
            "--set trials.number: a check has options of simulator and estimator only",
        ),
        (("--set", "estimator.a=3"), "--set estimator.a: say which estimator, with --estimator NAME"),
        (("--sees", "noise"), "--sees noise: give KIND=SIZE, for instance noise=0.5"),
    ):
        assert refused(tmp_path, "check", "--simulator", "a", "--observation", "x", *more) == said


def test_a_search(calls: Calls, tmp_path: Path) -> None:
    asked(tmp_path, "discover", "a.pha", "b.pha")
    assert calls.given == ([Path("a.pha"), Path("b.pha")],)
    plain = {
        "model": "tbabs*powerlaw", "priors": None, "band": None, "rmf": (), "arf": (), "background": (),
        "redshift": 0.0, "regroup": "ungrouped", "sys_err": False, "effects": (), "only": (), "energy": None,
        "evidence": False,
        "replicates": 999, "seed": 0, "out": Path("gaugeblock-discovery"), "progress": True, "executor": None,
        "command": "gaugeblock discover a.pha b.pha",
    }  # fmt: skip
    assert calls.named == plain
    (tmp_path / "many").mkdir()
    words = (
        "discover --catalog many "
        "--model powerlaw --priors p.toml --band 0.5 7 --rmf r --arf a "
        "--background none --redshift 0.3 --regroup always --sys-err --effect gauss --energy 6.4 --own m:e "
        "--replicates 98 --evidence --out o --seed 3 --quiet"
    )
    asked(tmp_path, *words.split())
    assert calls.given == (Path("many"),)
    del calls.named["command"]
    assert calls.named == {
        "model": "powerlaw", "priors": Path("p.toml"), "band": (0.5, 7.0), "rmf": [Path("r")],
        "arf": [Path("a")], "background": ["none"], "redshift": 0.3, "regroup": "always", "sys_err": True,
        "effects": ["m:e"],
        "only": ["gauss"], "energy": 6.4, "evidence": True, "replicates": 98, "seed": 3, "out": Path("o"),
        "progress": False, "executor": None,
    }  # fmt: skip
    asked(tmp_path, "discover", "a.pha", "b.pha", "--bands", "0.3-10", "--bands", "3-7.9e1", "--quiet")
    assert calls.given == ([Path("a.pha"), Path("b.pha")],)
    assert calls.named["band"] == [(0.3, 10.0), (3.0, 79.0)]
    for text in ("3", "3-", "low-high", "1-2-3"):
        assert refused(tmp_path, "discover", "a.pha", "--bands", text) == (
            f"--bands {text}: give two energies in keV, such as 0.3-10"
        )
    assert refused(tmp_path, "discover", "a.pha", "--bands", "1-2", "--band", "1", "2") == (
        "discover: give either --band for all spectra or --bands, one a spectrum"
    )
    for words in ((), ("a.pha", "--catalog", "many")):
        assert refused(tmp_path, "discover", *words) == (
            "discover: name either PHA files of one source, or --catalog with a folder of many"
        )
    assert refused(tmp_path, "discover", "--catalog", "none") == "discover: --catalog none is no folder"


def test_what_a_search_says(calls: Calls, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = SimpleNamespace(statements=("it is seen", "it has a name"), paragraph="All in all.")
    rows = {False: [("index", "1.7", "1.9"), ("kT", "2", "3")]}
    monkeypatch.setattr(
        import_module("gaugeblock.reports.discovery.headline"), "headline", lambda summary: told
    )
    monkeypatch.setattr(best_fit, "fit_rows", lambda summary, *, backgrounds: rows[backgrounds])
    for named, after in ((["gauss"], ("; after: 1.9", "; after: 3")), ([], ("", ""))):
        priors = {
            "gain_slope": {"units": {}, "prior": {"odds": 0.5, "usual": {}, "limits": {"slope": [0.9, 1.1]}}}
        }
        said = {"statements": [{"indistinguishable": ["gain_slope"]}], "effects": priors} if named else {}
        summary = said | {"named_all": named, "provenance": {"notes": ["grouped", "as it is"]}}
        calls.answer = SimpleNamespace(to_json=lambda kept=summary: kept)
        assert inside("discover", "a.pha", "--out", "o", cwd=tmp_path).stdout.splitlines() == [
            "1. it is seen",
            "2. it has a name",
            "All in all.",
            f"  index: 1.7{after[0]}",
            f"  kT: 2{after[1]}",
            *(
                ["  prior of gain slope: odds 0.5; usually \N{EN DASH}; hard limits: slope 0.9 to 1.1"]
                * len(named)
            ),
            "note: grouped",
            "note: as it is",
            "report: o/report.html",
        ]
        assert document(tmp_path, "discover", "a.pha") == summary


def test_a_plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = Calls()
    monkeypatch.setattr(planned, "plan", found)
    asked(tmp_path, "plan")
    assert found.named == {
        "bias": None, "width_error": None, "coverage": None, "power": None, "params": None, "trials": None,
        "draws": None, "like": None, "policy": "default", "seed": 0,
    }  # fmt: skip
    words = "plan --bias 0.1 --width-error 0.2 --coverage 0.3 --power 0.8 --params 2 --trials 50 --draws 60"
    asked(tmp_path, *words.split(), "--like", "a.nc", "--policy", "strict", "--seed", 7)
    assert found.named == {
        "bias": 0.1, "width_error": 0.2, "coverage": 0.3, "power": 0.8, "params": 2, "trials": 50,
        "draws": 60, "like": Path("a.nc"), "policy": "strict", "seed": 7,
    }  # fmt: skip


def test_options_of_a_stranger() -> None:
    assert stranger_settings(path=None, command=None, trust=False) == {}
    assert stranger_settings(path=None, command=None, python=Path("p"), trust=True) == {
        "estimator.python": "p", "estimator.trust": True
    }  # fmt: skip
    assert stranger_settings(path=None, command="") == {"estimator.name": "stranger", "estimator.command": ""}


def test_the_command_line_that_is_running(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["/usr/bin/anything", "audit", "--seed", "3"])
    assert command() == "gaugeblock audit --seed 3"


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (InputError("this is\n\x1b[1m wrong"), "gaugeblock: this is ?[1m wrong"),
        (Interrupted("interrupted: so far"), "gaugeblock: interrupted: so far"),
        (
            MemoryError(),
            "gaugeblock: memory ran short; fewer trials a block (trials.block) or fewer draws take less",
        ),
        (KeyError("a"), "gaugeblock: internal error: KeyError: 'a' (--debug shows where)"),
    ],
)
@pytest.mark.parametrize("more", [(), ("--json",), ("--debug",)])
def test_errors_are_a_line_and_exit_2(error: BaseException, line: str, more: tuple[str, ...]) -> None:
    def failing() -> None:
        raise error

    done = _run(failing, *more)
    assert done.returncode == 2
    *before, last = done.stderr.splitlines()
    assert last == line
    assert bool(before) == (more == ("--debug",))
    assert ("Traceback" in done.stderr) == (more == ("--debug",))
    said = json.dumps({"error": line.removeprefix("gaugeblock: ")}) + "\n" if more == ("--json",) else ""
    assert done.stdout == said


def _run(work: Any, *more: str) -> Said:
    """`run`, with these words on the command line, in a process's own streams."""
    before, words = signal.getsignal(signal.SIGINT), sys.argv
    out, err = io.StringIO(), io.StringIO()
    sys.argv = ["gaugeblock", "audit", *more]
    try:
        with redirect_stdout(out), redirect_stderr(err), pytest.raises(SystemExit) as ended:
            commands.run(work)
    finally:
        sys.argv = words
        signal.signal(signal.SIGINT, before)
    return Said(int(str(ended.value.code)), out.getvalue(), err.getvalue())


def document(cwd: Path, *words: object, stdin: str = "") -> Any:
    """What --json prints, which is all of stdout."""
    done = inside(*words, "--json", cwd=cwd, stdin=stdin)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_pages_that_are_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    report, compare = Calls(), Calls()
    monkeypatch.setattr(stored, "report_folder", report)
    monkeypatch.setattr(stored, "compare_folders", compare)
    monkeypatch.setattr(comparison, "comparison_text", lambda found: f"{found} in words")
    report.answer, compare.answer = Path("a/report.html"), "compared"
    assert inside("report", "a", cwd=tmp_path).stdout == "Report: a/report.html\n"
    assert report.given == (Path("a"),)
    assert document(tmp_path, "report", "a") == {"report": "a/report.html"}
    assert inside("compare", "a", "b", cwd=tmp_path).stdout == (
        "compared in words\nReport: comparison/report.html\n"
    )
    assert compare.given == ([Path("a"), Path("b")], Path("comparison"))
    assert document(tmp_path, "compare", "b", "a", "--out", "o") == {
        "report": "o/report.html", "text": "compared in words"
    }  # fmt: skip
    assert compare.given == ([Path("b"), Path("a")], Path("o"))


def test_a_signature(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = Calls()
    found.answer = Path("s.json")
    monkeypatch.setattr(attesting, "attest", found)
    done = inside("attest", "a", "--key", "k.pem", cwd=tmp_path)
    assert done.stdout == "signed: s.json; checked by: gaugeblock verify DIR --signer PUBLIC.pem\n"
    assert (found.given, found.named) == ((Path("a"), Path("k.pem")), {"trials": None, "out": None})
    more = ("--trials", "t.nc", "--out", "o.json")
    assert document(tmp_path, "attest", "a", "--key", "k.pem", *more) == {"statement": "s.json"}
    assert found.named == {"trials": Path("t.nc"), "out": Path("o.json")}


def test_a_verification(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = Calls()
    monkeypatch.setattr(verifying, "verify", found)
    found.answer = verifying.Verification((), ("a note",), "ab" * 32, "PASS", "the default policy")
    done = inside("verify", "a", cwd=tmp_path)
    same = "SAME: findings, verdict and reports are what the trials, the policy and the seed give"
    kept = "An edit of trials.nc itself shows against a digest kept elsewhere: --trials-sha256 HEX"
    lines = ["note: a note", same, "PASS under the default policy", f"trials.nc sha256 {'ab' * 32}"]
    assert (done.returncode, done.stdout.splitlines()) == (0, [*lines, kept])
    none = dict.fromkeys(
        ("trials", "policy", "trials_sha256", "estimator_sha256", "tolerance", "commitment", "text", "signer")
    )
    none |= dict.fromkeys(("statement", "share"))
    assert (found.given, found.named) == ((Path("a"),), {**none, "allow_modules": ()})
    for more in (("--trials-sha256", "x"), ("--signer", "p.pem")):
        assert inside("verify", "a", *more, cwd=tmp_path).stdout.splitlines() == lines
    words = (
        "--trials t.nc --policy strict --trials-sha256 x --estimator-sha256 y --tolerance 0.001 --commit c "
        "--commit-text d --signer p --statement s --rerun 0.5 --allow-module m --allow-module n"
    )
    found.answer = verifying.Verification(("one\n\x1b[1m", "two"), (), "ab", "FAIL", "mine")
    done = inside("verify", "a", *words.split(), cwd=tmp_path)
    assert done.returncode == 1
    assert done.stdout.splitlines() == [
        "one ?[1m",
        "two",
        "DIFFERENT: what is listed above is not what the trials, the policy and the seed give, or not what "
        "was signed",
        "FAIL under mine",
        "trials.nc sha256 ab",
    ]
    assert found.named == {
        "trials": Path("t.nc"), "policy": "strict", "trials_sha256": "x", "estimator_sha256": "y",
        "tolerance": 0.001, "commitment": Path("c"), "text": Path("d"), "signer": Path("p"),
        "statement": Path("s"), "share": 0.5, "allow_modules": ["m", "n"],
    }  # fmt: skip
    done = inside("verify", "a", "--json", cwd=tmp_path)
    assert json.loads(done.stdout) == {
        "same": False, "differences": ["one\n\x1b[1m", "two"], "notes": [], "trials_sha256": "ab",
        "outcome": "FAIL", "policy": "mine",
    }  # fmt: skip
    assert "signed" not in inside("verify", "a", cwd=tmp_path).stdout


def test_a_configuration_and_its_schema(tmp_path: Path) -> None:
    following = "gaugeblock audit own.toml --allow-module mine"
    words = ("init", "own.toml", "--kind", "own", "--posterior", "mine:draw", "--simulator", "xray")
    assert document(tmp_path, *words) == {"file": "own.toml", "next": following}
    assert refused(tmp_path, *words) == "own.toml is there already; give another name, or --replace"
    assert inside(*words, "--replace", cwd=tmp_path).stdout == f"wrote own.toml\nnext: {following}\n"
    assert (tmp_path / "own.toml").read_text().startswith(f"# Audit it with: {following}\n")
    done = inside("init", "b.toml", cwd=tmp_path, stdin="npe\n\n\n")
    assert "Which one? (a model folder that gaugeblock train made) [model]:" in done.stderr
    simulator = "Which simulator? (a name, or module:object with simulate(theta, rng)) [mine:simulate]:"
    assert simulator in done.stderr
    assert "  own       an object of mine, module:object, with sample(x, n, rng)\n" in done.stderr
    assert 'path = "model"' in (tmp_path / "b.toml").read_text()
    done = inside("init", "c.toml", "--kind", "draws", cwd=tmp_path, stdin="\n")
    assert done.stdout.lstrip() == "wrote c.toml\nnext: gaugeblock audit c.toml --trials draws.nc\n"
    assert document(tmp_path, "schema", "configuration", "own.toml") == {"files": ["own.toml"]}
    assert inside("schema", "configuration", "own.toml", cwd=tmp_path).stdout == "own.toml: can be audited\n"
    made = document(tmp_path, "schema", "verdict")
    assert json.loads(inside("schema", "verdict", cwd=tmp_path).stdout) == made
    assert refused(tmp_path, "schema", "none").startswith("schema: there is none of none; there are ")
    assert refused(tmp_path, "schema", "verdict", "own.toml") == (
        "schema: of verdict only the schema; any validator of JSON schemas takes it"
    )


def test_a_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = Calls()
    found.answer = Path("model")
    npe = pytest.importorskip("gaugeblock.estimators.npe", exc_type=ImportError)
    monkeypatch.setattr(npe, "run_training", found)
    assert inside("train", "t.toml", "--quiet", cwd=tmp_path).stdout == "trained: model\n"
    assert found.given == (Path("t.toml"),)
    assert callable(found.named.pop("progress"))
    assert found.named == {"out": None, "overrides": {}, "allow_modules": (), "seed": None, "replace": False}
    words = "--out o --seed 0 --replace --set training.epochs=3 --allow-module m"
    assert document(tmp_path, "train", "t.toml", *words.split()) == {"model": "model"}
    del found.named["progress"]
    assert found.named == {
        "out": Path("o"), "overrides": {"training.epochs": 3}, "allow_modules": ["m"], "seed": 0,
        "replace": True,
    }  # fmt: skip


def test_a_recorded_command_is_one_that_a_shell_runs_again(monkeypatch):
    words = ["audit", "--set", 'simulator.effects=[{name="published_gain", factor=1.0}]', "--out", "here"]
    monkeypatch.setattr(sys, "argv", ["/somewhere/gaugeblock", *words])
    assert shlex.split(command()) == ["gaugeblock", *words]
    monkeypatch.setattr(sys, "argv", ["/somewhere/gaugeblock", "audit", "--set", "trials.number=5"])
    assert command() == "gaugeblock audit --set trials.number=5"
