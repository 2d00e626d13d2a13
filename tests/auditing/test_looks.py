"""Audits that are enlarged keep their trials and share their error rates."""

from __future__ import annotations

import filecmp
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
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


@pytest.mark.parametrize("part", ["joint_number", "importance_number"])
def test_likelihoods_of_more_trials_are_another_look(forty: Path, tmp_path: Path, part: str) -> None:
    """Their gates would be judged again, on more of them, at the level of the first look."""
    ledger = tmp_path / "ledger.json"
    table = {"importance_draws": 30, part: 20}
    assert audited(tmp_path / "own", 40, table=table, ledger=ledger).verdict.looks.number == 1
    for folder in (tmp_path / "own", tmp_path / "other"):
        more = audited(folder, 40, table={**table, part: 30}, ledger=ledger).verdict
        assert more.looks.trials == (40, 40)
    assert audited(tmp_path / "own", 40, table=table, ledger=ledger).verdict.looks.number == 1


@pytest.mark.parametrize("change", [{"table": {"seed": 8}}, {"policy": "strict"}])
def test_another_seed_or_policy_is_counted_anew_and_neither_is_forgotten(
    forty: Path, change: dict[str, Any]
) -> None:
    other = audited(forty, 60, **change).verdict
    assert (other.looks.number, other.looks.anew) == (1, True)
    assert "are not counted" in of_looks(other)
    assert audited(forty, 80).verdict.looks.trials == (40, 80)


def test_the_same_truths_under_another_policy_are_told(forty: Path) -> None:
    loose = {"policy": {"tolerance": {"bias": 0.1000001}}}
    other = audited(forty, 40, **loose)
    assert (other.verdict.looks.number, other.verdict.looks.other_policies) == (1, 1)
    assert "1 earlier audit of these truths under another policy." in of_looks(other.verdict)
    assert not verify(forty).differences
    third = audited(forty, 60, policy="strict").verdict
    assert "2 earlier audits of these truths under other policies." in of_looks(third)
    # Of other truths there was none, and what was said first stays.
    assert audited(forty, 60, policy="strict", table={"block": 30}).verdict.looks.other_policies == 0
    assert audited(forty, 40, **loose).verdict == other.verdict
    assert audited(forty, 40).verdict.looks.other_policies == 0


def test_a_verdict_from_before_looks_is_read_as_the_first(forty: Path) -> None:
    path = forty / "verdict.json"
    content = json.loads(path.read_text())
    del content["looks"]
    path.write_text(json.dumps(content))
    assert gb.judge(forty).verdict.looks.number == 1


@pytest.mark.parametrize("looks", ['["x"]', '[{"trials": "x"}]', '[{"number": 1}]', "1"])
def test_a_damaged_record_is_refused(forty: Path, looks: str) -> None:
    rest = '"anew": false, "other_policies": 0, "policy": "p", "truths": "t"'
    (forty / "looks.json").write_text(f'{{"a": {{"looks": {looks}, {rest}}}}}')
    with pytest.raises(InputError, match=r"looks.json is damaged"):
        audited(forty, 60)


def test_looks_that_a_ledger_knows_count_in_another_folder(tmp_path: Path) -> None:
    audited(tmp_path / "a", 40, ledger=tmp_path / "own")
    assert audited(tmp_path / "b", 60, ledger=tmp_path / "own").verdict.looks.trials == (40, 60)


def drawn(number: int, seed: int = 1) -> dict[str, Any]:
    """Draws in hand, of which fewer are the first of more."""
    theta, noise = np.random.default_rng(seed).normal(size=(2, 200))[:, :number]
    more = np.random.default_rng(seed + 1).normal(size=(200, 20, 1))[:number]
    x = theta + noise
    return {"theta_true": theta[:, None], "draws": x[:, None, None] / 2 + 0.5**0.5 * more, "x": x[:, None]}


def in_hand(out: Path | None, arrays: dict[str, Any], **options: Any) -> gb.Audit:
    options = {"validators": ("sbc", "coverage"), "progress": False, **options}
    return gb.audit_draws(**arrays, out=out, **options)


def test_draws_in_hand_that_grow_share_their_error_rates(tmp_path: Path) -> None:
    first = in_hand(tmp_path / "a", drawn(50))
    written = (tmp_path / "a" / "verdict.json").read_bytes()
    second = in_hand(tmp_path / "a", drawn(120))
    third = in_hand(tmp_path / "a", drawn(200))
    assert [one.verdict.looks.trials for one in (first, second, third)] == [
        (50,), (50, 120), (50, 120, 200),
    ]  # fmt: skip
    assert "Look 3 at this audit, after 50 and 120 trials" in of_looks(third.verdict)
    assert not verify(tmp_path / "a").differences
    # As strict as the look of a simulated audit is.
    alone = in_hand(tmp_path / "b", drawn(120))
    name = next(name for name in second.gates if name.startswith("sbc.bias"))
    wide, narrow = second[name].pass_interval, alone[name].pass_interval
    assert wide[0] < narrow[0] < narrow[1] < wide[1]
    # The first look again, and fewer than there were.
    assert in_hand(tmp_path / "a", drawn(50)).verdict.looks.trials == (50,)
    assert (tmp_path / "a" / "verdict.json").read_bytes() == written
    assert in_hand(tmp_path / "a", drawn(80)).verdict.looks.trials == (50, 120, 200, 80)
    # Without a folder nobody knows.
    assert in_hand(None, drawn(120)).verdict.looks.trials == (120,)


def test_an_audit_that_was_saved_is_a_look_in_its_folder(tmp_path: Path) -> None:
    """Judged without a folder, and put there by hand: the next is the second look all the same."""
    in_hand(None, drawn(50)).save(tmp_path / "a")
    second = in_hand(tmp_path / "a", drawn(120))
    assert second.verdict.looks.trials == (50, 120)
    assert not verify(tmp_path / "a").differences
    audited(None, 40).save(tmp_path / "b")
    assert audited(tmp_path / "b", 60).verdict.looks.trials == (40, 60)
    # Saved elsewhere, it takes its looks along; saved where it is, nothing is counted twice.
    second.save(tmp_path / "c")
    assert in_hand(tmp_path / "c", drawn(200)).verdict.looks.trials == (50, 120, 200)
    second.save(tmp_path / "a")
    assert in_hand(tmp_path / "a", drawn(200)).verdict.looks.trials == (50, 120, 200)


def test_a_file_of_draws_in_single_precision_is_the_same_look(tmp_path: Path) -> None:
    arrays = {name: values.astype(np.float32) for name, values in drawn(50).items()}
    for kept in (np.float32, np.float64):
        tree = gb.make_trials(**arrays)
        gb.write_trials(tree.astype(kept), tmp_path / "t.nc")
        found = gb.audit_draws(tmp_path / "t.nc", out=tmp_path / "a", validators=("sbc",), progress=False)
        assert found.trials["draws"].dtype == kept
        assert found.verdict.looks.trials == (50,)


def test_draws_that_were_exchanged_behind_the_first_ones_are_another_look(tmp_path: Path) -> None:
    """As many as before, and not the same: whoever makes fresh ones until they pass has looked each time."""
    in_hand(tmp_path / "a", drawn(50))
    for number, name in ((2, "theta_true"), (3, "draws"), (4, "x")):
        arrays = drawn(50)
        arrays[name][30] += 0.1
        result = in_hand(tmp_path / "a", arrays)
        assert result.verdict.looks.trials == (50,) * number
    assert in_hand(tmp_path / "a", drawn(50), seed=3).verdict.looks.number == 5
    assert in_hand(tmp_path / "a", drawn(50)).verdict.looks.number == 1


def test_draws_that_begin_otherwise_are_counted_anew_and_it_is_said(tmp_path: Path) -> None:
    in_hand(tmp_path / "a", drawn(50))
    narrow = drawn(50)
    narrow["draws"] = narrow["draws"] / 2
    for arrays in (drawn(120, seed=5), narrow, {**drawn(50), "policy": "strict"}):
        other = in_hand(tmp_path / "a", arrays).verdict
        assert (other.looks.number, other.looks.anew) == (1, True)
        said = of_looks(other)
        assert "at draws that do not begin as these do, or under another policy, are not counted" in said
        policies = "2 earlier audits of these truths under other policies" if "policy" in arrays else ""
        assert said.partition("not counted.")[2].strip(" .") == policies
    assert in_hand(tmp_path / "a", drawn(120)).verdict.looks.trials == (50, 120)
