"""A simulator with an effect is a simulator: every estimator and every validator takes it as it is."""

import json

import numpy as np
import pytest

from gaugeblock.auditing.collect import collect
from gaugeblock.auditing.samples import Plan
from gaugeblock.diagnosis import Diagnosis
from gaugeblock.estimators import ESTIMATORS, build_estimator
from gaugeblock.estimators.exact import Exact
from gaugeblock.simulators import build_simulator
from gaugeblock.validate import judge, run_validators
from gaugeblock.validate.policy import make_policy
from gaugeblock.validate.validators import default_validators

NOTHING = Diagnosis(
    named="shift", text="by nothing", repair=({"function": "moved", "by": [0.0], "in_widths": False},)
)
OPTIONS = {
    "exact": {},
    "conformal": {"base": {"name": "exact"}, "seed": 5, "draws": 60},
    "importance_refined": {"base": {"name": "exact"}},
    "nested_sampling": {"live_points": 50, "min_effective_draws": 50},
    "nuts": {"warmup": 60, "parallel": 4},
    "npe": {},
    "broken": {"fault": "narrow"},
    "repaired": {"base": {"name": "exact"}, "diagnosis": NOTHING},
}
NEEDS = {"nested_sampling": "ultranest", "nuts": "numpyro", "npe": "sbi"}
GATES = {"sbc.bias", "sbc.log_width", "coverage.central"}
POLICY = make_policy(
    {
        "required": ["draws.finite", *sorted(GATES)],
        "tolerance": {"bias": 0.4, "log_width": 0.3, "coverage": 0.15},
    },
    source="test",
)


def plan(number, draws=20):
    return Plan(
        number=number, draws=draws, block=min(number, 10), importance_number=min(number, 10),
        importance_draws=60, joint_number=min(number, 100), joint_draws=10, seed=3,
    )  # fmt: skip


def test_the_table_covers_the_registry():
    # A stranger is a file of somebody's, made for one simulator: tests/stranger.
    assert set(OPTIONS) == set(ESTIMATORS) - {"stranger"}


@pytest.fixture(scope="module")
def hardly_trained(bent, tmp_path_factory):
    from gaugeblock.estimators.npe import TrainingConfig, train

    folder = tmp_path_factory.mktemp("flow")
    config = TrainingConfig.build(
        {
            "simulator": {"name": "linear_gaussian"},
            "network": {"embedding": [8], "embedding_output": 4, "transforms": 1, "hidden": [8], "bins": 4},
            "training": {"simulations": 500, "steps": 20, "batch": 100},
        }
    )
    train(bent, config, folder=folder)
    return str(folder)


@pytest.mark.parametrize("name", sorted(OPTIONS))
def test_an_estimator_runs_and_is_validated(name, bent, tmp_path, request):
    options = dict(OPTIONS[name])
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    if name == "npe":
        options["path"] = request.getfixturevalue("hardly_trained")
    # As few as all validators take, and one batch of parallel chains, so that one is compiled.
    trials = collect(bent, build_estimator(name, bent, **options), plan(4), tmp_path)
    assert trials["draws"].shape == (4, 20, 3)
    assert list(trials["parameter"].values) == ["level", "slope", "bend_1.amplitude"]
    assert np.isfinite(trials["draws"].values).all()
    findings, _ = run_validators(trials, seed=1)
    assert {finding.id.partition("[")[0] for finding in findings} >= GATES


@pytest.fixture(scope="module")
def audited(bent, tmp_path_factory):
    """What the default validators say of the exact estimator, and of one that does not know the effect."""

    class Unaware:
        """The exact posterior of the line without its bend, and the prior of the bend."""

        def __init__(self, line):
            self._line = line

        def sample(self, x, n, rng):
            known = self._line.posterior_sample(x, n, rng)
            return np.concatenate([known, rng.standard_normal((len(x), n, 1))], axis=-1)

    def judged(estimator, validators=None):
        trials = collect(bent, estimator, plan(400, draws=40), tmp_path_factory.mktemp("trials"))
        findings, not_checked = run_validators(trials, seed=1, select=validators)
        return findings, not_checked, judge(findings, not_checked, POLICY, seed=1)

    from .conftest import Linear

    return judged(Exact(bent)), judged(Unaware(Linear()), ("draws", "sbc", "coverage"))


def test_the_exact_posterior_passes(audited):
    findings, not_checked, verdict = audited[0]
    assert verdict.outcome.name == "PASS", json.dumps([gate.message for gate in verdict.gates], indent=1)
    said = {finding.id.partition(".")[0] for finding in findings}
    assert said >= {"draws", "sbc", "coverage", "joint", "local", "importance", "conformal"}
    assert said | {item.id.partition(".")[0] for item in not_checked} == set(default_validators())


def test_who_does_not_know_the_effect_fails(audited):
    _, _, verdict = audited[1]
    assert verdict.outcome.name == "FAIL"


def test_nested_sampling_of_an_epidemic_with_an_effect_is_not_blocked(tmp_path):
    pytest.importorskip("ultranest")
    epidemic = build_simulator("epidemic", nodes=17)
    entry = epidemic.effect_library(epidemic.prior.center[None])["imported_cases"]
    simulator = epidemic.with_effect(entry.effect())
    sampler = build_estimator("nested_sampling", simulator, live_points=50, min_effective_draws=50, batch=512)
    trials = collect(simulator, sampler, plan(4), tmp_path)
    findings, not_checked = run_validators(trials, seed=1)
    verdict = judge(findings, not_checked, POLICY, seed=1)
    # Four trials settle nothing; that they are enough to call it broken would be news.
    assert verdict.outcome.name != "FAIL", [gate.message for gate in verdict.gates]
    (bias,) = (finding for finding in findings if finding.id == "sbc.bias[imported_cases_1.rate]")
    assert bias.n_trials == 4
