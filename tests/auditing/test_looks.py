"""Audits that are enlarged keep their trials and share their error rates."""

from __future__ import annotations

import filecmp
import json
import shutil
from pathlib import Path
from typing import Any

import pytest

import gaugeblock as gb
from gaugeblock.auditing import collect, looks
from gaugeblock.auditing.result import Audit
from gaugeblock.auditing.verify import verify
from gaugeblock.core import processors
from gaugeblock.core.errors import InputError
from gaugeblock.reports.reason import of_looks


def audited(out: Path | None, number: int, **options: Any) -> Audit:
    table = {"number": number, "draws": 20, "block": 20, "importance_number": 0, "joint_number": 0, "seed": 7}
    table |= options.pop("table", {})
    options = {"validators": ("sbc", "coverage"), "progress": False, **options}
    return gb.audit("exact", "linear_gaussian", trials=table, out=out, **options)


@pytest.fixture(scope="module")
def first_look(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Audit]:
    folder = tmp_path_factory.mktemp("forty")
    return folder, audited(folder, 40)


@pytest.fixture
def forty(first_look: tuple[Path, Audit], tmp_path: Path) -> Path:
    """A copy of an audit of 40 trials."""
    return Path(shutil.copytree(first_look[0], tmp_path / "forty"))


def groups(number: int) -> dict[str, int]:
    """Trials with importance draws and likelihoods too."""
    return {
        **{"importance_number": number // 2, "importance_draws": 30},
        **{"joint_number": number, "joint_draws": 5},
    }


def same_trials(one: Path, other: Path) -> bool:
    """To the byte; pytest would take minutes to say where bytes differ."""
    return filecmp.cmp(one / "trials.nc", other / "trials.nc", shallow=False)


def test_an_enlarged_audit_keeps_its_trials_to_the_byte(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    audited(tmp_path / "fresh", 130, table=groups(130))
    audited(tmp_path / "grown", 70, table=groups(70))
    made: list[range] = []
    inner = collect.MainTrials.__call__

    def watched(self: Any, trials: range) -> Any:
        made.append(trials)
        return inner(self, trials)

    monkeypatch.setattr(collect.MainTrials, "__call__", watched)
    grown = audited(tmp_path / "grown", 130, table=groups(130))
    # Only whole blocks are in the file: the one that was cut at 70 is made again.
    assert made == [range(60, 80), range(80, 100), range(100, 120), range(120, 140)]
    assert same_trials(tmp_path / "grown", tmp_path / "fresh")
    assert grown.verdict.looks.trials == (70, 130)
    assert not verify(tmp_path / "grown").differences


def test_trials_of_another_processor_are_not_kept(forty: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They may round otherwise: all are made anew, and none are mixed."""
    made: list[range] = []
    inner = collect.MainTrials.__call__
    monkeypatch.setattr(
        collect.MainTrials, "__call__", lambda self, trials: made.append(trials) or inner(self, trials)
    )
    for module in (looks, processors):
        monkeypatch.setattr(module, "processor", lambda: "Chip B")
    enlarged = audited(forty, 80)
    assert made == [range(first, first + 20) for first in (0, 20, 40, 60)]
    assert enlarged.verdict.provenance["processors"] == ["Chip B"]


def test_nor_are_those_of_another_device_of_the_estimator(
    forty: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gaugeblock.estimators.exact.Exact.device", "mps:0", raising=False)
    made: list[range] = []
    inner = collect.MainTrials.__call__
    monkeypatch.setattr(
        collect.MainTrials, "__call__", lambda self, trials: made.append(trials) or inner(self, trials)
    )
    # All anew; and the next time, on the same device, only what is missing.
    for number, first in ((80, 0), (100, 80)):
        (made_on,) = audited(forty, number).verdict.provenance["processors"]
        assert made_on.endswith("(cpu, torch on mps:0)")
        assert made == [range(start, start + 20) for start in range(first, number, 20)]
        made.clear()


def test_trials_of_another_audit_or_that_were_touched_are_not_kept(forty: Path, tmp_path: Path) -> None:
    forged = (forty / "trials.nc").read_bytes()
    audited(tmp_path / "fresh", 60, table={"seed": 8})
    audited(forty, 60, table={"seed": 8})
    assert same_trials(forty, tmp_path / "fresh")
    audited(tmp_path / "touched", 40, table={"seed": 8})
    (tmp_path / "touched" / "trials.nc").write_bytes(forged)
    audited(tmp_path / "touched", 60, table={"seed": 8})
    assert same_trials(tmp_path / "touched", tmp_path / "fresh")


def test_a_second_look_is_stricter_and_the_same_look_is_the_same(
    forty: Path, first_look: tuple[Path, Audit], tmp_path: Path
) -> None:
    first, alone = first_look[1], audited(tmp_path / "b", 80)
    written = (forty / "verdict.json").read_bytes()
    second = audited(forty, 80)
    name = next(name for name in second.gates if name.startswith("sbc.bias"))
    for kind in ("interval", "pass_interval"):
        wide, narrow = getattr(second[name], kind), getattr(alone[name], kind)
        assert wide[0] < narrow[0] < narrow[1] < wide[1]
    assert second[name].statistic == alone[name].statistic
    # 40 trials again are the first look again, of which there is nothing new to learn.
    again = audited(forty, 40)
    assert (forty / "verdict.json").read_bytes() == written
    assert again.verdict == first.verdict
    assert audited(forty, 60).verdict.looks.trials == (40, 80, 60)
    assert gb.judge(forty, "strict").verdict.looks.number == 3


@pytest.mark.parametrize("change", [{"table": {"seed": 8}}, {"policy": "strict"}])
def test_another_seed_or_policy_is_counted_anew_and_neither_is_forgotten(
    forty: Path, change: dict[str, Any]
) -> None:
    other = audited(forty, 60, **change).verdict
    assert (other.looks.number, other.looks.anew) == (1, True)
    assert "are not counted" in of_looks(other)
    assert audited(forty, 80).verdict.looks.trials == (40, 80)


def test_a_verdict_from_before_looks_is_read_as_the_first(forty: Path) -> None:
    path = forty / "verdict.json"
    content = json.loads(path.read_text())
    del content["looks"]
    path.write_text(json.dumps(content))
    assert gb.judge(forty).verdict.looks.number == 1


def test_a_damaged_record_is_refused(forty: Path) -> None:
    (forty / "looks.json").write_text('{"a": {"trials": ["x"], "anew": false}}')
    with pytest.raises(InputError, match=r"looks.json is damaged"):
        audited(forty, 60)


def test_looks_that_a_ledger_knows_count_in_another_folder(tmp_path: Path) -> None:
    audited(tmp_path / "a", 40, ledger=tmp_path / "own")
    assert audited(tmp_path / "b", 60, ledger=tmp_path / "own").verdict.looks.trials == (40, 60)
