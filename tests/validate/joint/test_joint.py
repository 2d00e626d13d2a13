"""The joint validators on Trials: what they find, what they cannot check, and what only they can see."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from gaugeblock.core.streams import Rows
from gaugeblock.validate import (
    Finding,
    NotChecked,
    judge,
    make_policy,
    make_trials,
    run_validators,
    trials_tree,
)
from gaugeblock.validate.autocorrelation import DrawOrder
from gaugeblock.validate.finding import finding_from
from gaugeblock.validate.joint.hpd import hpd
from gaugeblock.validate.joint.joint import STATISTICS, joint
from gaugeblock.validate.joint.quantities import likelihood_pit, quantities
from gaugeblock.validate.joint.tarp import tarp
from gaugeblock.validate.prepared import Prepared

POLICY = make_policy({"required": ["joint"]}, source="test")


def trials(n, draws, dimensions=2, *, seed=1, ratio=1.0, prior=False, likelihood=False, density=True):
    """theta ~ N(0, 1), x ~ N(theta, 1) with q, a likelihood and a test quantity at truth and draws."""
    extra = {}
    rng = np.random.default_rng(seed)
    theta = rng.normal(size=(n, dimensions))
    x = theta + rng.normal(size=(n, dimensions))
    centre, sd = (0 * x, 1.0) if prior else (x / 2, ratio * np.sqrt(0.5))
    sampled = centre[:, None] + sd * rng.normal(size=(n, draws, dimensions))
    if density:
        extra["log_q"] = stats.norm.logpdf(sampled, centre[:, None], sd).sum(axis=-1)
        extra["log_q_true"] = stats.norm.logpdf(theta, centre, sd).sum(axis=-1)
    if likelihood:
        extra["log_likelihood"] = stats.norm.logpdf(x[:, None], sampled).sum(axis=-1)
        extra["log_likelihood_true"] = stats.norm.logpdf(x, theta).sum(axis=-1)
    made = make_trials(theta, sampled, [f"p{k}" for k in range(dimensions)], x=x, **extra)
    made["quantity_radius"] = (("trial", "draw"), (sampled**2).sum(axis=-1))
    made["quantity_radius_true"] = ("trial", (theta**2).sum(axis=-1))
    return made


def found(tree, seed=3):
    tree = trials_tree(tree) if isinstance(tree, xr.Dataset) else tree
    return {item.id: item for item in joint(Prepared(tree, seed))}


def largest_z(finding):
    return np.abs(finding.estimate / finding.standard_error).max()


def test_everything_that_trials_allow():
    items = found(trials(400, 60, likelihood=True))
    assert list(items) == [
        "joint.likelihood",
        "joint.likelihood_uniform",
        "joint.hpd",
        "joint.hpd_uniform",
        "joint.tarp",
        "joint.tarp_uniform",
        "joint.projections",
        "joint.quantity[radius]",
        "joint.quantity_uniform[radius]",
    ]
    for finding in items.values():
        assert isinstance(finding, Finding)
        assert finding.population == "trials"
        assert finding.caveats == ()
        if finding.kind == "mean":
            assert finding.quantity == "joint"
            assert finding.influence.shape == (len(finding.components), 400)
            assert largest_z(finding) < 4.5
        else:
            assert finding.p_value > 1e-4
        xr.testing.assert_identical(finding_from(finding.to_dataset()).to_dataset(), finding.to_dataset())


def test_what_cannot_be_checked_and_why():
    lean = trials(100, 30, 1, density=False).drop_vars(["x", "quantity_radius", "quantity_radius_true"])
    items = found(lean)
    why = {name: item.why for name, item in items.items() if isinstance(item, NotChecked)}
    assert set(why) == {"joint.likelihood", "joint.hpd", "joint.projections"}
    assert why["joint.likelihood"].endswith("the trials lack log_likelihood, log_likelihood_true")
    assert why["joint.hpd"].endswith("the trials lack log_q, log_q_true")
    assert "one parameter" in why["joint.projections"]
    assert "returns the prior whatever the data" in items["joint.tarp"].caveats[0]
    exposure = found(lean.assign(exposure=("trial", np.linspace(1, 2, 100))))
    assert exposure["joint.tarp"].caveats == items["joint.tarp"].caveats
    assert {type(item) for item in joint(Prepared(trials_tree(trials(1, 30)), 1))} == {NotChecked}


def test_the_group_of_joint_likelihoods_is_used_where_there_is_one():
    main = trials(500, 60)
    group = trials(200, 40, seed=2, ratio=0.5, likelihood=True, density=False)
    broken = group["draws"].values.copy()
    broken[7, 3, 0] = np.nan
    group = group.assign(draws=(("trial", "draw", "parameter"), broken))
    items = found(trials_tree(main, joint=group))
    finding = items["joint.likelihood"]
    assert (finding.population, finding.n_trials) == ("joint", 199)
    assert finding.caveats == ("1 trials have NaN or infinite draws; left out here",)
    assert items["joint.likelihood_uniform"].p_value < 1e-6
    assert items["joint.hpd"].n_trials == 500


def test_the_prior_as_posterior_is_seen_by_what_knows_the_data():
    """Marginal SBC, coverage, HPD and projections pass it; the likelihood and TARP's references do not."""
    tree = trials(1500, 60, prior=True, likelihood=True)
    findings, _ = run_validators(tree, seed=1, select=["sbc", "coverage", "joint"])
    for finding in findings:
        knows = finding.id.split("_")[0] in ("joint.likelihood", "joint.tarp")
        if finding.kind == "test":
            assert (finding.p_value < 1e-9) == knows, finding.id
        else:
            assert (largest_z(finding) > 10) == knows, finding.id
    gates = {gate.id: gate.outcome.value for gate in judge(findings, (), POLICY, seed=1).gates}
    assert gates["joint.likelihood"] == gates["joint.tarp"] == "FAIL"
    assert gates["joint.hpd"] != "FAIL"


@pytest.mark.parametrize("ratio", [0.7, 1.4])
def test_wrong_widths_are_seen_by_all(ratio):
    items = found(trials(1500, 60, ratio=ratio, likelihood=True))
    for name in ("joint.likelihood", "joint.hpd", "joint.tarp", "joint.projections"):
        assert largest_z(items[name]) > 6, name


def test_autocorrelated_draws_are_thinned_everywhere():
    """Each draw four times over: uniform only if quantities and likelihoods are thinned like the draws."""
    single = trials(600, 30, likelihood=True)
    names = [n for n, v in single.data_vars.items() if "draw" in v.dims]
    repeated = single.isel(draw=np.repeat(np.arange(30), 4)).assign_attrs(autocorrelated=1)
    assert set(names) >= {"draws", "quantity_radius", "log_likelihood", "log_q"}
    prepared = Prepared(trials_tree(repeated), 1)
    assert prepared.order.stride > 1
    for item in joint(prepared):
        if item.kind == "test":
            assert item.p_value > 1e-3
        assert "draws depend on their order" in item.caveats[0]


def test_equal_weights_change_nothing():
    plain = trials(300, 30, likelihood=True)
    weighted = plain.assign(weight=(("trial", "draw"), np.full((300, 30), 2.0)))
    first, second = found(plain), found(weighted)
    for name, item in first.items():
        np.testing.assert_allclose(item.estimate, second[name].estimate, atol=1e-9)


def test_blocks_do_not_matter(monkeypatch):
    tree = trials_tree(trials(150, 20, likelihood=True))
    whole = Prepared(tree, 1)
    whole.compute(STATISTICS)
    monkeypatch.setattr("gaugeblock.validate.storage.VALUES", 300)
    pieces = Prepared(tree, 1)
    pieces.compute(STATISTICS)
    for statistic in STATISTICS:
        np.testing.assert_array_equal(whole.per_trial(statistic), pieces.per_trial(statistic))


def test_nan_in_quantities_and_densities_is_said():
    made = trials(200, 20)
    radius, log_q = made["quantity_radius"].values.copy(), made["log_q_true"].values.copy()
    radius[3, 4], log_q[5], log_q[6] = np.nan, np.nan, -np.inf
    items = found(made.assign(quantity_radius=(("trial", "draw"), radius), log_q_true=("trial", log_q)))
    assert "radius is NaN somewhere in 1 trial(s)" in items["joint.quantity[radius]"].caveats[0]
    assert [text[:8] for text in items["joint.hpd"].caveats] == ["1 truth(", "1 truth("]


def test_the_group_is_weighted_and_thinned_with_its_own_random_numbers():
    main, group = trials(80, 48), trials(60, 48, seed=2, likelihood=True, density=False)
    rng = np.random.default_rng(4)
    number = rng.permutation(60) + 500
    weight = rng.exponential(size=(60, 48))
    group = group.assign(weight=(("trial", "draw"), weight)).assign_coords(trial=number)
    group["draws"][9, 3, 0] = np.inf
    prepared = Prepared(trials_tree(main, joint=group), 3)
    vars(prepared)["order"] = DrawOrder(3, 80.0)
    items = {item.id: item for item in joint(prepared)}
    kept = np.delete(np.arange(60), 9)
    wanted = likelihood_pit(
        group["log_likelihood_true"].values[kept],
        prepared.thinned(group["log_likelihood"].values[kept], number[kept]),
        Rows(3, "joint likelihood", number[kept]),
        weight=prepared.thinned(weight[kept], number[kept]),
    )[:, 0]
    uniform = items["joint.likelihood_uniform"]
    np.testing.assert_array_equal(uniform.details["pit"], wanted)
    assert uniform.details["trial"].values.tolist() == number[kept].tolist()
    assert uniform.population == "joint"
    assert items["joint.likelihood"].estimate[5] == pytest.approx(np.mean(abs(wanted - 0.5) <= 0.25) - 0.5)
    for few, said in ((2, 2), (1, None)):
        less = group.isel(trial=[9, *range(few)])
        item = found(trials_tree(main, joint=less))["joint.likelihood"]
        if said is None:
            assert item.why == "1 joint trial(s) with finite draws; at least 2 are needed"
        else:
            assert item.n_trials == said
    lean = found(trials_tree(main, joint=group.drop_vars("log_likelihood_true")))["joint.likelihood"]
    assert lean.why.endswith("the trials lack log_likelihood_true")


def test_findings_are_of_the_unaffected_trials_in_their_order():
    made = trials(90, 40, likelihood=True).assign_coords(trial=np.random.default_rng(5).permutation(90))
    made["draws"][4, 0, 1] = np.nan
    prepared = Prepared(trials_tree(made), 3)
    items = {item.id: item for item in joint(prepared)}
    kept = np.delete(np.arange(90), 4)
    for name in ("likelihood_uniform", "hpd_uniform", "tarp_uniform", "quantity_uniform[radius]"):
        item = items[f"joint.{name}"]
        assert item.details["trial"].values.tolist() == made["trial"].values[kept].tolist()
        assert item.caveats == ("1 of 90 trials have NaN or infinite draws; left out here",)
    for name, statistic in (("hpd", hpd), ("tarp", tarp)):
        pit = items[f"joint.{name}_uniform"].details["pit"]
        np.testing.assert_array_equal(pit, prepared.per_trial(statistic)[:, 0])
    radius = prepared.per_trial(quantities)[:, 0, 0]
    np.testing.assert_array_equal(items["joint.quantity_uniform[radius]"].details["pit"], radius)
    gap = items["joint.quantity[radius]"].estimate
    assert gap[5] == pytest.approx(np.mean(abs(radius - 0.5) <= 0.25) - 0.5)
