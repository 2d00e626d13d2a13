"""Records that hold: which policy judged, whose folder it is, and what is removed."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from gaugeblock.auditing.audit import audit
from gaugeblock.auditing.judging import judge
from gaugeblock.auditing.verify import policy_in_words, verify
from gaugeblock.auditing.workplace import CHUNKS, LOCK, discard
from gaugeblock.cli import app
from gaugeblock.core.errors import InputError
from gaugeblock.validate import make_policy, read_policy

LAX = {"tolerance": {"bias": 9.0, "log_width": 9.0}}
SMALL = {"number": 40, "draws": 20, "importance_number": 0, "joint_number": 0, "seed": 4}


def audited(out: Path) -> Any:
    simulator = {"name": "linear_gaussian", "parameters": 2, "data": 2}
    return audit("exact", simulator, trials=SMALL, out=out, validators=["draws", "sbc"], progress=False)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("finished") / "out"
    audited(out)
    return out


@pytest.mark.attack("gate --policy lax.toml, then verify", "policy said; DIFFERENT by --policy")
def test_verify_says_which_policy(finished: Path, tmp_path: Path) -> None:
    kept = json.loads((finished / "verdict.json").read_text())["provenance"]["sha256"]
    assert verify(finished).policy == "the default policy"
    judge(finished, make_policy(LAX, source="lax"), out=tmp_path / "lax")
    (tmp_path / "lax" / "trials.nc").write_bytes((finished / "trials.nc").read_bytes())
    (tmp_path / "lax" / "findings.nc").write_bytes((finished / "findings.nc").read_bytes())
    done = CliRunner().invoke(app, ["verify", str(tmp_path / "lax")])
    assert done.exit_code == 0
    assert "under a policy of the audit's own, which differs from the default: tolerance.bias" in done.output
    asked = CliRunner().invoke(app, ["verify", str(tmp_path / "lax"), "--policy", "default"])
    assert asked.exit_code == 1
    assert "tolerance.bias is 9.0, should be 0.1" in asked.output
    assert CliRunner().invoke(app, ["verify", str(finished), "--policy", "default"]).exit_code == 0
    # Another estimator than the one whose digest somebody kept.
    assert not verify(finished, estimator_sha256=kept["estimator"], trials_sha256=kept["trials"]).differences
    (line,) = verify(finished, estimator_sha256="0" * 64).differences
    assert "sha256.estimator is" in line
    with pytest.raises(InputError, match="--estimator-sha256 none: must be 64"):
        verify(finished, estimator_sha256="none")


def test_policies_in_words() -> None:
    assert policy_in_words(read_policy("strict")) == "the strict policy"
    assert "tolerance.bias" in policy_in_words(make_policy(LAX, source="lax"))


@pytest.mark.attack("the work folder, or one in it, is a link", "refused, nothing removed")
@pytest.mark.parametrize("inner", [False, True])
def test_a_work_folder_that_is_a_link(tmp_path: Path, inner: bool) -> None:
    theirs = tmp_path / "theirs" / "0123456789abcdef"
    theirs.mkdir(parents=True)
    (theirs / "trials-00000000.nc").write_text("precious")
    (theirs / "notes.nc").write_text("precious")
    out = tmp_path / "out"
    work = out / CHUNKS
    (work if inner else out).mkdir(parents=True)
    (work / theirs.name if inner else work).symlink_to(theirs if inner else theirs.parent)
    with pytest.raises(InputError, match="is a link, and an audit works in folders of its own"):
        audited(out)
    discard(work)
    assert len(list(theirs.iterdir())) == 2


@pytest.mark.attack("files of somebody's in the work folder", "left as they are")
def test_only_an_audits_own_blocks_are_removed(tmp_path: Path) -> None:
    key = tmp_path / CHUNKS / "0123456789abcdef"
    key.mkdir(parents=True)
    own = [
        "trials-00000200.nc",
        "joint-likelihood.nc",
        ".densities-00000000.77.0123abcd.nc",
        "processor.json",
    ]
    theirs = ["thesis.nc", "trials-1.nc", "densities.txt"]
    for name in own + theirs:
        (key / name).write_text("")
    (tmp_path / CHUNKS / "data").mkdir()
    (tmp_path / CHUNKS / "data" / "trials.nc").write_text("")
    (tmp_path / CHUNKS / "0123456789abcdef.seed").write_text("1")
    discard(tmp_path / CHUNKS)
    left = {path.relative_to(tmp_path / CHUNKS).as_posix() for path in (tmp_path / CHUNKS).rglob("*.*")}
    assert left == {f"{key.name}/{name}" for name in theirs} | {"data/trials.nc"}


@pytest.mark.attack(
    "what killed audits left, and files of somebody's beside it", "the first removed, and nothing else"
)
def test_what_a_killed_audit_left_is_removed(tmp_path: Path) -> None:
    names = ("trials.nc", "findings.nc", "verdict.json", "report.html", "model_card.md", "looks.json")
    left = [".{}.77.0123abcd.{}".format(*name.split(".")) for name in names]
    theirs = [".thesis.77.0123abcd.nc", ".trials.nc", ".trials.77.0123abcd.txt", ".verdict.7.0123abc.json"]
    for name in left + theirs:
        (tmp_path / name).write_text("precious")
    audited(tmp_path)
    assert {path.name for path in tmp_path.glob(".*")} == set(theirs)


HOLD = """
import sys, time
from pathlib import Path
from gaugeblock.auditing.workplace import alone_in
with alone_in(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.mark.attack("two audits in one --out", "the second says so, exit 2; the first is not disturbed")
def test_a_second_audit_in_a_folder_says_so(tmp_path: Path) -> None:
    first = subprocess.Popen([sys.executable, "-c", HOLD, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    try:
        assert first.stdout is not None
        assert first.stdout.readline() == "held\n"
        with pytest.raises(InputError, match="another audit is at work there"):
            audited(tmp_path)
        # One that is killed leaves its file, and nobody has to remove it.
        first.kill()
        first.wait()
        assert (tmp_path / LOCK).exists()
        audited(tmp_path)
        assert not (tmp_path / LOCK).exists()
    finally:
        first.kill()
        first.communicate()


@pytest.mark.attack("a link in the place of the folder's lock", "refused, nothing written through it")
def test_a_lock_that_is_a_link(tmp_path: Path) -> None:
    (tmp_path / "theirs").write_text("precious")
    (tmp_path / LOCK).symlink_to(tmp_path / "theirs")
    with pytest.raises(InputError, match="cannot be written"):
        audited(tmp_path)
    assert (tmp_path / "theirs").read_text() == "precious"
