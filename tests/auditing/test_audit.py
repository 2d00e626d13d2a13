"""What an audit records of itself, tells on its way, and refuses before anything runs."""

from __future__ import annotations

import json
import pickle
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gaugeblock as gb
from gaugeblock.auditing.audit import audit, audit_configured, audit_part
from gaugeblock.auditing.audit_draws import audit_draws
from gaugeblock.auditing.config import TrialsTable, read_config
from gaugeblock.auditing.identity import identity, versions
from gaugeblock.auditing.judging import judge
from gaugeblock.auditing.trusted import SEED
from gaugeblock.auditing.workplace import alone_in
from gaugeblock.core.digest import digest, file_digest
from gaugeblock.core.errors import InputError
from gaugeblock.validate import Outcome, read_policy, storage
from gaugeblock.validate.validators import default_validators

PRIOR = gb.Prior({"mean": gb.Normal(0.0, 1.0)})
TABLE = {"number": 160, "draws": 20, "block": 40, "importance_number": 0, "joint_number": 0, "seed": 3}
WIDE = {
    "required": ["draws.finite", "sbc.bias", "sbc.log_width"],
    "tolerance": {"bias": 0.6, "log_width": 0.6, "coverage": 0.4},
}


class Model:
    prior = PRIOR

    def simulate(self, theta: Any, rng: Any) -> Any:
        return rng.normal(theta, 1.0)


class Posterior:
    def __init__(self, width: float = 1.0):
        self.width = width

    def sample(self, x: Any, n: int, rng: Any) -> Any:
        return x[:, None] / 2 + self.width * np.sqrt(0.5) * rng.standard_normal((len(x), n, 1))


CHECKS = ("draws", "sbc")
# What passes, so that nothing is diagnosed.
QUICK: dict[str, Any] = {
    "validators": ("draws",),
    "policy": {"required": ["draws.finite"]},
    "progress": False,
}


@pytest.fixture(scope="module")
def told() -> list[tuple[str, int, int]]:
    return []


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, told: list[tuple[str, int, int]]) -> Path:
    """An audit that does not PASS."""
    out = tmp_path_factory.mktemp("audit") / "out"
    audit(
        Posterior(0.2), Model(), trials=TABLE, policy=WIDE, validators=CHECKS, out=out,
        command="what was typed", progress=lambda *said: told.append(said),
    )  # fmt: skip
    return out


def record_in(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "verdict.json").read_text())["provenance"])


def test_what_is_recorded(folder: Path) -> None:
    record = record_in(folder)
    policy = json.loads(json.dumps(gb.judge(folder, WIDE).verdict.provenance["policy"]))
    simulator, estimator = identity(Model()), identity(Posterior(0.2))
    plan = asdict(TrialsTable(**TABLE).plan())
    assert record["command"] == "what was typed"
    assert record["seed"] == 3
    assert record["simulator"] == json.loads(json.dumps({"name": "Model", **simulator}))
    assert record["estimator"] == json.loads(json.dumps({"name": "Posterior", **estimator}))
    assert record["trials"] == plan
    assert record["title"] == "Posterior on Model"
    assert (record["ledger"], record["equal_bits"], len(record["processors"])) == (None, True, 1)
    assert record["trust"]["caveats"] == []
    assert (record["trust"]["simulator"], record["trust"]["estimator"]) == ("named", "named")
    assert record["policy"] == policy
    assert record["validators"] == list(CHECKS)
    assert record["versions"] == versions()
    assert record["format"] == 2
    assert record["sha256"] == {
        "simulator": digest(json.loads(json.dumps(simulator))),
        "estimator": digest(json.loads(json.dumps(estimator))),
        "policy": digest(policy),
        "trials": file_digest(folder / "trials.nc"),
    }
    assert not {"observation", "commitment", "confinement", "listing"} & set(record)


def test_what_is_told_on_the_way(folder: Path, told: list[tuple[str, int, int]]) -> None:
    assert folder.is_dir()
    once = ("validators", "what is wrong")
    assert [said for said in told if said[0] in once] == [(name, k, 1) for name in once for k in (0, 1)]
    assert told.index(("trials", 160, 160)) < told.index(("validators", 0, 1))
    assert not (folder / ".chunks").exists()


def test_the_record_of_one_that_stops_by_itself_and_of_all_validators(tmp_path: Path) -> None:
    options: dict[str, Any] = {"trials": {**TABLE, "number": 40}, "policy": WIDE, "progress": False}
    result = audit(Posterior(), Model(), anytime=True, **options)
    said = result.verdict.provenance["trials"]
    assert (said["anytime"], said["used"], said["number"]) == (True, result.trials.sizes["trial"], 40)
    assert {"draws", "anytime"} <= set(result.verdict.provenance["validators"])
    again = audit(Posterior(), Model(), **options)
    assert again.verdict.provenance["validators"] == list(default_validators())
    assert "command" in again.verdict.provenance
    assert again.trials["draws"].values.shape == (40, 20, 1)


def test_judged_again_only_what_judged_it_changes(folder: Path, tmp_path: Path) -> None:
    lenient = {**WIDE, "tolerance": {"bias": 9.0, "log_width": 9.0, "coverage": 0.9}}
    before = record_in(folder)
    made = judge(folder, lenient, out=tmp_path / "again", seed=8, command="judged")
    record = record_in(tmp_path / "again")
    assert made.outcome is Outcome.PASS
    changed = {name for name in record if record[name] != before.get(name)}
    assert changed == {"command", "judge_seed", "policy", "sha256"}
    assert (record["command"], record["judge_seed"], record["seed"]) == ("judged", 8, 3)
    assert record["sha256"] == {**before["sha256"], "policy": digest(record["policy"])}
    assert judge(folder, lenient).verdict.provenance["judge_seed"] == 3
    for audited in (folder, gb.judge(folder, WIDE)):
        assert judge(audited, WIDE).verdict.diagnosis is not None
        assert judge(audited, WIDE).outcome is Outcome.FAIL
    assert judge(folder, WIDE).verdict.looks == made.verdict.looks


def test_draws_in_hand_and_their_record(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    theta, draws = rng.normal(size=(160, 1)), rng.normal(size=(160, 20, 1))
    np.savez(tmp_path / "t.npz", theta_true=theta, draws=draws)
    said: list[tuple[str, int, int]] = []
    options: dict[str, Any] = {"policy": WIDE, "validators": CHECKS, "seed": 7, "command": "typed"}
    made = audit_draws(theta, draws, progress=lambda *one: said.append(one), **options)
    record = made.verdict.provenance
    assert (record["trials"], record["seed"], record["command"], record["title"]) == ({}, 7, "typed", "Audit")
    assert record["trust"] == {"estimator": "draws from disk", "caveats": []}
    assert record["ledger"] is None
    assert set(record["sha256"]) == {"policy"}
    assert made.verdict.looks.trials == (160,)
    assert ("validators", 1, 1) in said
    for path in (tmp_path / "t.npz", str(tmp_path / "t.npz")):
        stored = audit_draws(path, out=tmp_path / "out", progress=False, **options).verdict.provenance
        assert stored["trials"] == {"file": str(path), "file_sha256": file_digest(tmp_path / "t.npz")}
        assert stored["title"] == "Draws from t.npz"
        assert stored["sha256"]["trials"] == file_digest(tmp_path / "out" / "trials.nc")
    further = {"log_q": rng.normal(size=(160, 20)), "log_q_true": rng.normal(size=160), "x": theta + 1}
    weight = rng.random((160, 20))
    held = audit_draws(theta, draws, weight=weight, autocorrelated=True, **further, **options).trials
    for name, values in {**further, "weight": weight}.items():
        np.testing.assert_array_equal(held[name].values, values)
    assert held.attrs["autocorrelated"] == 1


@pytest.mark.parametrize(
    ("estimator", "options", "said"),
    [
        (
            Model(),
            {},
            "the estimator is a Model, which simulates; the order is (estimator, simulator)",
        ),
        (
            Posterior(),
            {"release": True},
            "a release audit draws a seed that its ledger has not seen: give one with --ledger FILE",
        ),
        (
            Posterior(),
            {"release": True, "ledger": "ledger.json", "seed": 3},
            "a release audit draws its own seed: leave out --seed, and seed of [trials]",
        ),
        (
            Posterior(),
            {"commitment": (Path("a"), Path("b")), "seed": 3},
            "a commitment makes its own seed: leave out --seed, seed of [trials], and --release",
        ),
        (
            Posterior(),
            {"commitment": (Path("a"), Path("b")), "release": True, "ledger": "ledger.json"},
            "a commitment makes its own seed: leave out --seed, seed of [trials], and --release",
        ),
    ],
)
def test_what_does_not_go_together(
    estimator: Any, options: dict[str, Any], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        audit(estimator, Model(), **options)
    assert str(caught.value) == said
    assert list(tmp_path.iterdir()) == []


def test_who_is_not_trusted_answers_one_process_alone() -> None:
    stranger: Any = Posterior()
    stranger.untrusted = True

    class Never:
        def submit(self, *given: Any) -> Any:
            raise AssertionError

    with pytest.raises(
        InputError, match=r"answers one process alone.*leave out workers, scheduler, part and"
    ):
        audit(stranger, Model(), executor=Never())  # type: ignore[arg-type]


def test_the_seed_of_who_is_not_trusted_cannot_be_foreseen_unless_it_is_given() -> None:
    stranger: Any = Posterior()
    stranger.untrusted = True
    table = {**TABLE, "number": 40}
    given = audit(stranger, Model(), trials=table, validators=("draws",), progress=False)
    assert given.verdict.provenance["seed"] == 3
    assert given.verdict.provenance["trust"]["caveats"] == [SEED]
    del table["seed"]
    seeds = {
        audit(stranger, Model(), trials=table, validators=("draws",), progress=False).verdict.provenance[
            "seed"
        ]
        for _ in range(2)
    }
    assert len(seeds) == 2
    assert TrialsTable().seed not in seeds
    drawn = audit(stranger, Model(), trials=table, validators=("draws",), progress=False)
    assert drawn.verdict.provenance["trust"]["caveats"] == []
    mine = audit(Posterior(), Model(), trials=table, validators=("draws",), progress=False)
    assert mine.verdict.provenance["seed"] == TrialsTable().seed


def test_looks_of_who_is_not_trusted_are_counted_together_whatever_their_seeds(tmp_path: Path) -> None:
    stranger: Any = Posterior()
    stranger.untrusted = True
    table = {name: value for name, value in TABLE.items() if name != "seed"}
    options: dict[str, Any] = {**QUICK, "out": tmp_path}
    looks = [
        audit(stranger, Model(), trials={**table, "number": number}, **options).verdict.looks.trials
        for number in (20, 40)
    ]
    assert looks == [(20,), (20, 40)]


def test_what_was_audited_without_a_folder_needs_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """Large trials stay on disk as long as there is one."""
    monkeypatch.setattr(storage, "IN_MEMORY", 100)
    made = audit(Posterior(), Model(), trials=TABLE, **QUICK).trials
    assert len(pickle.dumps(made)) > made["draws"].nbytes == 160 * 20 * 8  # which would else name its file


def test_policies_of_every_kind_judge() -> None:
    strict = read_policy("strict")
    for policy in ("strict", strict, {"base": "strict"}):
        result = audit(
            Posterior(),
            Model(),
            trials={**TABLE, "number": 40},
            policy=policy,
            validators=CHECKS,
            progress=False,
        )
        assert result.verdict.provenance["policy"]["tolerance"] == strict.model_dump(mode="json")["tolerance"]


def test_parts_do_not_wait_for_each_other(tmp_path: Path) -> None:
    """Jobs of an array run side by side in one folder, which an audit has to itself."""
    config = read_config(
        None,
        settings={
            **{"simulator.name": "linear_gaussian", "estimator.name": "exact", "trials.seed": 3},
            **{"trials.number": 10, "trials.draws": 10, "trials.block": 5},
        },
    )
    with alone_in(tmp_path):
        assert audit_part(config, tmp_path, (1, 2)) > 0
        with pytest.raises(InputError, match="another audit is at work there"):
            audit_configured(config, tmp_path)


def test_trials_that_an_estimator_was_repaired_on_do_not_judge_it(tmp_path: Path) -> None:
    class Repaired:
        seed_of_repair, base = 3, Posterior()
        asked = False

        def sample(self, x: Any, n: int, rng: Any) -> Any:
            self.asked = True
            return self.base.sample(x, n, rng)

    repaired = Repaired()
    with pytest.raises(InputError, match=r"^the repaired estimator was repaired on the trials of seed 3,"):
        audit(repaired, Model(), trials=TABLE, ledger=tmp_path / "ledger.json", **QUICK)
    assert not repaired.asked
    assert not (tmp_path / "ledger.json").exists()
    assert audit(repaired, Model(), trials={**TABLE, "seed": 4}, **QUICK).passed
