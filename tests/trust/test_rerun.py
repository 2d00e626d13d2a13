"""`verify --rerun`: trials that were made up, which everything that is derived from them agrees with."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from gaugeblock.auditing.audit import audit
from gaugeblock.auditing.config import as_policy
from gaugeblock.auditing.judging import judged_and_kept
from gaugeblock.auditing.looks import stored_looks
from gaugeblock.auditing.provenance import finished_audit
from gaugeblock.auditing.rerun import chance_to_catch, rerun
from gaugeblock.auditing.verify import verify
from gaugeblock.cli import app
from gaugeblock.core.errors import InputError
from gaugeblock.validate.trials import main_trials, read_trials, trials_tree

TABLE = {"number": 45, "draws": 20, "block": 10, "importance_number": 0, "joint_number": 0, "seed": 4}
SIMULATOR = {"name": "linear_gaussian", "parameters": 2, "data": 2}
CHECKS = ["draws", "sbc"]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("finished") / "out"
    audit("exact", SIMULATOR, trials=TABLE, out=out, validators=CHECKS, progress=False)
    return out


def forged(finished: Path, out: Path, name: str, rows: slice) -> Path:
    """An audit whose every file goes with trials of which some were made up."""
    out.mkdir()
    tree, content = read_trials(finished / "trials.nc"), finished_audit(finished)
    tree.load()
    values = main_trials(tree)[name].values.copy()
    values[rows] += 0.01
    dims = main_trials(tree)[name].dims
    main = main_trials(tree).assign({name: (dims, values)})
    tree = trials_tree(main)
    judged_and_kept(
        tree,
        as_policy("default"),
        seed=4,
        validators=tuple(CHECKS),
        provenance=content["provenance"],
        out=out,
        earlier=None,
        looks=stored_looks(content),
        progress=lambda what, done, total: None,
    )
    return out


def test_an_honest_audit_is_the_same_again(finished: Path) -> None:
    found = verify(finished, share=1.0)
    assert not found.differences
    assert "all truths and data, and the draws of 5 of 5 blocks" in found.notes[-1]
    done = CliRunner().invoke(app, ["verify", str(finished), "--rerun", "0.4"])
    assert done.exit_code == 0, done.output
    assert "the draws of 2 of 5 blocks" in done.output
    assert "1 in 40%" in done.output


THEIRS = """
import numpy as np
def sample(x, n, seed):
    return x[:, None, :] + np.random.default_rng(seed).normal(size=(len(x), n, 2))
"""


def test_a_stranger_is_asked_in_the_same_calls_again(sandbox: Any, tmp_path: Path) -> None:
    (tmp_path / "theirs.py").write_text(THEIRS)
    theirs = {"name": "stranger", "path": str(tmp_path / "theirs.py")}
    trials = {**TABLE, "block": 20}
    audit(theirs, SIMULATOR, trials=trials, out=tmp_path / "out", validators=CHECKS, progress=False)
    found = verify(tmp_path / "out", share=1.0)
    assert not found.differences
    assert "the draws of 3 of 3 blocks" in found.notes[-1]


@pytest.mark.attack("draws, data or truths made up, and all else with them", "DIFFERENT by --rerun")
@pytest.mark.parametrize("name", ["theta_true", "x", "draws"])
def test_trials_that_were_made_up(finished: Path, tmp_path: Path, name: str) -> None:
    folder = forged(finished, tmp_path / "out", name, slice(43, 45))
    assert not verify(folder).differences
    (line,) = verify(folder, share=1.0).differences
    assert f"trials.nc: {name}: 2 trial(s), the first of them 43, are not what seed" in line


def test_draws_are_found_as_often_as_is_said(finished: Path, tmp_path: Path) -> None:
    """Two of five blocks drawn again find one forged block in 40%; of 60, limits of one in 10^4."""
    folder = forged(finished, tmp_path / "out", "draws", slice(12, 13))
    caught = sum(bool(_again(folder)) for _ in range(60))
    assert 9 <= caught <= 39


def _again(folder: Path) -> tuple[str, ...]:
    return rerun(
        read_trials(folder / "trials.nc"), finished_audit(folder)["provenance"], 0.4, near=0.0
    ).differences


def test_the_chance_to_catch_counts_subsets() -> None:
    """Against all choices, by brute force: seven trials in blocks of two, three blocks drawn again."""
    for count in range(1, 8):
        worst = min(
            np.mean([any(trial // 2 in chosen for trial in hidden) for chosen in combinations(range(4), 3)])
            for hidden in combinations(range(7), count)
        )
        found = chance_to_catch(count, trials=7, block=2, replayed=3)
        assert found <= worst + 1e-12
        assert count % 2 or found == pytest.approx(worst)


@pytest.mark.attack("provenance that names a module, for --rerun", "refused without --allow-module")
def test_a_record_that_names_code(finished: Path) -> None:
    record = finished_audit(finished)["provenance"]
    tree = read_trials(finished / "trials.nc")
    for name, said in (("simulator", "subprocess:run"), ("estimator", "evil.module:thing")):
        with pytest.raises(InputError, match=r"Python's own|a file names it"):
            rerun(tree, {**record, name: {"name": said}}, 0.5, near=0.0)
    other = {"name": "stranger", "options": {"path": "x.py", "trust": True}}
    with pytest.raises(InputError, match="trust cannot be said by a file"):
        rerun(tree, {**record, "estimator": other}, 0.5, near=0.0)
    with pytest.raises(InputError, match="--rerun 0: must be above 0"):
        rerun(tree, record, 0.0, near=0.0)
    with pytest.raises(InputError, match="draws from disk have no seed"):
        rerun(tree, {**record, "trials": {}}, 0.5, near=0.0)
    # Another estimator than the one that was audited.
    lines = rerun(tree, {**record, "estimator": {**record["estimator"], "version": 7}}, 0.5, near=0.0)
    assert any("what is found by its name" in line for line in lines.differences)
