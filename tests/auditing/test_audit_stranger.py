"""A stranger's file audited from the command line: the verdict it deserves, and nothing left behind."""

import json
from pathlib import Path
from typing import Any

import pytest
from tests.cli.inside import inside

from gaugeblock.auditing.audit import audit_configured
from gaugeblock.auditing.config import AuditConfig, read_config
from gaugeblock.cli.options import stranger_settings
from gaugeblock.core.errors import InputError
from gaugeblock.validate import make_policy

POLICY = {
    "required": ["draws.finite", "sbc.bias", "sbc.log_width", "coverage.central"],
    "tolerance": {"bias": 0.25, "log_width": 0.25, "coverage": 0.15},
}
THEIRS = """
import numpy as np
MATRIX = np.vander(np.linspace(-1.0, 1.0, 3), 2, increasing=True)
COVARIANCE = np.linalg.inv(np.eye(2) + MATRIX.T @ MATRIX / 0.25)
SPREAD = np.linalg.cholesky(COVARIANCE)

def sample(x, n, seed):
    noise = WIDTH * np.random.default_rng(seed).standard_normal((len(x), n, 2))
    return (x @ MATRIX @ COVARIANCE / 0.25)[:, None] + noise @ SPREAD.T
"""


@pytest.fixture
def theirs(tmp_path: Path) -> Any:
    def write(width: float = 1.0) -> Path:
        path = tmp_path / "theirs.py"
        path.write_text(f"WIDTH = {width}\n" + THEIRS)
        return path

    return write


TOY = ("--simulator", "linear_gaussian", "--set", "simulator.parameters=2", "--set", "simulator.data=3")
SMALL = ("--set", "trials.number=40", "--set", "trials.draws=20", "--validator", "draws", "--quiet")


# The seed is fixed here so that nothing changes from run to run; another would give the other verdict in
# fewer than one of a hundred.
@pytest.mark.parametrize(("width", "verdict"), [(1.0, "PASS"), (0.6, "FAIL")])
def test_good_passes_and_narrow_fails_as_in_this_process(
    sandbox: Any, theirs: Any, tmp_path: Path, width: float, verdict: str
) -> None:
    trials = {"number": 1500, "draws": 60, "seed": 11, "joint_number": 0, "block": 500}
    toy = {"name": "linear_gaussian", "parameters": 2, "data": 3}
    select = ["draws", "sbc", "coverage"]
    config = AuditConfig.build(
        {
            "simulator": toy,
            "estimator": {"name": "stranger", "path": str(theirs(width))},
            "trials": trials,
            "validators": select,
        }
    )
    policy = make_policy(POLICY, source="test")
    result = audit_configured(config, tmp_path / "out", policy=policy)
    assert result.verdict.outcome.name == verdict
    own = {"name": "broken", "base": {"name": "exact"}, "fault": "narrow", "size": width}
    same = AuditConfig.build(
        {
            "simulator": toy,
            "estimator": {"name": "exact"} if width == 1.0 else own,
            "trials": trials,
            "validators": select,
        }
    )
    trusted = audit_configured(same, tmp_path / "own", policy=policy)
    assert trusted.verdict.outcome.name == verdict
    assert result.trials["theta_true"].equals(trusted.trials["theta_true"])


def test_one_command_is_enough(sandbox: Any, theirs: Any, tmp_path: Path) -> None:
    done = [
        inside("audit", "--estimator", theirs(), *TOY, *SMALL, "--out", name, cwd=tmp_path) for name in "ab"
    ]
    assert [one.returncode for one in done] == [3, 3], done[0].stderr
    first, second = (json.loads((tmp_path / name / "verdict.json").read_text()) for name in "ab")
    assert first["provenance"]["seed"] != second["provenance"]["seed"]
    record = first["provenance"]
    assert len(record["estimator"]["sha256"]["model"]) == 64
    assert record["confinement"]["sandbox"]["program"].startswith("bubblewrap")
    assert not (tmp_path / "a" / ".chunks").exists()
    # Who reads the report sees which file it is of.
    assert record["title"] == "stranger (theirs.py) on linear_gaussian"
    assert Path(record["estimator"]["options"]["path"]).name == "theirs.py"
    assert record["estimator"]["format_options"] == {}


def test_interrupted_it_goes_on_with_the_seed_it_began_with(
    sandbox: Any, theirs: Any, tmp_path: Path
) -> None:
    path = theirs()

    def stop(what: str, done: int, total: int) -> None:
        if done >= 30:
            raise KeyboardInterrupt

    (tmp_path / "audit.toml").write_text(
        f"""
        validators = ["draws"]
        [simulator]
        name = "linear_gaussian"
        parameters = 2
        data = 3
        [estimator]
        name = "stranger"
        path = "{path.name}"
        [trials]
        number = 60
        draws = 10
        block = 10
        """
    )
    config = read_config(tmp_path / "audit.toml")
    with pytest.raises(KeyboardInterrupt):
        audit_configured(config, tmp_path / "out", progress=stop)
    (kept,) = (tmp_path / "out" / ".chunks").glob("*.seed")
    seed = int(kept.read_text())
    assert kept.stat().st_mode & 0o777 == 0o600
    before = len(list((tmp_path / "out" / ".chunks").glob("*/trials-*.nc")))
    assert before == 3
    audit_configured(config, tmp_path / "out", progress=False)
    verdict = json.loads((tmp_path / "out" / "verdict.json").read_text())
    assert verdict["provenance"]["seed"] == seed


def test_without_a_sandbox_the_command_ends_with_two_and_a_remedy(
    theirs: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gaugeblock.stranger.sandbox.STANDARD_PATH", "/nowhere")
    command = ("audit", "--estimator", theirs(), *TOY, *SMALL)
    done = inside(*command, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "apt-get install bubblewrap" in done.stderr
    trusted = inside(*command, "--i-trust-this-estimator", cwd=tmp_path)
    assert trusted.returncode == 3, trusted.stderr
    record = json.loads((tmp_path / "gaugeblock-audit" / "verdict.json").read_text())["provenance"]
    assert record["confinement"]["sandbox"] == "none: trusted by whoever ran the audit"


def test_what_is_lacking_is_one_line(theirs: Any, tmp_path: Path) -> None:
    done = inside("audit", "--estimator", theirs(), cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == (
        "gaugeblock: say what the estimator is for: --simulator NAME, or a configuration\n"
    )


def test_trust_is_no_file_s_to_ask_for(tmp_path: Path) -> None:
    path = tmp_path / "audit.toml"
    path.write_text('[estimator]\nname = "stranger"\npath = "theirs.py"\ntrust = true\n')
    with pytest.raises(InputError, match=r"estimator\.trust cannot be said by a file"):
        read_config(path)
    chosen = read_config(None, settings={"estimator.name": "stranger", "estimator.trust": True})
    assert chosen.estimator.options["trust"] is True


def test_files_that_a_configuration_names_lie_beside_it(tmp_path: Path) -> None:
    for name in ("theirs.pt", "build.py", "program", "more.py"):
        (tmp_path / name).write_text("")
    path = tmp_path / "audit.toml"
    path.write_text(
        '[estimator]\nname = "stranger"\npath = "theirs.pt"\nbuilder = "build.py:network"\n'
        'command = ["program", "--fast", "nothing"]\noptions = { source = "more.py", width = 3 }\n'
    )
    options = read_config(path).estimator.options
    here = tmp_path.resolve()
    assert options["path"] == str(here / "theirs.pt")
    assert options["builder"] == f"{here / 'build.py'}:network"
    assert options["command"] == [str(here / "program"), "--fast", "nothing"]
    assert options["options"] == {"source": str(here / "more.py"), "width": 3}


def test_options_of_the_command_line_are_keys_of_the_configuration(tmp_path: Path) -> None:
    nothing = {"path": None, "command": None, "python": None, "format": None, "builder": None}
    assert stranger_settings(**nothing, trust=False) == {}
    assert stranger_settings(**{**nothing, "command": "./program"}, trust=True) == {
        "estimator.name": "stranger",
        "estimator.command": "./program",
        "estimator.trust": True,
    }
