"""--quiet, --verbose, --json and --debug: on every command, and the same on each."""

import json
import sys

import numpy as np
import pytest
import typer

from gaugeblock.cli.commands import app, main
from gaugeblock.validate import make_trials, write_trials


def commands():
    def below(command, name):
        if not hasattr(command, "commands"):
            return [] if command.hidden else [pytest.param(command, id=name)]
        return [one for key, each in command.commands.items() for one in below(each, f"{name} {key}".strip())]

    return below(typer.main.get_command(app), "")


@pytest.fixture
def said(monkeypatch, capfd, tmp_path):
    """Exit code, stdout and stderr of the command line, run here."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["gaugeblock", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        return (ended.value.code or 0, *capfd.readouterr())

    return call


@pytest.fixture
def draws(tmp_path):
    rng = np.random.default_rng(3)
    x = rng.standard_normal((400, 1))
    made = x[:, None] + rng.standard_normal((400, 50, 1))
    write_trials(make_trials(x + rng.standard_normal((400, 1)), made, ["a"]), tmp_path / "draws.nc")
    return tmp_path / "draws.nc"


@pytest.mark.parametrize("command", commands())
def test_every_command_has_the_four_options(command):
    flags = {flag for parameter in command.params for flag in parameter.opts}
    assert flags >= {"--quiet", "--verbose", "--json", "--debug"}


def test_json_is_the_whole_of_stdout_and_what_the_files_say(said, draws, tmp_path):
    quick = ("--validator", "sbc", "--validator", "draws", "--out", "out")
    code, out, err = said("audit", "--trials", draws, *quick, "--json")
    verdict = json.loads(out)
    assert (code, verdict["verdict"]) in {(0, "PASS"), (1, "FAIL"), (3, "INCONCLUSIVE")}
    assert verdict == json.loads((tmp_path / "out" / "verdict.json").read_text())
    assert "to do" in err

    code, out, err = said("gate", "out", "--policy", "strict", "--json", "--quiet")
    assert json.loads(out)["provenance"]["policy"] != verdict["provenance"]["policy"]
    assert err == ""

    code, out, _ = said("verify", "out", "--json")
    assert (code, json.loads(out)["same"]) == (0, True)

    assert json.loads(said("plan", "--trials", "500", "--json")[1])
    assert json.loads(said("schema", "verdict", "--json")[1])["title"]
    assert json.loads(said("diagnose", "out", "--json")[1])["text"]


def test_prose_goes_with_json_and_progress_with_quiet(said, draws):
    quick = ("--validator", "sbc", "--out", "out")
    _, prose, loud = said("audit", "--trials", draws, *quick)
    assert "Report:" in prose
    _, quiet_prose, quiet = said("audit", "--trials", draws, *quick, "--quiet")
    assert quiet_prose == prose
    assert "to do" in loud
    assert quiet == ""


def test_verbose_adds_every_gate_and_seconds_on_stderr(said, draws, tmp_path):
    quick = ("--validator", "sbc", "--validator", "draws", "--out", "out", "--quiet")
    _, prose, _ = said("audit", "--trials", draws, *quick)
    _, same, err = said("audit", "--trials", draws, *quick, "--verbose")
    assert same == prose
    gates = json.loads((tmp_path / "out" / "verdict.json").read_text())["gates"]
    assert len(gates) >= 3
    assert all(f" {gate['id']}: " in err for gate in gates)
    assert " s, gaugeblock " in said("plan", "--trials", "500", "--verbose")[2]


def test_a_machine_reads_why_nothing_came_of_it(said):
    code, out, err = said("verify", "nowhere", "--json")
    assert code == 2
    assert err == f"gaugeblock: {json.loads(out)['error']}\n"
    assert said("verify", "nowhere")[1] == ""
