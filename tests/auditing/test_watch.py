"""Audits that stop by themselves: when, to the same bits, and what they say."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gaugeblock.auditing.audit import audit
from gaugeblock.auditing.collect import collect, fingerprint
from gaugeblock.auditing.config import AuditConfig
from gaugeblock.auditing.judging import judge
from gaugeblock.auditing.result import Audit
from gaugeblock.auditing.samples import Plan
from gaugeblock.auditing.watch import WATCHED, Watch, watched
from gaugeblock.estimators.exact import Exact
from gaugeblock.simulators import build_simulator
from gaugeblock.validate import Outcome, make_policy, make_trials, read_policy, run_validators
from gaugeblock.validate import judge as judged

PLAN = Plan(
    number=4000,
    draws=40,
    block=50,
    importance_number=60,
    importance_draws=20,
    joint_number=100,
    joint_draws=10,
    seed=3,
)
DEFAULT = read_policy("default")


@pytest.fixture
def simulator() -> Any:
    return build_simulator("linear_gaussian", parameters=1, data=2)


class Narrow(Exact):
    """Draws half as far from the mean as they should be."""

    def sample(self, x: Any, n: int, rng: Any) -> Any:
        draws = super().sample(x, n, rng)
        return 0.5 * (draws + draws.mean(axis=1, keepdims=True))


class Chained(Exact):
    """As good as exact, but said to be a Markov chain."""

    autocorrelated = True


def run(simulator: Any, estimator: Any, out: Path, plan: Plan = PLAN, **options: Any) -> Audit:
    return audit(estimator, simulator, trials=vars(plan), out=out, policy=DEFAULT, anytime=True, **options)


def test_a_broken_estimator_is_blocked_after_a_few_chunks_and_judged_again_without_sampling(
    simulator: Any, tmp_path: Path
) -> None:
    result = run(simulator, Narrow(simulator), tmp_path)
    assert result.verdict.outcome is Outcome.FAIL
    used = result.trials.sizes["trial"]
    assert used <= 200
    assert {gate.n_trials for gate in result.verdict.gates if gate.id.startswith("anytime")} == {used}
    record = json.loads((tmp_path / "verdict.json").read_text())
    assert record["provenance"]["trials"] | {"anytime": True, "used": used} == record["provenance"]["trials"]
    assert any(item["id"] == "coverage.central" for item in record["not_checked"])
    said = f"stopped after {used} of at most 4,000"
    assert said in (tmp_path / "summary.md").read_text()
    assert said in (tmp_path / "report.html").read_text()
    again = judge(tmp_path, DEFAULT)
    assert again.verdict.gates == result.verdict.gates
    lenient = DEFAULT.model_copy(
        update={
            "tolerance": DEFAULT.tolerance.model_copy(
                update={"log_width": 2.0, "coverage": 0.6, "joint": 0.6}
            )
        }
    )
    assert judge(tmp_path, lenient).verdict.outcome is not Outcome.FAIL


def test_an_exact_estimator_passes_before_the_last_trial(simulator: Any, tmp_path: Path) -> None:
    result = run(simulator, Exact(simulator), tmp_path, validators=["draws"])
    assert result.verdict.outcome is Outcome.PASS
    assert 500 < result.trials.sizes["trial"] < 4000
    assert {gate.id for gate in result.verdict.gates} >= {"anytime.coverage", "draws.finite"}


def test_trials_run_out(simulator: Any, tmp_path: Path) -> None:
    result = run(simulator, Exact(simulator), tmp_path, replace(PLAN, number=100))
    assert result.verdict.outcome is Outcome.INCONCLUSIVE
    assert result.trials.sizes["trial"] == 100
    assert "none was left after 100" in (tmp_path / "summary.md").read_text()


def test_an_interrupted_audit_ends_in_the_same_bits(simulator: Any, tmp_path: Path) -> None:
    plan = replace(PLAN, block=8)
    whole = run(simulator, Narrow(simulator), tmp_path / "whole", plan)
    work = tmp_path / "parts" / ".chunks" / fingerprint(simulator, Narrow(simulator), plan)
    collect(simulator, Narrow(simulator), plan, work.parent, watch=Watch(DEFAULT, plan.seed))
    (work / "trials-00000008.nc").unlink()
    parts = run(simulator, Narrow(simulator), tmp_path / "parts", plan)
    assert np.array_equal(whole.trials["draws"], parts.trials["draws"])
    assert whole.verdict.to_json()["gates"] == parts.verdict.to_json()["gates"]


def test_a_draw_that_is_no_number_stops_at_once(simulator: Any, tmp_path: Path) -> None:
    class Sometimes(Exact):
        def sample(self, x: Any, n: int, rng: Any) -> Any:
            draws = np.array(super().sample(x, n, rng))
            draws[0, 0] = np.nan
            return draws

    result = run(simulator, Sometimes(simulator), tmp_path)
    assert result.verdict.outcome is Outcome.FAIL
    assert result.trials.sizes["trial"] == PLAN.block


def test_what_the_watch_saw_is_what_the_verdict_says(simulator: Any, tmp_path: Path) -> None:
    """Also where draws are thinned together: a stop is always a verdict."""
    result = run(simulator, Chained(simulator), tmp_path, validators=["draws"])
    assert result.verdict.outcome is not Outcome.INCONCLUSIVE
    assert result.trials.sizes["trial"] < 4000


def test_audits_of_a_fixed_number_never_run_it(simulator: Any, tmp_path: Path) -> None:
    plan = replace(PLAN, number=100)
    result = audit(Exact(simulator), simulator, trials=vars(plan), out=tmp_path, policy=DEFAULT)
    assert not any(finding.kind == "sequence" for finding in result.findings)
    assert "anytime" not in result.verdict.provenance["trials"]


def test_the_configuration_and_the_choice_of_validators() -> None:
    assert not AuditConfig().trials.anytime
    assert AuditConfig.build({"trials": {"anytime": True}}).trials.anytime
    assert watched(["sbc", "draws"]) == ("sbc", "draws", "anytime")
    assert set(watched(None)) >= {"sbc", "coverage", "draws", "anytime"}


def block(trials: int, *, width: float = 1.0, seed: int = 1) -> Any:
    """Trials of one parameter, of which draws are `width` times as wide as they should be."""
    rng = np.random.default_rng(seed)
    return make_trials(rng.normal(size=(trials, 1)), width * rng.normal(size=(trials, 60, 1)), ["a"])


def test_what_a_watch_says_block_by_block() -> None:
    """Nothing yet, then that it FAILs or PASSes; a draw that is no number at once; in between it rests."""
    lenient = make_policy(
        {"required": ["sbc"], "tolerance": {"bias": 0.5, "log_width": 0.5, "coverage": 0.4}}, source="test"
    )
    for width, number in ((0.4, 400), (1.0, 1500)):
        watch = Watch(lenient if width == 1 else DEFAULT, 1)
        assert watch.see(block(20, width=width)) is False
        # Not a twentieth more: whatever it holds, nobody looks.
        assert watch.see(block(1, width=width, seed=2)) is False
        assert watch.see(block(number, width=width, seed=3)) is True
    watch = Watch(DEFAULT, 1)
    assert watch.confirm(block(20)) is False
    assert watch.confirm(block(400, width=0.4)) is True
    broken = block(20)
    broken["draws"][3, 2, 0] = np.nan
    assert watch.see(broken) is True
    assert Watch(DEFAULT, 1).confirm(broken) is True


def test_a_watch_looks_again_after_a_twentieth_more() -> None:
    class Counting(Watch):
        looks = 0

        def _settled(self, sequences: Any) -> bool:
            self.looks += 1
            return super()._settled(sequences)

    watch, looked = Counting(DEFAULT, 1), []
    for seed, number in enumerate((100, 4, 1, 5, 1)):
        before = watch.looks
        assert watch.see(block(number, seed=seed)) is False
        looked.append(watch.looks > before)
    # At 100, 105 and 111 trials.
    assert looked == [True, False, True, False, True]


def test_a_watch_does_not_stop_before_challengers_are_settled() -> None:
    """The prior, which all that is seen block by block PASSes; asked again after a fifth more trials."""
    rng = np.random.default_rng(2)
    theta = rng.normal(size=(3000, 1))
    x = np.column_stack([rng.normal(size=(3000, 5)), theta + 0.4 * rng.normal(size=(3000, 1)) ** 3])
    x[:, 0] -= x[:, 1:].sum(axis=1)  # and their total says nothing
    trials = make_trials(theta, rng.normal(size=(3000, 60, 1)), ["a"], x=x)
    watch, settled = Watch(DEFAULT, 1), []
    for stop in range(100, 3001, 100):
        if watch.see(trials.isel(trial=slice(stop - 100, stop))):
            settled.append((stop, watch.confirm(trials.isel(trial=slice(0, stop)))))
            if settled[-1][1]:
                break
    assert settled[-1][1]
    findings, not_checked = run_validators(
        trials.isel(trial=slice(0, settled[-1][0])), seed=1, select=WATCHED
    )
    gates = {gate.id: gate.outcome for gate in judged(findings, not_checked, DEFAULT, seed=1).gates}
    assert gates.pop("anytime.informed") is Outcome.FAIL
    assert Outcome.FAIL not in gates.values()
    wide = {"bias": 0.5, "log_width": 0.5, "coverage": 0.4, "joint": 0.4}
    watch = Watch(make_policy({"required": ["informed.rank"], "tolerance": wide}, source="test"), 1)
    assert watch.see(trials.isel(trial=slice(0, 700))) is True
    assert watch.confirm(trials.isel(trial=slice(0, 40))) is False
    assert watch.see(trials.isel(trial=slice(700, 701))) is True
    watch.confirm(trials.isel(trial=slice(0, 701)))
    assert watch.see(trials.isel(trial=slice(701, 840))) is False  # of 841.2
    assert watch.see(trials.isel(trial=slice(840, 842))) is True
