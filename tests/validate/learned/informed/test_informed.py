"""The gate on whole trials: blind estimators FAIL, exact ones do not, and what is said about them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from studies.informed.problems import BLIND, EXACT

from gaugeblock.core.streams import generator
from gaugeblock.reports.reason import of_the_data, reason
from gaugeblock.reports.terminal import verdict_lines
from gaugeblock.validate import Outcome, judge, make_trials, read_policy, run_validators
from gaugeblock.validate.anytime.betting import mean_bounds
from gaugeblock.validate.findings_file import read_findings, write_findings
from gaugeblock.validate.learned.informed.challenger import Known, fit_challenger
from gaugeblock.validate.learned.informed.data import channels, data_of
from gaugeblock.validate.learned.informed.informed import blame, informed, orders, rank_finding
from gaugeblock.validate.learned.informed.learning import Learned, Told, learn, together
from gaugeblock.validate.learned.informed.pools import pools, pools_of
from gaugeblock.validate.learned.informed.skill import forecast_crps, skill
from gaugeblock.validate.learned.informed.terms import regressed_terms
from gaugeblock.validate.prepared import Prepared

DEFAULT = read_policy("default")


def trials_of(make, n, draws, *, seed, with_data=True, **more):
    made = make(np.random.default_rng(seed), n, draws)
    names = [f"theta_{column + 1}" for column in range(made.theta_true.shape[1])]
    return make_trials(made.theta_true, made.draws, names, x=made.x if with_data else None, **more)


def judged(trials, *, seed=1):
    findings, not_checked = run_validators(trials, seed=seed, select=["informed"])
    verdict = judge(findings, not_checked, DEFAULT, seed=seed)
    return {gate.id: gate for gate in verdict.gates}, {f.id: f for f in findings}, not_checked, verdict


@pytest.mark.parametrize("name", [name for name in BLIND if "0.65" not in name])
def test_blind_estimators_fail(name):
    """At 2,000 trials, half of the default size; each is many standard errors outside."""
    gates, *_ = judged(trials_of(BLIND[name], 2000, 100, seed=1))
    expected = {Outcome.FAIL, Outcome.INCONCLUSIVE} if "4%" in name else {Outcome.FAIL}
    assert gates["informed.rank"].outcome in expected


@pytest.mark.parametrize("name", EXACT)
def test_exact_posteriors_do_not(name):
    """One audit each: beyond 3 standard errors is a false alarm of 0.1%."""
    gates, findings, *_ = judged(trials_of(EXACT[name], 800, 50, seed=2))
    assert gates["informed.rank"].outcome is not Outcome.FAIL
    assert findings["informed.rank"].estimate[0] < 3 * findings["informed.rank"].standard_error[0]


def faulty(fault, rng, n, draws):
    """Three parameters of correlations 0.6, exact but for one fault, a scale or a shift of the draws."""
    x = rng.normal(size=(n, 3))
    root = np.linalg.cholesky(0.6 + 0.4 * np.eye(3))
    z = rng.normal(size=(n, 1 + draws, 3))
    away = np.concatenate([z[:, :1] @ root.T, fault(z[:, 1:] @ root.T, x[:, None])], axis=1)
    return make_trials(x + away[:, 0], x[:, None] + away[:, 1:], ["a", "b", "c"], x=x)


SAME = {
    "narrow": lambda away, x: 0.905 * away,
    "wide": lambda away, x: 1.105 * away,
    "shifted": lambda away, x: away + 0.1,
    # 0.6 becomes 0.46.
    "correlations": lambda away, x: away + 0.25 * (away - away.mean(axis=-1, keepdims=True)),
}


@pytest.mark.parametrize("name", SAME)
def test_a_fault_that_is_the_same_whatever_the_data_is_left_to_other_gates(name):
    """At what the default policy tolerates of it, or near: within 3 standard errors of 0, 3,000 trials."""
    rank = judged(faulty(SAME[name], np.random.default_rng(20), 3000, 100))[1]["informed.rank"]
    assert abs(rank.estimate[0]) < 3 * rank.standard_error[0]


@pytest.mark.parametrize("ends", [1, 2])
def test_the_same_fault_where_some_data_have_it_is_not(ends):
    """Narrow at one end of the data, and at both."""
    beyond = {1: lambda x: x[..., :1] > 0.5, 2: lambda x: x[..., :1] ** 2 > 1.5}[ends]
    made = faulty(lambda away, x: np.where(beyond(x), 0.6, 1.0) * away, np.random.default_rng(21), 1500, 60)
    gates, found, *_ = judged(made)
    assert gates["informed.rank"].outcome is Outcome.FAIL
    assert found["informed.rank"].components[0].startswith("how wide ")


@pytest.mark.parametrize("exact", [False, True])
def test_a_shape_that_the_data_tell(exact):
    """A gamma of variance 1, skewed to either side with the sign of x[1]; normal draws of its mean and sd."""
    rng = np.random.default_rng(22)
    x = rng.normal(size=(3000, 4))
    skewed = np.sign(x[:, None, 1]) * (rng.gamma(4.0, 1.0, (3000, 61)) / 2 - 2)
    draws = skewed[:, 1:] if exact else rng.normal(size=(3000, 60))
    made = make_trials(x[:, :1] + skewed[:, :1], (x[:, :1] + draws)[:, :, None], ["a"], x=x)
    gates, found, *_ = judged(made)
    if exact:
        assert abs(found["informed.rank"].estimate[0]) < 3 * found["informed.rank"].standard_error[0]
    else:
        assert gates["informed.rank"].outcome is Outcome.FAIL
        assert found["informed.rank"].components == ("the shape of a, by a ridge regression on x[1]",)


def test_the_data_that_tell_are_named():
    gates, findings, *_ = judged(trials_of(BLIND["prior, 40 nuisance channels"], 1000, 50, seed=3))
    message = gates["informed.rank"].message
    assert message.startswith("where theta_1 lies, by a ridge regression on x[40]")
    assert "CRPS skill over the prior: theta_1 -0.0" in message or "theta_1 0.0" in message
    details = findings["informed.rank"].details
    assert details["challenger_skill"].sel(parameter="theta_1") > 0.65
    assert abs(details["challenger_skill"].sel(parameter="theta_2")) < 0.05


def test_beside_a_pass_stands_how_much_is_learned():
    trials = trials_of(EXACT["40 nuisance channels"], 4000, 50, seed=4)
    gates, findings, _, verdict = judged(trials)
    gate = gates["informed.rank"]
    assert gate.outcome is Outcome.PASS
    assert "no challenger of ridge regressions and boosted trees does better" in gate.message
    # Two orders of learning, each its own.
    assert len(set(findings["informed.rank"].details["gap"].values.tolist())) == 2
    assert "CRPS skill over the prior: theta_1 0.7" in gate.message
    assert of_the_data(verdict) in verdict_lines(verdict, shown=5)[1]
    # A normal posterior of sd 0.287 in a standard normal prior: 1.25 nats.
    skill = findings["informed.crps[theta_1]"]
    assert skill.estimate[1] == pytest.approx(-np.log(np.sqrt(1 / (1 + 1 / 0.09))), abs=0.03)
    assert np.abs(findings["informed.crps[theta_2]"].estimate).max() < 0.02


def test_without_data_nothing_is_required_and_it_is_said(tmp_path):
    trials = trials_of(EXACT["Cauchy"], 300, 50, seed=5, with_data=False)
    gates, findings, not_checked, verdict = judged(trials)
    assert "informed.rank" not in gates
    assert "informed.crps[theta_1]" in findings
    said = "hether it uses the data could not be checked: the trials hold none."
    # Other gates are required and were not computed.
    assert verdict.outcome is Outcome.INCONCLUSIVE
    assert of_the_data(verdict) == f"W{said}"
    # As stored, and judged again; "calibrated" is what a PASS alone says.
    write_findings(list(findings.values()), not_checked, tmp_path / "findings.nc")
    again = judge(*read_findings(tmp_path / "findings.nc"), only("informed.rank"), seed=1)
    assert "informed.rank" not in {gate.id for gate in again.gates}
    for outcome, head in ((Outcome.PASS, "Calibrated; w"), (Outcome.FAIL, "W"), (Outcome.INCONCLUSIVE, "W")):
        shown = replace(again, outcome=outcome)
        assert of_the_data(shown) == f"{head}{said}"
        assert verdict_lines(shown, shown=5)[1] == f"  {head}{said}"
        assert ("Calibrated" in reason(shown)) is (outcome is Outcome.PASS)


def only(*required):
    return DEFAULT.model_copy(update={"required": required})


def test_nats_are_no_more_than_is_lost():
    """The prior for a posterior of sd 0.2 in it loses 1.6 nats; the exact posterior nothing."""
    rng = np.random.default_rng(30)
    theta = rng.normal(size=(1500, 1))
    x = theta + 0.204 * rng.normal(size=(1500, 1))
    lost = -np.log(np.sqrt(1 / (1 + 1 / 0.204**2)))
    for draws, least, most in (
        (rng.normal(size=(1500, 40, 1)), 0.3, lost),
        (0.96 * x[:, None] + 0.2 * rng.normal(size=(1500, 40, 1)), -0.05, 0.0),
    ):
        gates, found, *_ = judged(make_trials(theta, draws, ["a"], x=x))
        details = found["informed.rank"].details
        assert least < float(details["nats"]) < most + 0.01
        assert float(details["nats_low"]) < most
        said = f"in log score it gains {float(details['nats']):+.3f} nats a trial "
        said += f"({float(details['nats_low']):+.3f} to {float(details['nats_high']):+.3f})"
        assert said in gates["informed.rank"].message


def test_too_few_trials_are_no_excuse():
    *_, verdict = judged(trials_of(EXACT["Cauchy"], 40, 20, seed=6))
    gate = next(gate for gate in verdict.gates if gate.id == "informed.rank")
    assert gate.outcome is Outcome.INCONCLUSIVE
    assert "at least 50" in gate.message
    assert "could not be checked" not in reason(verdict).replace("could not be checked:", "")


def odd(kind, rng):
    n, draws = 120, 10
    x = rng.normal(size=(n, 3))
    pool = x[:, None, :2] + rng.normal(size=(n, 1 + draws, 2))
    more = {}
    if kind == "constant parameter":
        pool[:, :, 1] = 4.0
    if kind == "integers":
        pool = np.round(pool)
    if kind == "circular":
        pool[:, :, 0] = np.mod(pool[:, :, 0] * 2, 2 * np.pi)
        more["circular"] = ["a"]
    if kind == "weights":
        more["weight"] = rng.random((n, draws))
    if kind == "constant data":
        x = np.ones((n, 3))
    if kind == "no rank":
        x = x[:, 0]
    if kind == "image":
        x = np.exp(rng.normal(size=(n, 20, 20)) + x[:, :1, None])
    if kind == "twenty parameters":
        pool = rng.normal(size=(n, 1 + draws, 20))
    if kind == "one parameter":
        pool = pool[:, :, :1]
    if kind == "heavy data":
        x = rng.standard_cauchy((n, 3)) ** 3
    names = list("abcdefghijklmnopqrstuvwxyz"[: pool.shape[2]])
    return make_trials(pool[:, 0], pool[:, 1:], names, x=x, **more)


KINDS = (
    *("constant parameter", "integers", "circular", "weights", "constant data", "no rank", "image"),
    *("twenty parameters", "one parameter", "heavy data"),
)


@pytest.mark.parametrize("kind", KINDS)
def test_odd_trials(kind):
    """Ten draws, 120 trials; a number that is finite, and never a FAIL: exact all of them."""
    trials = odd(kind, np.random.default_rng([7, KINDS.index(kind)]))
    findings, not_checked = run_validators(trials, seed=1, select=["informed"])
    rank = next(finding for finding in findings if finding.id == "informed.rank")
    assert np.isfinite(rank.estimate).all()
    assert np.isfinite(rank.influence).all()
    assert abs(rank.estimate[0]) < 4 * rank.standard_error[0]
    assert judge(findings, not_checked, DEFAULT, seed=1).outcome is not Outcome.FAIL
    missing = {item.id for item in not_checked}
    assert missing == {
        "constant parameter": {"informed.crps[b]"},
        "circular": {"informed.crps[a]"},
    }.get(kind, set())


def test_a_circular_parameter_that_is_ignored_shows():
    """The prior of an angle is returned, where its sine and cosine are in the data."""
    rng = np.random.default_rng(8)
    angle = rng.uniform(0, 2 * np.pi, (1000, 1))
    x = np.concatenate([np.cos(angle), np.sin(angle)], axis=1) + 0.2 * rng.normal(size=(1000, 2))
    draws = rng.uniform(0, 2 * np.pi, (1000, 50, 1))
    gates, *_ = judged(make_trials(angle, draws, ["angle"], x=x, circular=["angle"]))
    assert gates["informed.rank"].outcome is Outcome.FAIL
    assert gates["informed.rank"].statistic > 0.2


def test_neither_blocks_nor_the_order_of_trials_matter():
    trials = trials_of(EXACT["bent"], 150, 20, seed=9)
    shuffled = trials.isel(trial=np.random.default_rng(9).permutation(150))
    first, second = (
        {f.id: f for f in run_validators(xr.DataTree(t), seed=3, select=["informed"])[0]}["informed.rank"]
        for t in (trials, shuffled)
    )
    np.testing.assert_array_equal(first.estimate, second.estimate)
    np.testing.assert_array_equal(first.influence[:, shuffled["trial"].values], second.influence)


def test_prepared_trials_are_not_changed():
    """Statistics are shared between validators: whoever looks after this one sees the same."""
    prepared = Prepared(xr.DataTree(trials_of(EXACT["counts"], 100, 20, seed=10)), 1)
    before = [prepared.per_trial(statistic).copy() for statistic in (pools, channels)]
    informed(prepared)
    for statistic, kept in zip((pools, channels), before, strict=True):
        np.testing.assert_array_equal(prepared.per_trial(statistic), kept)


@pytest.mark.parametrize(
    ("linear", "bent", "said"),
    [
        (1, 0, "a ridge regression on x[0]: "),
        (0, 2, "boosted trees on x[1]: "),
        (1, 1, "a ridge regression on total and by boosted trees on x[1]: "),
    ],
)
def test_trees_are_named_beside_a_ridge_where_they_tell_more(linear, bent, said):
    rng = np.random.default_rng(4)
    x = rng.normal(size=(600, 2))
    theta = linear * x[:, :1] + bent * (np.abs(x[:, 1:]) - 0.8) + 0.3 * rng.normal(size=(600, 1))
    prior = rng.choice(theta[:, 0], (600, 20, 1))
    gates, *_ = judged(make_trials(theta, prior, ["a"], x=x))
    assert gates["informed.rank"].message.startswith(f"where a lies, by {said}")


def scored(rng, rows, last=None, told=None):
    n = len(rows)
    return Learned(
        row=np.array(rows), pit=rng.random(n), weight=rng.uniform(0.5, 1.5, n), location=np.zeros((n, 1)),
        spread=np.ones((n, 1)), told=told or {}, last=last, nats=rng.normal(0.2, 0.1, n),
    )  # fmt: skip


def test_a_rank_of_two_orders_by_hand():
    rng = np.random.default_rng(11)
    one, other = scored(rng, [1, 3, 4, 7, 8]), scored(rng, [0, 2, 5, 6, 9])
    found = rank_finding(
        [one, other], np.arange(10), blame="b", skills={"a": (0.5, 0.6), "c": (0.1, 0.2)}, caveats=("said",)
    )
    values = [each.weight * (0.5 - each.pit) for each in (one, other)]
    estimate = (values[0].mean() + values[1].mean()) / 2
    null = np.mean([np.sqrt(np.mean(each.weight**2) / 12 / 5) for each in (one, other)])
    influence = np.zeros(10)
    for each, value in zip((one, other), values, strict=True):
        influence[each.row] += (value - value.mean()) * 2 / 2
    assert found.estimate[0] == pytest.approx(estimate)
    np.testing.assert_allclose(found.influence[0], influence)
    assert found.standard_error[0] == pytest.approx(max(null, influence.std() / np.sqrt(10)))
    assert found.p_value == pytest.approx(stats.norm.sf(estimate / null))
    np.testing.assert_allclose(found.details["gap"], [value.mean() for value in values])
    assert found.details["skill"].values.tolist() == [0.5, 0.1]
    assert found.details["challenger_skill"].values.tolist() == [0.6, 0.2]
    assert found.details["parameter"].values.tolist() == ["a", "c"]
    assert (found.components, found.n_trials, found.sense) == (("b",), 10, "at-most")
    assert found.caveats == (
        "said", "in each of 2 orders of learning: learned on 5 trials and on, ranked in the other 5",
    )  # fmt: skip
    # Nats of the first order, bounded by what a log score of one in 33 can be, or of one in 5.
    assert float(found.details["nats"]) == pytest.approx(one.nats.mean())
    few = rank_finding([one, other], np.arange(10), blame="b", skills={}, candidates=5)
    for each, number in ((found, 33), (few, 5)):
        ends = {"lower": np.log(0.05), "upper": np.log(0.95 * number + 0.05)}
        low, high = mean_bounds(one.nats[None], **ends)
        assert float(each.details["nats_low"]) == pytest.approx(low[0])
        assert float(each.details["nats_high"]) == pytest.approx(high[0])
        assert low[0] < one.nats.mean() < high[0]
    far = one._replace(pit=np.array([0.0, 1.0, 0.0, 1.0, 0.0]))
    wide = rank_finding([far], np.arange(10), blame="", skills={})
    assert wide.standard_error[0] == pytest.approx(wide.influence.std() / np.sqrt(10))


def test_who_is_blamed():
    """The strongest of all; of what stands alone the size counts; trees beside a ridge from four errors."""
    rng = np.random.default_rng(12)
    x = rng.normal(size=(400, 2))
    theta = x[:, :1] + (np.abs(x[:, 1:]) - 0.8) + 0.3 * rng.normal(size=(400, 1))
    trials = make_trials(theta, rng.choice(theta[:, 0], (400, 20, 1)), ["a"], x=x)
    ready = Prepared(xr.DataTree(trials), 1)
    seen = Known(pools_of(ready), data_of(ready, np.arange(400)), pools_of(ready).summaries(), ("a",))
    last = fit_challenger(seen, regressed_terms(1), np.arange(400))
    place, wide = (0,), (0, 0)

    def blamed(**z):
        keys = {"ridge": (place, "ridge"), "trees": (place, "trees"), "alone": (wide, "alone")}
        zero = dict.fromkeys([*keys.values(), (wide, "ridge")], Told(0.0, 1.0))
        several = [
            scored(rng, [0], last, zero | {keys[name]: Told(share * size, 1.0) for name, size in z.items()})
            for share in (0.5, 1.5)
        ]
        told = {key: together([each.told[key] for each in several]) for key in several[0].told}
        return blame(told, last, seen)

    ridge = f"where a lies, by a ridge regression on {last.looked_at(0, seen, trees=False)[0]}"
    trees = "boosted trees on " + " and ".join(last.looked_at(0, seen, trees=True))
    assert blamed(ridge=5.0, trees=3.9, alone=-4.9) == ridge
    assert blamed(ridge=5.0, trees=4.1, alone=-4.9) == f"{ridge} and by {trees}"
    assert blamed(ridge=5.0, trees=4.1, alone=-5.1) == "how wide a is, whatever the data"
    assert blamed(ridge=5.0, trees=5.1) == f"where a lies, by {trees}"
    assert blamed(ridge=-9.0, trees=0.5) == f"where a lies, by {trees}"


def test_the_gate_is_made_of_its_pieces_by_number():
    """Orders of one generator, over trials by their number; skills are of the draws and of the regression."""
    rng = np.random.default_rng(13)
    x = rng.normal(size=(70, 2))
    theta = x + 0.5 * rng.normal(size=(70, 2))
    number = rng.permutation(70)
    made = make_trials(theta, x[:, None] + 0.5 * rng.normal(size=(70, 12, 2)), ["a", "b"], x=x)
    ready = Prepared(xr.DataTree(made.assign_coords(trial=number)), 4)
    found = {one.id: one for one in informed(ready)}
    by_number = np.argsort(number)
    pools_ = pools_of(ready).taken(by_number)
    seen = Known(pools_, data_of(ready, by_number), pools_.summaries(), ("a", "b"))
    lot = generator(4, "order of the challenged", 70)
    learned = [learn(seen, order=lot.permutation(70)) for _ in range(3)]
    numbered = [each._replace(row=by_number[each.row]) for each in learned]
    skills = {}
    for k, name in enumerate("ab"):
        truth, drawn = pools_.values[:, 0, k], pools_.values[:, 1:, k]
        scores, first = skill(truth, drawn), learned[0]
        own = forecast_crps(truth[first.row], first.location[:, k], first.spread[:, k], truth)
        skills[name] = (1 - scores.draws.mean() / scores.prior.mean(),
                        1 - own.mean() / scores.prior[first.row].mean())  # fmt: skip
        one = found[f"informed.crps[{name}]"]
        assert one.estimate[0] == pytest.approx(skills[name][0])
        assert float(one.details["challenger"]) == pytest.approx(skills[name][1])
    told = {key: together([each.told[key] for each in learned]) for key in learned[-1].told}
    said = blame(told, learned[-1].last, seen)
    wanted = rank_finding(numbered, number, blame=said, skills=skills, candidates=13)
    rank = found["informed.rank"]
    np.testing.assert_allclose(rank.estimate, wanted.estimate)
    np.testing.assert_allclose(rank.influence, wanted.influence)
    for name in ("nats", "nats_low", "nats_high"):
        assert float(rank.details[name]) == pytest.approx(float(wanted.details[name]))
    assert rank.components == wanted.components
    np.testing.assert_allclose(rank.details["skill"], wanted.details["skill"])
    np.testing.assert_allclose(rank.details["challenger_skill"], wanted.details["challenger_skill"])
    assert [orders(*size) for size in ((1, 32), (4, 32), (5, 1), (1, 33))] == [3, 3, 2, 2]
