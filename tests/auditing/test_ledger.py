"""The ledger counts audits, tells truths that were used before, and draws seeds that were not."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

import gaugeblock as gb
from gaugeblock.auditing import ledger as ledgers
from gaugeblock.auditing.ledger import entered
from gaugeblock.auditing.verify import verify
from gaugeblock.core.errors import InputError
from gaugeblock.reports.ledger import UNKNOWN, of_the_ledger
from gaugeblock.reports.terminal import terminal_summary
from gaugeblock.validate import read_policy

PRIOR = gb.Prior({"mean": gb.Normal(0.0, 1.0)})
QUICK: dict[str, Any] = {"prior": PRIOR, "validators": ("draws", "sbc"), "progress": False, "draws": 20}
DEFAULT, STRICT = read_policy("default"), read_policy("strict")


def simulate(theta, rng):
    return rng.normal(theta, 1.0)


class Trained:
    """An estimator whose training left a bias, and which may be interrupted while it draws."""

    def __init__(self, bias: float = 0.0):
        self.bias = bias

    def sample(self, x, n, rng):
        return x[:, None] / 2 + self.bias + 0.5**0.5 * rng.standard_normal((len(x), n, 1))

    def describe(self):
        return {"bias": self.bias}


class Interrupted(Exception):
    pass


class Cut(Trained):
    """The same estimator, whose second block never comes."""

    __module__ = Trained.__module__
    calls = 0
    ends = True

    def sample(self, x, n, rng):
        Cut.calls += 1
        if Cut.ends and Cut.calls == 2:
            raise KeyboardInterrupt
        return super().sample(x, n, rng)


def audited(file: Path, bias: float, **options: Any) -> gb.Audit:
    options = {"trials": 30, **QUICK, **options}
    return gb.audit(Trained(bias), simulate, ledger=file, **options)


def lines(file: Path) -> list[dict[str, Any]]:
    return json.loads(file.read_text())["audits"]


def looks(line: dict[str, Any]) -> list[tuple[int, str | None]]:
    return [(look["trials"], look["outcome"]) for look in line["looks"]]


def record(result: gb.Audit) -> dict[str, Any]:
    return dict(result.verdict.provenance["ledger"])


def begun(file: Path, estimator: str, *, seed: int = 1, release: bool = False, **options: Any) -> Any:
    """An entry alone, without an audit."""
    things = {
        "simulator": {"name": options.get("simulator", "s"), "class": options.get("simulator", "s")},
        "estimator": {"name": "e", "class": estimator},
    }
    trials = {"number": options.get("trials", 100), "block": 200, "draws": 250, "seed": seed}
    things["trials"] = trials | options.get("made", {})
    return entered(file, things, options.get("policy", DEFAULT), release=release)


def test_audits_are_counted_and_listed_in_order(tmp_path: Path) -> None:
    file = tmp_path / "ledger.json"
    first = audited(file, 0.0, seed=1)
    audited(file, 3.0, seed=2)
    audited(file, 0.0, seed=3)
    last = audited(file, 0.5, seed=4, trials=40)
    assert (record(first)["earlier"], record(first)["estimators"]) == (0, 0)
    assert (record(last)["earlier"], record(last)["estimators"]) == (3, 2)
    assert [line["seed"] for line in lines(file)] == [1, 2, 3, 4]
    assert looks(lines(file)[1]) == [(30, "FAIL")]
    assert looks(lines(file)[3]) == [(40, last.outcome)]
    kept = last.verdict.provenance["sha256"]
    assert {name: lines(file)[3][name] for name in ("simulator", "estimator", "policy")} == {
        name: kept[name] for name in ("simulator", "estimator", "policy")
    }


def test_only_audits_of_this_simulator_under_this_policy_count(tmp_path: Path) -> None:
    file = tmp_path / "ledger.json"
    begun(file, "a", simulator="another")
    begun(file, "a", seed=2, policy=STRICT)
    begun(file, "b", seed=3)
    assert begun(file, "c", seed=4).record["earlier"] == 1
    assert begun(file, "c", seed=4, policy=STRICT).record["earlier"] == 1


def test_an_audit_that_is_resumed_or_enlarged_is_the_same_audit(tmp_path: Path) -> None:
    file = tmp_path / "ledger.json"
    begun(file, "a", seed=1)
    before = begun(file, "b", seed=1)
    begun(file, "c", seed=1)
    again, larger = begun(file, "b", seed=1), begun(file, "b", seed=1, trials=400)
    assert before.record == again.record == larger.record
    assert len(lines(file)) == 3
    larger.ended("PASS")
    assert looks(lines(file)[1]) == [(100, None), (400, "PASS")]
    # A rerun changes nothing, and another outcome of it does not take the first one's place.
    larger.ended("PASS")
    larger.ended("FAIL")
    assert [look["outcome"] for look in lines(file)[1]["looks"]] == [None, "PASS", "FAIL"]


def test_truths_that_judged_others_before_are_told(tmp_path: Path) -> None:
    file = tmp_path / "ledger.json"
    assert begun(file, "a").record["same_truths"] == 0
    assert begun(file, "b").record["same_truths"] == 1
    # The truths do not depend on the policy.
    assert begun(file, "c", policy=STRICT).record["same_truths"] == 2
    assert begun(file, "c").record["same_truths"] == 2
    assert begun(file, "a", policy=STRICT).record["same_truths"] == 0
    assert begun(file, "d", seed=2).record["same_truths"] == 0
    assert begun(file, "d", simulator="another").record["same_truths"] == 0


def test_a_release_has_one_seed_that_nobody_saw(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "ledger.json"
    bits = iter([7, 7, 9, 11])
    monkeypatch.setattr(ledgers.secrets, "randbits", lambda _: next(bits))
    begun(file, "z", seed=7)
    first = begun(file, "a", release=True)
    assert first.seed == 9  # 7 was seen
    assert lines(file)[-1]["seed"] == 9
    assert begun(file, "a", release=True).seed == 9
    assert begun(file, "a", release=True, trials=4000).seed == 9
    assert begun(file, "a", release=True, policy=STRICT).seed == 9
    other = begun(file, "b", release=True)
    assert (other.seed, other.record["releases"], other.record["earlier"]) == (11, 1, 2)
    assert first.record["release"]
    assert not begun(file, "a", seed=9).record["release"]


@pytest.mark.parametrize(
    ("made", "fresh"), [({"block": 100}, True), ({"draws": 80}, False), ({"importance_draws": 10}, False)]
)
def test_trials_that_are_made_otherwise_are_another_audit(
    tmp_path: Path, made: dict[str, int], fresh: bool
) -> None:
    """By another block the same seed draws other truths: nobody gets these for nothing."""
    file = tmp_path / "ledger.json"
    begun(file, "a")
    other = begun(file, "a", made=made)
    assert (other.record["earlier"], other.record["estimators"]) == (1, 1)
    assert other.looked_at == [{"trials": 100}]
    assert begun(file, "a", made=made).record == other.record
    assert len(lines(file)) == 2
    assert [name in lines(file)[1]["trials"] for name in ("number", "seed", *made)] == [False, False, True]
    # Whether these are the truths that judged another estimator before.
    assert begun(file, "b", made=made, trials=400).record["same_truths"] == 1
    assert begun(file, "c", made={"block": 100}).record["same_truths"] == (2 if fresh else 0)
    assert begun(file, "d", made={"joint_draws": 7}).record["same_truths"] == (1 if fresh else 2)
    # Likelihoods of more trials are those of the same audit, and another look at it.
    more = begun(file, "a", made={**made, "joint_number": 9})
    assert more.record == other.record
    assert more.looked_at == [{"trials": 100}, {"trials": 100, "joint_number": 9}]
    more.ended("PASS")
    assert [look["outcome"] for look in lines(file)[1]["looks"]] == [None, "PASS"]


def test_a_release_keeps_to_how_its_trials_are_made(tmp_path: Path) -> None:
    file = tmp_path / "ledger.json"
    first = begun(file, "a", release=True)
    before = file.read_bytes()
    for made in ({"block": 100}, {"draws": 80}, {"anytime": True}):
        with pytest.raises(InputError, match=r"begun on trials made otherwise \((block|draws|any)") as caught:
            begun(file, "a", release=True, made=made)
        assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match="block 200 there, 100 here"):
        begun(file, "a", release=True, policy=STRICT, made={"block": 100})
    assert file.read_bytes() == before
    assert begun(file, "a", release=True, made={"joint_number": 50}).seed == first.seed
    assert begun(file, "b", release=True, made={"block": 100}).record["releases"] == 1


def test_an_audit_enters_how_its_trials_are_made(tmp_path: Path) -> None:
    file = tmp_path / "ledger.json"
    audited(file, 0.0, seed=1)
    second = audited(file, 0.0, trials={"number": 30, "block": 10}, seed=1)
    third = audited(file, 0.0, seed=1, anytime=True, validators=None)
    assert [record(one)["earlier"] for one in (second, third)] == [1, 2]
    assert [line["trials"]["block"] for line in lines(file)] == [200, 10, 200]
    assert [line["trials"].get("anytime") for line in lines(file)] == [None, None, True]
    options = {"release": True, "out": tmp_path / "out"}
    audited(file, 0.0, **options)
    with pytest.raises(InputError, match="block 200 there, 10 here"):
        audited(file, 0.0, trials={"number": 30, "block": 10}, **options)


def test_what_stopped_by_itself_had_no_look_before(tmp_path: Path) -> None:
    options = {"trials": {"number": 400, "block": 50}, "anytime": True, "validators": None}
    result = audited(tmp_path / "ledger.json", 3.0, **options)
    used = result.verdict.provenance["trials"]["used"]
    assert used < 400
    assert result.verdict.looks.trials == (used,)


def test_audits_under_other_policies_are_told_beside(tmp_path: Path) -> None:
    """A policy that is hardly another one is counted by itself; that there were others is said."""
    file, out = tmp_path / "ledger.json", tmp_path / "out"
    audited(file, 0.1, seed=1)
    audited(file, 0.1, seed=2, policy={"tolerance": {"bias": 0.1000001}})
    options = {"seed": 1, "policy": {"tolerance": {"bias": 0.1000002}}, "out": out}
    audited(file, 0.1, **{**options, "seed": 3, "out": None})
    result = audited(file, 0.1, **options)
    assert (record(result)["earlier"], record(result)["same_truths"]) == (1, 0)
    assert (record(result)["other_policies"], record(result)["same_truths_other_policies"]) == (2, 1)
    assert result.verdict.looks.other_policies == 1
    for text in (
        terminal_summary(result.verdict, out),
        (out / "summary.md").read_text(),
        (out / "report.html").read_text(),
    ):
        assert "1 earlier audit of these truths under another policy." in text
        assert "Under other policies it had 2 earlier audits, not among these." in text
    assert verify(out).differences == ()
    # What comes after changes nothing of it, and another block has other truths.
    audited(file, 0.1, seed=1)
    assert record(audited(file, 0.1, **options)) == record(result)
    other = audited(file, 0.1, seed=1, policy="strict", trials={"number": 30, "block": 10})
    assert (record(other)["other_policies"], other.verdict.looks.other_policies) == (4, 0)


def test_an_interrupted_release_goes_on_with_its_seed(tmp_path: Path) -> None:
    file, out = tmp_path / "ledger.json", tmp_path / "out"
    options = {**QUICK, "trials": {"number": 30, "block": 10}, "ledger": file, "release": True}
    Cut.calls, Cut.ends = 0, True
    with pytest.raises(KeyboardInterrupt):
        gb.audit(Cut(), simulate, out=out, **options)
    (line,) = lines(file)
    assert line["release"]
    assert looks(line) == [(30, None)]
    Cut.ends = False
    done = gb.audit(Cut(), simulate, out=out, **options)
    assert Cut.calls == 4  # the first block, the one that was cut, and it again with the third
    assert done.verdict.provenance["seed"] == line["seed"]
    assert [one["seed"] for one in lines(file)] == [line["seed"]]
    assert looks(lines(file)[0]) == [(30, done.outcome)]
    assert verify(out).differences == ()
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    gb.audit(Cut(), simulate, out=out, **options)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before


def test_what_terminal_summary_and_report_say(tmp_path: Path) -> None:
    file, out = tmp_path / "ledger.json", tmp_path / "out"
    audited(file, 0.1, seed=1)
    audited(file, 0.2, seed=1)
    result = audited(file, 0.3, seed=1, out=out)
    said = "The 3rd audit of this simulator under this policy: 2 earlier ones, of 2 estimators."
    reused = "The same truths judged 2 estimators before: a PASS is optimistic"
    for text in (
        terminal_summary(result.verdict, out),
        (out / "summary.md").read_text(),
        (out / "report.html").read_text(),
    ):
        assert said in text
        assert reused in text
        assert "truths unused" not in text
    released = terminal_summary(audited(file, 0.3, release=True).verdict, out)
    assert "The 4th audit" in released
    assert "Release audit: truths unused until the estimator was final." in released
    assert reused not in released
    # Judged under another policy, the count is still that of the policy of the audit.
    other = gb.judge(out, "strict", out=tmp_path / "other")
    assert "under the policy it was audited under, which is another: 2" in of_the_ledger(
        other.verdict.provenance
    )


def test_without_a_ledger_one_short_sentence(tmp_path: Path) -> None:
    result = gb.audit(Trained(), simulate, trials=30, out=tmp_path, **QUICK)
    assert result.verdict.provenance["ledger"] is None
    assert terminal_summary(result.verdict, tmp_path).splitlines().count(UNKNOWN) == 1
    assert (tmp_path / "summary.md").read_text().count(UNKNOWN) == 1
    assert (tmp_path / "report.html").read_text().count(UNKNOWN) == 1


def test_a_strangers_record_is_words_all_the_same() -> None:
    assert of_the_ledger({"ledger": {"earlier": "<b>", "estimators": None}}).startswith("The 1st audit")
    assert of_the_ledger({"ledger": ["x"]}) == UNKNOWN


def test_two_networks_that_cannot_be_told_apart_are_two(tmp_path: Path) -> None:
    file = tmp_path / "ledger.json"
    things = {
        "simulator": {"class": "s"},
        "estimator": {"state_sha256": None},
        "trials": {"number": 10, "seed": 1},
    }
    for _ in range(2):
        entry = entered(file, things, DEFAULT, release=False)
    third = entered(file, things, DEFAULT, release=False)
    assert entry.record["estimators"] == 1
    assert third.record["estimators"] == 2
    with pytest.raises(InputError, match="cannot be told from another's"):
        entered(file, things, DEFAULT, release=True)


@pytest.mark.parametrize(
    "content",
    [
        '{"format": 2, "audits": [',
        "",
        "[]",
        '{"format": 1, "audits": []}',
        '{"format": 2, "audits": [{"seed": 1}]}',
        '{"format": 2, "audits": {}}',
        "\xff",
    ],
)
def test_a_damaged_ledger_stops_everything_and_stays(tmp_path: Path, content: str) -> None:
    file, out = tmp_path / "ledger.json", tmp_path / "out"
    file.write_bytes(content.encode("latin-1"))
    with pytest.raises(InputError, match="the ledger is damaged, or no ledger; restore it") as caught:
        audited(file, 0.0, out=out)
    assert "\n" not in str(caught.value)
    assert file.read_bytes() == content.encode("latin-1")
    assert not out.exists()


def test_an_audit_that_vanished_from_its_ledger_is_told(tmp_path: Path) -> None:
    file = tmp_path / "ledger.json"
    entry = begun(file, "a")
    file.unlink()
    with pytest.raises(InputError, match="no longer in the ledger"):
        entry.ended("PASS")
    assert not file.exists()


def test_what_a_release_needs(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="give one with --ledger FILE"):
        gb.audit(Trained(), simulate, release=True, **QUICK)
    file = tmp_path / "ledger.json"
    for given in ({"seed": 3}, {"trials": {"seed": 3}}):
        with pytest.raises(InputError, match="leave out --seed"):
            audited(file, 0.0, release=True, **given)
    with pytest.raises(InputError, match="make it first"):
        audited(tmp_path / "nowhere" / "ledger.json", 0.0)
    assert not list(tmp_path.iterdir())


def test_a_lock_that_cannot_be_had(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "ledger.json"
    monkeypatch.setattr(ledgers, "PATIENCE", 0.1)
    with ledgers._locked(file), pytest.raises(InputError, match="locked by another audit") as caught:
        begun(file, "a")
    assert "\n" not in str(caught.value)
    assert not file.exists()
    begun(file, "a")


APPENDING = """
import sys
from pathlib import Path
from gaugeblock.auditing.ledger import entered
from gaugeblock.validate import read_policy
policy = read_policy("default")
print("ready", flush=True)
sys.stdin.readline()
for number in range(20):
    things = {"simulator": {"class": "s"}, "estimator": {"class": f"{sys.argv[2]}{number}"}}
    things["trials"] = {"number": 10, "seed": number}
    entry = entered(Path(sys.argv[1]), things, policy, release=False)
    entry.ended("PASS")
"""


def test_two_processes_at_once_lose_nothing(tmp_path: Path) -> None:
    file = tmp_path / "ledger.json"
    running = [
        subprocess.Popen(
            [sys.executable, "-c", APPENDING, str(file), name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for name in ("a", "b")
    ]
    for process in running:
        assert process.stdout is not None
        process.stdout.readline()
    for process in running:
        process.communicate("go\n", timeout=120)
        assert process.returncode == 0
    assert len({line["estimator"] for line in lines(file)}) == len(lines(file)) == 40
    assert all(looks(line) == [(10, "PASS")] for line in lines(file))


def test_two_that_enter_at_once_are_counted_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between reading and writing nobody else reads: without the lock both would be the first."""
    file, read, found = tmp_path / "ledger.json", ledgers._read, []

    def slow(path: Path) -> list[dict[str, Any]]:
        content = read(path)
        time.sleep(0.1)
        return content

    monkeypatch.setattr(ledgers, "_read", slow)
    threads = [threading.Thread(target=lambda name=name: found.append(begun(file, name))) for name in "ab"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(entry.record["earlier"] for entry in found) == [0, 1]
    assert len(lines(file)) == 2
