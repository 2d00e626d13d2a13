import hashlib
import json
import os
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ElementTree
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.cli.inside import inside

from gaugeblock.validate import main_trials, make_trials, read_trials, write_trials

FILES = (
    *("trials.nc", "findings.nc", "verdict.json", "junit.xml", "summary.md", "report.html"),
    "model_card.md",
    "looks.json",
)
TOY = ("--set", "simulator.name=linear_gaussian", "--set", "estimator.name=exact")


def run(*arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "gaugeblock", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        cwd=cwd,
    )


def gaussian_trials(path: Path, *, width: float = 1.0, number: int = 3000) -> Path:
    rng = np.random.default_rng(3)
    x = rng.standard_normal((number, 2))
    theta = x + rng.standard_normal((number, 2))
    draws = x[:, None] + width * rng.standard_normal((number, 100, 2))
    write_trials(make_trials(theta, draws, ["a", "b"]), path)
    return path


def test_an_exact_estimator_passes_and_leaves_all_files(tmp_path: Path) -> None:
    one = ("--set", "simulator.parameters=1", "--set", "simulator.data=1")
    size = ("--set", "trials.number=3000", "--set", "trials.draws=100")
    done = inside("audit", *TOY, *one, *size, "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("PASS")
    assert sorted(os.listdir(tmp_path)) == sorted(FILES)
    verdict = json.loads((tmp_path / "verdict.json").read_text())
    assert verdict["verdict"] == "PASS"
    ids = {gate["id"] for gate in verdict["gates"]}
    assert {"draws.finite", "sbc.bias[theta_1]", "coverage.central", "importance.ess"} <= ids
    assert verdict["provenance"]["seed"] == 20260611
    assert verdict["provenance"]["versions"]["numpy"] == np.__version__
    digests = verdict["provenance"]["sha256"]
    assert set(digests) == {"simulator", "estimator", "policy", "trials"}
    assert digests["trials"] == hashlib.sha256((tmp_path / "trials.nc").read_bytes()).hexdigest()
    ElementTree.parse(tmp_path / "junit.xml")


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Path]:
    """An audit of exact draws from disk, and its folder."""
    folder = tmp_path_factory.mktemp("good")
    file, out = gaussian_trials(folder / "t.nc"), folder / "out"
    return inside("audit", "--trials", file, "--out", out), out


def test_draws_from_disk_pass_fail_or_stay_undecided(good: tuple[Any, Path], tmp_path: Path) -> None:
    done, _ = good
    assert done.returncode == 0, done.stdout + done.stderr
    assert "not checked  importance.ess" in done.stdout
    # A width of 0.7 where 0.905 is tolerated, known to 0.04: a seed in a million would stay undecided.
    narrow = gaussian_trials(tmp_path / "bad.nc", width=0.7, number=1500)
    bad = inside("audit", "--trials", narrow, "--out", tmp_path / "bad")
    assert bad.returncode == 1
    assert "sbc.log_width[a]" in bad.stdout
    few = inside(
        "audit", "--trials", gaussian_trials(tmp_path / "few.nc", number=50), "--out", tmp_path / "few"
    )
    assert few.returncode == 3
    assert json.loads((tmp_path / "few" / "verdict.json").read_text())["verdict"] == "INCONCLUSIVE"


def test_a_release_is_entered_in_its_ledger(tmp_path: Path) -> None:
    small = ("--set", "trials.number=20", "--validator", "draws", "--ledger", tmp_path / "ledger.json")
    assert inside("audit", *TOY, *small, "--out", tmp_path / "first").returncode == 3
    done = inside("audit", *TOY, *small, "--release", "--out", tmp_path / "second")
    assert "The 2nd audit of this simulator under this policy: 1 earlier one, of 1 estimator." in done.stdout
    first, second = json.loads((tmp_path / "ledger.json").read_text())["audits"]
    assert (first["release"], second["release"]) == (False, True)
    assert [(look["trials"], look["outcome"]) for look in second["looks"]] == [(20, "INCONCLUSIVE")]
    written = json.loads((tmp_path / "second" / "verdict.json").read_text())["provenance"]
    assert written["seed"] == second["seed"] != first["seed"]
    assert inside("verify", tmp_path / "second").returncode == 0


def test_the_gate_judges_again_without_sampling(good: tuple[Any, Path], tmp_path: Path) -> None:
    first = good[1]
    again = inside("gate", first, "--policy", "strict", "--out", tmp_path / "second")
    assert again.returncode == 3
    assert (first / "verdict.json").read_text().count("PASS") > 1
    written = json.loads((tmp_path / "second" / "verdict.json").read_text())
    assert written["provenance"]["policy"]["tolerance"]["bias"] == 0.05


def test_a_validator_can_be_chosen(tmp_path: Path) -> None:
    done = inside(
        "audit", "--trials", gaussian_trials(tmp_path / "t.nc"), "--validator", "coverage", "--out", tmp_path
    )
    ids = [gate["id"] for gate in json.loads((tmp_path / "verdict.json").read_text())["gates"]]
    assert "coverage.central" in ids
    # The default policy requires more than was chosen: that is not a PASS.
    assert done.returncode == 3


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["audit", "nowhere.toml"], "nowhere.toml: cannot be read"),
        (["audit", "--trials", "nowhere.nc"], "nowhere.nc: no such file"),
        (["audit", "--trials", "text.nc"], "text.nc: cannot be read as NetCDF"),
        (["audit", "--trials", "cut.nc"], "cut.nc: cannot be read as NetCDF"),
        (["audit", "--trials", "nan.nc"], "nan.nc"),
        (["audit", "--set", "nonsense"], "expected table.key=value"),
        (["audit", *TOY, "--policy", "nowhere.toml"], "nowhere.toml: cannot be read"),
        (["audit", *TOY, "--validator", "sbs"], "unknown validator sbs"),
        (["audit", "--set", "simulator.name=nonsense"], "no simulator 'nonsense'"),
        (["audit", *TOY, "--set", "trials.number=1"], "trials.number"),
        (["audit", *TOY, "--out", "text.nc"], "cannot make the folder text.nc"),
        (["audit", *TOY, "--ledger", "text.nc"], "text.nc: the ledger is damaged, or no ledger"),
        (["audit", *TOY, "--release"], "give one with --ledger FILE"),
        (["audit", *TOY, "--release", "--ledger", "l.json", "--seed", "3"], "leave out --seed"),
        (["audit", "--trials", "whole.nc", "--ledger", "l.json"], "leave out --ledger and --release"),
        (["gate", "."], "trials.nc: no such file"),
        (["train", "nowhere.toml"], "nowhere.toml"),
        (["audit", "--set", "estimator.path=nowhere", *TOY[:2]], "nowhere/model.json: cannot be read"),
        (["frobnicate"], "No such command"),
    ],
)
def test_bad_input_gets_a_line_exit_2_and_writes_nothing(
    arguments: list[str], complaint: str, tmp_path: Path
) -> None:
    if "train" in arguments or "estimator.path=nowhere" in arguments:
        pytest.importorskip("sbi")
    whole = gaussian_trials(tmp_path / "whole.nc", number=20)
    (tmp_path / "text.nc").write_text("not NetCDF")
    (tmp_path / "cut.nc").write_bytes(whole.read_bytes()[:-3000])
    broken = main_trials(read_trials(whole))
    broken["theta_true"][3, 1] = np.nan
    broken.to_netcdf(tmp_path / "nan.nc")
    before = sorted(os.listdir(tmp_path))
    done = inside(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert complaint in done.stderr
    assert "Traceback" not in done.stderr
    if arguments[0] in ("audit", "gate"):
        assert len(done.stderr.strip().splitlines()) == 1
    assert sorted(os.listdir(tmp_path)) == before


def test_debug_shows_where_and_nothing_commands_the_terminal(tmp_path: Path) -> None:
    done = inside("audit", "now\x1b[2J\x9b\u202ehere.toml", "--debug", cwd=tmp_path)
    assert done.returncode == 2
    assert "Traceback" in done.stderr
    assert done.stderr.count("now?[2J??here.toml: cannot be read") == 2
    assert done.stderr.replace("\n", "").isprintable()


SLOW = """
import time
import numpy as np
from gaugeblock.estimators.exact import Exact

class Slow(Exact):
    def sample(self, x, n, rng):
        time.sleep(0.3)
        return super().sample(x, n, rng)
"""


INTERRUPTED = (
    *("audit", "--set", "simulator.name=linear_gaussian", "--set", "estimator.name=interrupted_toy:Slow"),
    *("--set", "trials.number=60", "--set", "trials.block=10"),
    *("--validator", "sbc", "--quiet", "--out", "out"),
)


def test_interrupted_and_run_again_gives_the_same_bytes(tmp_path: Path) -> None:
    """What is killed: tests/trust/test_kills.py."""

    def finished(folder: Path) -> tuple[int, dict[str, bytes]]:
        done = inside(*INTERRUPTED, cwd=folder)
        return done.returncode, {name: (folder / "out" / name).read_bytes() for name in FILES}

    (undisturbed := tmp_path / "undisturbed").mkdir()
    for folder in (tmp_path, undisturbed):
        (folder / "interrupted_toy.py").write_text(SLOW)
    command = (sys.executable, "-m", "gaugeblock", *INTERRUPTED)
    run = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, stdout=subprocess.PIPE)
    with run as process:
        deadline = time.monotonic() + 120
        while len(list(tmp_path.glob("out/.chunks/*/trials-*.nc"))) < 3:
            assert time.monotonic() < deadline
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 2
    assert said.decode().startswith("gaugeblock: interrupted")
    assert not any((tmp_path / "out" / name).exists() for name in FILES)
    assert finished(tmp_path) == finished(undisturbed)
    assert sorted(os.listdir(tmp_path / "out")) == sorted(FILES)


def test_the_version() -> None:
    done = run("--version")
    assert done.returncode == 0
    assert done.stdout == f"gaugeblock {metadata.version('gaugeblock')}\n"


def test_arrays_of_numpy_are_audited_and_what_they_lack_is_said(tmp_path: Path) -> None:
    trials = main_trials(read_trials(gaussian_trials(tmp_path / "t.nc")))
    arrays = {name: trials[name].values for name in ("theta_true", "draws")}
    np.savez(tmp_path / "t.npz", **arrays, names=["a", "b"])
    options = ("--validator", "draws", "--validator", "sbc", "--out", tmp_path / "out")
    done = inside("audit", "--trials", tmp_path / "t.npz", *options)
    assert "sbc.bias[b]" in (tmp_path / "out" / "verdict.json").read_text(), done.stderr
    np.savez(tmp_path / "less.npz", draws=arrays["draws"])
    done = inside("audit", "--trials", tmp_path / "less.npz", *options)
    assert done.returncode == 2
    assert "no array theta_true; save theta_true (trial, parameter)" in done.stderr
    assert done.stderr.count("\n") == 1


def test_functions_of_ones_own_by_name(tmp_path: Path) -> None:
    """An exact posterior, 300 trials: FAIL would be chance in fewer than one of a hundred seeds."""
    (tmp_path / "own_readings.py").write_text(
        "import numpy as np\n"
        "import scipy.stats\n"
        "prior = {'mean': scipy.stats.norm(0, 1)}\n"
        "def simulate(theta, rng):\n"
        "    return rng.normal(theta, 1.0)\n"
        "def draw(x, n, rng):\n"
        "    return x[:, None] / 2 + np.sqrt(0.5) * rng.standard_normal((len(x), n, 1))\n"
    )
    names = (
        "simulator.name=own_readings:simulate",
        "simulator.prior=own_readings:prior",
        "estimator.name=own_readings:draw",
    )
    settings = [word for name in (*names, "trials.number=300") for word in ("--set", name)]
    done = inside("audit", *settings, "--out", "out", "--validator", "sbc", cwd=tmp_path)
    assert done.returncode in (0, 3), done.stdout + done.stderr
    assert "sbc.bias[mean]" in (tmp_path / "out" / "verdict.json").read_text()
