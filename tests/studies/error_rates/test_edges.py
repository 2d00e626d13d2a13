"""Trials lie on the edges where they should, and are rarely judged wrongly: twin of the part `edge-gates`."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from studies.error_rates import edges
from studies.error_rates.audits import audited
from studies.error_rates.boundary import kink
from studies.error_rates.edges import LEVELS, SHAPED, TAILS, TAILS_DRAWS, cases, held, replicate
from studies.error_rates.policies import DEFAULT
from studies.error_rates.shortcut import Case, faulty, middle

from gaugeblock.validate import Outcome, make_trials, run_validators

EDGE = DEFAULT.tolerance


def ranks_below(truth, draws):
    """How many draws of its trial each truth exceeds, and a random place among those it equals."""
    rng = np.random.default_rng(3)
    below, equal = ((op(draws, truth[:, None])).sum(axis=1) for op in (np.less, np.equal))
    return (below + rng.random(below.shape) * (1 + equal)) / (draws.shape[1] + 1)


@pytest.mark.parametrize("shape", SHAPED)
def test_worst_central_intervals_of_narrow_posteriors_are_short_by_what_is_tolerated(shape):
    """Ranks of 80,000 truths (tails: 40,000) counted by hand: 5 binomial sd of the worst of the levels."""
    for levels, tolerated, draws, number in (
        (LEVELS, EDGE.coverage, 100, 80_000),
        (TAILS, EDGE.tails, TAILS_DRAWS, 40_000),
    ):
        case = Case(
            shape=shape,
            log_width=edges.log_width(shape, levels, tolerated, draws=draws),
            draws=draws,
            trials=20_000,
        )
        u = np.concatenate(
            [ranks_below(*faulty(case, np.random.default_rng(k))) for k in range(number // 20_000)]
        )
        gap = np.array([np.mean(np.abs(u - 0.5) <= level / 2) - level for level in levels])
        assert gap[np.abs(gap).argmax()] == pytest.approx(
            -tolerated, abs=5 * np.sqrt(0.25 if draws == 100 else 0.015) / np.sqrt(number)
        )


def test_shares_held_are_binomial():
    """Of an exact posterior the level, and of a kinked one what `kink` found for it."""
    u = (np.arange(40_000) + 0.5) / 40_000
    np.testing.assert_allclose(held(u, (0.5, 0.8, 0.95), 60), [0.5, 0.8, 0.95], atol=1e-4)
    level = np.abs(2 * u - 1)
    before = 1 - kink(0.05, draws=60).inverse(1 - level)
    share = 0.5 + 0.5 * np.sign(u - 0.5) * before
    assert held(share, (0.5,), 60)[0] == pytest.approx(0.45, abs=1e-3)


@pytest.mark.parametrize("shape", SHAPED)
def test_a_fifth_of_the_trials_is_off_by_what_is_tolerated_of_a_fifth_and_no_more_for_any_score(shape):
    """0.21 of a twentieth is 0.105 of a fifth; 40,000 truths' ranks, 5 binomial sd; the others are exact.

    A score orders the parameter's own quantiles: the best takes the twentieths where truths are rarest first.
    """
    trials = [edges.local(shape).trials(np.random.default_rng(seed)) for seed in range(10)]
    x = np.concatenate([each["x"].values[:, 0] for each in trials])
    u = np.concatenate(
        [ranks_below(each["theta_true"].values, each["draws"].values)[:, 0] for each in trials]
    )
    assert x.mean() == pytest.approx(0.2, abs=5 * 0.4 / 200)
    checks = {
        value: [u[x == value] <= 0.5, *(np.abs(u[x == value] - 0.5) <= at / 2 for at in (0.8, 0.95))]
        for value in (0, 1)
    }
    gaps = {
        value: [np.mean(one) - at for one, at in zip(each, (0.5, 0.8, 0.95), strict=True)]
        for value, each in checks.items()
    }
    assert {each["draws"].shape for each in trials} == {(4000, 50, 1)}
    # Truths lie above the median too often.
    assert gaps[1][0] == -np.abs(gaps[1]).max()
    assert np.abs(gaps[1]).max() == pytest.approx(0.105, abs=5 * 0.5 / np.sqrt((x == 1).sum()))
    assert np.abs(gaps[0]).max() < 5 * 0.5 / np.sqrt((x == 0).sum())
    rarest = np.sort(np.histogram(u[x == 1], 20, (0, 1))[0]) / (x == 1).sum()
    best = np.array([level - rarest[: round(20 * level)].sum() for level in (0.2, 0.5, 0.8)])
    assert best.max() < 0.105 + 5 * 0.5 / np.sqrt((x == 1).sum())
    assert best.argmax() == 1


def test_both_truths_are_the_same_as_often_as_puts_the_worst_projection_or_product_on_its_edge():
    """Mean of 60 audits of 1,000 trials: 5 errors."""
    edge = edges.joint("normal")
    found = []
    for seed in range(60):
        findings, _ = run_validators(edge.trials(np.random.default_rng(seed)), seed=seed, select=["joint"])
        found.append(next(one.estimate for one in findings if one.id == "joint.projections"))
    assert np.abs(np.mean(found, axis=0)).max() == pytest.approx(EDGE.joint, abs=5 * 0.5 / np.sqrt(60_000))


@pytest.mark.parametrize("shape", edges.LOG_DENSITY)
def test_log_densities_are_those_of_the_draws_less_what_is_tolerated(shape):
    trials = edges.normalisation(shape).trials(np.random.default_rng(1))
    draws, log_q = trials["draws"].values[..., 0].ravel(), trials["log_q"].values.ravel()
    centre, unit = middle(shape)
    near = np.abs(draws - centre) < unit
    # Mass near the middle, by the trapezoid rule over the draws in order; 5 binomial sd.
    order = np.argsort(draws[near])
    mass = np.trapezoid(np.exp(log_q[near][order] + EDGE.normalisation), draws[near][order])
    assert mass == pytest.approx(near.mean(), abs=5 * 0.5 / np.sqrt(len(draws)) + 1e-3)


@pytest.mark.parametrize("stated", edges.STATED)
def test_the_highest_fifth_of_stated_probabilities_is_too_high_by_what_is_tolerated(stated):
    """The others are right; 5 binomial sd of 100,000 trials."""
    trials = [edges.models(stated).trials(np.random.default_rng(seed)) for seed in range(20)]
    first = np.concatenate([each["model_probability"].values[:, 0] for each in trials])
    true = np.concatenate([each["theta_true"].values[:, 0] for each in trials]) == 0
    high, low = np.quantile(first, [0.8, 0.77])
    for part, gap in ((first >= high, -EDGE.models), (first < low, 0.0)):
        error = np.sqrt(np.mean(first[part] * (1 - first[part])) / part.sum())
        assert np.mean(true[part] - first[part]) == pytest.approx(gap, abs=5 * error)


@pytest.mark.parametrize("name", ["coverage, Cauchy", "normalisation, bimodal", "models, rare"])
def test_on_the_edge_of_one_gate_both_verdicts_are_rare(name):
    """Of 40 audits: 0.999 binomial quantile of 5%; and a cell asks for one gate that can be judged."""
    edge = cases()[name]()
    said = [replicate(lambda: edge)(seed) for seed in range(40)]
    most = stats.binom.ppf(0.999, 40, 0.05)
    assert max(sum(one[verdict] for one in said) for verdict in ("FAIL", "PASS")) <= most


@pytest.mark.parametrize("name", ["tails, bounded U", "local, Cauchy", "normalisation, normal"])
def test_whole_audits_have_no_other_gate_to_fail_by(name, monkeypatch):
    """By every validator that can look at such trials, and the one gate says what it says alone."""
    edge, audits = cases()[name](), []

    def kept(*given, **more):
        audits.append(audited(*given, **more))
        return audits[-1]

    monkeypatch.setattr(edges, "audited", kept)
    whole, alone = replicate(lambda: edge, whole=True)(3), replicate(lambda: edge)(3)
    every, one = ({gate.id: gate for gate in audit.verdict.gates} for audit in audits)
    assert {"sbc.bias[theta_1]", "joint.tarp", *one} < set(every)
    failed = {gate.id.partition("[")[0] for gate in every.values() if gate.outcome is Outcome.FAIL}
    assert failed <= set(edge.policy.required)
    assert {thing for thing in whole if thing.startswith("fail: ")} == {f"fail: {gate}" for gate in failed}
    looked_at = [gate for gate in one if gate.startswith(edge.policy.required)]
    assert [every[gate].statistic for gate in looked_at] == [one[gate].statistic for gate in looked_at] != []
    assert set(alone) <= set(whole)


def test_a_pass_where_the_region_was_not_learned_is_not_counted(monkeypatch):
    edge = edges.local("normal")
    monkeypatch.setattr(edges, "audited", lambda *_, **__: found("total > 0"))
    assert replicate(lambda: edge)(1) == {**PASSED, edges.LEARNED: 1.0}
    monkeypatch.setattr(edges, "audited", lambda *_, **__: found("total > 0 and something"))
    assert replicate(lambda: edge)(1) == {**PASSED, "PASS": 0.0, edges.LEARNED: 0.0}


PASSED = {"PASS": 1.0, "FAIL": 0.0, "INCONCLUSIVE": 0.0, edges.ANY: 1.0}


def found(region):
    """An audit that PASSed, with findings of this region alone."""
    finding = SimpleNamespace(details=xr.Dataset({"region": ("region", [region])}))
    return SimpleNamespace(findings=[finding], verdict=SimpleNamespace(outcome=Outcome.PASS, gates=()))


@pytest.mark.parametrize("name", ["coverage", "tails", "joint", "local", "normalisation", "models"])
def test_what_is_exact_can_pass_at_the_size_of_each_edge(name):
    """Else a PASS on the edge would be rare for a reason of no interest: one of 20 audits at least does."""
    assert any(replicate(lambda: exact(name))(seed)["PASS"] for seed in range(20))


def exact(name):
    """The case of an edge with truths that are exact."""
    edge = {case.partition(",")[0]: built for case, built in reversed(cases().items())}[name]()

    def trials(rng):
        made = edge.trials(rng)
        if name == "models":
            first = made["model_probability"].values[:, 0]
            return made.assign(
                theta_true=(made["theta_true"].dims, 1.0 * (rng.random((len(first), 1)) >= first[:, None]))
            )
        if name == "normalisation":
            return made.assign(log_q=made["log_q"] + EDGE.normalisation)
        # A draw in its place: of an exact posterior the truth is one.
        draws = made["draws"].isel(draw=slice(1, None)).values
        x = {"x": made["x"].values} if "x" in made else {}
        return make_trials(made["draws"].values[:, 0], draws, **x)

    return edges.Edge(edge.policy, edge.select, trials)
