"""`gaugeblock init`: asked on stdin and in a terminal, said by options; what it writes can be audited."""

import os
import pty
import select
import subprocess
import sys
import tomllib

import pytest
from tests.cli.inside import inside

from gaugeblock.validate.policy import read_policy

MINE = """
import numpy as np
from gaugeblock import Normal, Prior

class Simulator:
    prior = Prior({"a": Normal(0.0, 1.0)})
    def simulate(self, theta, rng):
        return rng.normal(theta, 1.0)

class Posterior:
    def sample(self, x, n, rng):
        return x[:, None, :] / 2 + np.sqrt(0.5) * rng.normal(size=(len(x), n, 1))
"""


def run(*arguments, cwd, stdin=""):
    return subprocess.run(
        [sys.executable, "-m", "gaugeblock", *arguments],
        input=stdin, capture_output=True, text=True, check=False, timeout=200, cwd=cwd,
    )  # fmt: skip


def test_what_is_asked_on_stdin_is_written_and_can_be_audited(tmp_path):
    (tmp_path / "mine.py").write_text(MINE)
    done = run("init", cwd=tmp_path, stdin="own\nmine:Posterior\nmine:Simulator\n")
    assert done.returncode == 0, done.stderr
    assert "Where is the posterior?" in done.stderr
    following = done.stdout.splitlines()[1].removeprefix("next: ").split()
    assert following == ["gaugeblock", "audit", "gaugeblock.toml", "--allow-module", "mine"]
    written = (tmp_path / "gaugeblock.toml").read_text()
    assert " ".join(following) in written.splitlines()[0]
    table = tomllib.loads(written)
    assert table["simulator"] == {"name": "mine:Simulator"}
    assert table["trials"] == {"number": 4000, "draws": 250, "seed": 20260611}
    few = ("--set", "trials.number=50", "--set", "trials.draws=20", "--validator", "draws", "--quiet")
    audited = run(*following[1:], *few, cwd=tmp_path)
    assert "error" not in audited.stderr
    assert (audited.returncode, (tmp_path / "gaugeblock-audit" / "verdict.json").exists()) == (3, True)


def test_with_all_options_nothing_is_asked_and_comments_are_what_would_be_set(tmp_path):
    options = (
        "--kind",
        "stranger",
        "--posterior",
        'a "b".pkl',
        "--simulator",
        "two_moons",
        "--policy",
        "strict",
    )
    done = inside("init", "own.toml", *options, "--json", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    text = (tmp_path / "own.toml").read_text()
    table = tomllib.loads(text)
    assert table["estimator"] == {"name": "stranger", "path": 'a "b".pkl'}
    assert table["policy"] == {"base": "strict"}
    assert inside("schema", "configuration", "own.toml", cwd=tmp_path).returncode == 0
    # With its comments taken away the tolerance is that of the strict policy, number by number.
    lines = text.partition("# [policy.tolerance]\n")[2].splitlines()
    tolerance = tomllib.loads("\n".join(line.removeprefix("# ") for line in lines))
    assert len(tolerance) >= 5
    assert {name: getattr(read_policy("strict").tolerance, name) for name in tolerance} == tolerance


def test_draws_on_disk_need_no_simulator(tmp_path):
    done = inside("init", cwd=tmp_path, stdin="draws\nmy.nc\n")
    assert "next: gaugeblock audit gaugeblock.toml --trials my.nc" in done.stdout
    assert set(tomllib.loads((tmp_path / "gaugeblock.toml").read_text())) == {"policy"}


def test_in_a_terminal(tmp_path):
    """Questions come one after another, and an empty answer takes what is offered."""
    main, side = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "gaugeblock", "init"], stdin=side, stdout=side, stderr=side, cwd=tmp_path
    )
    os.close(side)
    shown = b""
    for question, answer in ((b"[own]", b"npe\n"), (b"[model]", b"\n"), (b"[mine:simulate]", b"xray\n")):
        while question not in shown:
            assert select.select([main], [], [], 100)[0], shown
            shown += os.read(main, 1000)
        os.write(main, answer)
    assert process.wait(100) == 0
    os.close(main)
    table = tomllib.loads((tmp_path / "gaugeblock.toml").read_text())
    assert table["estimator"] == {"name": "npe", "path": "model"}
    assert table["simulator"] == {"name": "xray"}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--kind", "psychic"), "is no kind of posterior; there are own, npe, stranger, draws"),
        (("--kind", "own", "--posterior", "draw", "--simulator", "xray"), "give module:object"),
        (
            ("--kind", "draws", "--posterior", "d.nc", "--policy", "lax"),
            "policy lax is none of default, strict",
        ),
    ],
)
def test_what_cannot_be_is_one_line_and_nothing_is_written(options, said, tmp_path):
    done = inside("init", *options, cwd=tmp_path)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_there_stays(tmp_path):
    (tmp_path / "gaugeblock.toml").write_text("mine")
    options = ("--kind", "draws", "--posterior", "d.nc")
    done = inside("init", *options, cwd=tmp_path)
    assert (done.returncode, (tmp_path / "gaugeblock.toml").read_text()) == (2, "mine")
    assert inside("init", *options, "--replace", cwd=tmp_path).returncode == 0


def test_completion_in_bash(tmp_path):
    (tmp_path / "gaugeblock").write_text(f'#!/bin/sh\nexec {sys.executable} -m gaugeblock "$@"\n')
    (tmp_path / "gaugeblock").chmod(0o755)
    script = """
    eval "$(_GAUGEBLOCK_COMPLETE=source_bash gaugeblock)"
    reply() {
        COMP_WORDS=("$@"); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); COMPREPLY=()
        _gaugeblock_completion gaugeblock
        echo "${COMPREPLY[@]}"
    }
    reply gaugeblock aud
    reply gaugeblock audit --pol
    reply gaugeblock da
    """
    environment = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    done = subprocess.run(
        ["bash", "-c", script], capture_output=True, text=True, check=True, timeout=100, env=environment
    )
    assert done.stdout.split() == ["audit", "--policy", "data"]
