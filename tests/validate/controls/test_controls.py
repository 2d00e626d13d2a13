"""Controls: exact whatever the draws are, faults of the size that is said, and sizes that are true."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from scipy import stats
from scipy.optimize import brentq

from gaugeblock.validate import judge
from gaugeblock.validate.controls.control_trials import blurred, control_trials, displaced, half_width
from gaugeblock.validate.controls.controls import FIRST, REACH, TOLERATED, controls, region_of, worst
from gaugeblock.validate.controls.ladder import ladder
from gaugeblock.validate.finding import Finding, NotChecked, PValueFinding
from gaugeblock.validate.policy import make_policy, read_policy
from gaugeblock.validate.prepared import Prepared
from gaugeblock.validate.trials import make_trials, trials_tree
from gaugeblock.validate.validators import run_validators

POLICY = read_policy("default")
SHAPES = {
    "gaussian": lambda rng, size: rng.standard_normal(size),
    "cauchy": lambda rng, size: rng.standard_cauchy(size),
    "spike and slab": lambda rng, size: np.where(rng.random(size) < 0.5, 0.0, rng.standard_normal(size)),
    "lognormal": lambda rng, size: np.exp(rng.standard_normal(size)),
    "counts": lambda rng, size: rng.poisson(3.0, size).astype(float),
}


def exact(shape, rng, *, n=1000, draws=100, parameters=1):
    """Truths, draws and data of an exact estimator, whose posteriors have a shape."""
    place = 3 * rng.standard_normal((n, parameters))
    if shape == "counts":
        place = np.round(place)
    noise = SHAPES[shape](rng, (n, draws + 1, parameters))
    x = np.concatenate([place, rng.standard_normal((n, 2))], axis=1)
    return place + noise[:, 0], place[:, None] + noise[:, 1:], x


def prepared(truth, draws, *, seed=1, **more):
    return Prepared(trials_tree(make_trials(truth, draws, **more)), seed)


def verdict_of(truth, draws, x, *, seed, select):
    findings, unchecked = run_validators(
        trials_tree(make_trials(truth, draws, x=x)), seed=seed, select=select
    )
    return judge(findings, unchecked, POLICY, seed=seed)


def block_of(control):
    (block,) = control.blocks()
    return block


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("fault", ["none", "blurred"])
def test_a_control_is_calibrated_however_wrong_the_estimator_is(shape, fault):
    """Kolmogorov-Smirnov at 1e-4 on uniform ranks, where truths lie nowhere near the draws."""
    truth, draws, _ = exact(shape, np.random.default_rng(1), n=3000)
    made = prepared(truth + 50.0, draws)
    control = (
        control_trials(made, "test", blurred(0.7)) if fault == "blurred" else control_trials(made, "test")
    )
    assert stats.kstest(control.pit[:, 0], "uniform").pvalue > 1e-4
    assert stats.kstest(made.pit[:, 0], "uniform").pvalue < 1e-9


def test_autocorrelated_and_weighted_draws_make_calibrated_controls():
    rng = np.random.default_rng(2)
    steps = rng.standard_normal((2000, 120, 1))
    for k in range(1, 120):
        steps[:, k] = 0.9 * steps[:, k - 1] + math.sqrt(1 - 0.81) * steps[:, k]
    # Not said to be autocorrelated: the rank of a draw chosen at random is uniform all the same.
    chains = prepared(np.zeros((2000, 1)), steps)
    assert stats.kstest(control_trials(chains, "test").pit[:, 0], "uniform").pvalue > 1e-4
    weight = rng.exponential(size=(2000, 120))
    weighted = prepared(np.zeros((2000, 1)), rng.standard_normal((2000, 120, 1)), weight=weight)
    assert stats.kstest(control_trials(weighted, "test").pit[:, 0], "uniform").pvalue > 1e-4


def test_draws_with_much_weight_play_the_truth_more_often():
    rng = np.random.default_rng(3)
    draws = np.broadcast_to(np.arange(40.0)[:, None], (500, 40, 1)) + rng.normal(size=(500, 1, 1)) * 1e-3
    weight = np.broadcast_to(np.where(np.arange(40) < 4, 1.0, 1e-9), (500, 40))
    block = block_of(control_trials(prepared(np.zeros((500, 1)), draws, weight=weight), "test"))
    assert block.theta_true.max() < 4
    assert block.weight is None


def test_a_displaced_control_is_off_by_so_many_half_widths_where_it_is_said():
    rng = np.random.default_rng(4)
    truth, draws, _ = exact("gaussian", rng, n=1500, parameters=2)
    made = prepared(truth, draws)
    member = np.arange(1500) < 500
    plain, moved = control_trials(made, "test"), control_trials(made, "test", displaced(0.4 * member))
    before, after = block_of(plain), block_of(moved)
    np.testing.assert_array_equal(before.theta_true, after.theta_true)
    whole = np.concatenate([before.draws, before.theta_true[:, None]], axis=1)
    wanted = np.broadcast_to(0.4 * member[:, None, None] * half_width(whole), before.draws.shape)
    np.testing.assert_allclose(after.draws - before.draws, wanted, atol=1e-12)
    expected = stats.norm.cdf(0.4 * 0.9945 / math.sqrt(2)) - 0.5
    assert 0.5 - moved.pit[member].mean() == pytest.approx(expected, abs=0.03)
    np.testing.assert_allclose(moved.pit[~member], plain.pit[~member])


def test_a_blurred_control_is_wider_and_leaves_the_truth_in_place():
    truth, draws, _ = exact("gaussian", np.random.default_rng(5), n=1500)
    made = prepared(truth, draws)
    plain, control = control_trials(made, "test"), control_trials(made, "test", blurred(0.5))
    assert block_of(plain).theta_true.std() == pytest.approx(block_of(control).theta_true.std(), rel=1e-12)
    assert control.log_wider.mean() == pytest.approx(0.5 * math.log(1.25), abs=0.01)
    # Where posteriors lie is no longer all that the data say.
    centre = np.median(block_of(control).draws, axis=1) - np.median(block_of(plain).draws, axis=1)
    assert centre.std() == pytest.approx(0.5, rel=0.1)


def test_a_control_looks_at_the_data_as_the_audit_does():
    truth, draws, x = exact("gaussian", np.random.default_rng(6), n=300)
    made = prepared(truth, draws, x=x)
    control = control_trials(made, "test", displaced(np.ones(300)))
    np.testing.assert_array_equal(control.features.values, made.features.values)
    assert control.features is made.features
    assert control.order is made.order
    assert control.theta_true is not made.theta_true


def test_passes_over_the_draws_do_not_add_up():
    truth, draws, _ = exact("gaussian", np.random.default_rng(6), n=300)
    made = prepared(truth, draws)
    control = control_trials(made, "test")
    first = control.pit.copy(), block_of(control).theta_true, control.theta_true.copy()
    again = control_trials(made, "test")
    list(again.blocks())
    np.testing.assert_array_equal(again.pit, first[0])
    np.testing.assert_array_equal(again.theta_true, first[2])
    np.testing.assert_allclose(again.theta_true, first[1])
    assert not np.array_equal(control_trials(made, "other").pit, first[0])


def test_circular_parameters_stay_relative_to_where_they_were_cut():
    rng = np.random.default_rng(7)
    truth = rng.uniform(0, 360, (400, 1))
    draws = (truth[:, None] + 20 * rng.standard_normal((400, 60, 1))) % 360
    trials = make_trials(np.radians(truth), np.radians(draws), ["angle"], circular=["angle"])
    control = control_trials(Prepared(trials_tree(trials), 1), "test")
    assert stats.kstest(control.pit[:, 0], "uniform").pvalue > 1e-4
    list(control.blocks())
    away = (np.degrees(control.theta_true) - truth + 180) % 360 - 180
    assert np.abs(away).max() < 120


@pytest.mark.parametrize("shape", ["cauchy", "spike and slab", "lognormal"])
def test_the_size_that_is_printed_is_caught(shape):
    """Bias and width of the printed size FAIL in at least 8 of 12 fresh audits (of 90%: all but 4e-3)."""
    rng = np.random.default_rng(8)
    found = verdict_of(*exact(shape, rng, n=600), seed=1, select=["sbc", "controls"]).controls
    sizes = {control.kind: control for control in found if control.kind in ("bias", "width")}
    assert all(control.caught for control in sizes.values())
    counted = np.zeros((2, 2), dtype=int)
    for repeat in range(12):
        sign = 1 if repeat % 2 else -1
        truth, draws, x = exact(shape, rng, n=600)
        middle, unit = np.median(draws, axis=1, keepdims=True), half_width(draws)
        for row, share in enumerate([1.0, 0.5][: 2 if repeat < 4 else 1]):
            wrong = [
                draws + sign * share * sizes["bias"].size * unit,
                middle + (draws - middle) * math.exp(sign * share * sizes["width"].size),
            ]
            for column, gate in enumerate(("sbc.bias[theta_1]", "sbc.log_width[theta_1]")):
                verdict = verdict_of(truth, wrong[column], x, seed=repeat, select=["sbc"])
                counted[row, column] += next(one for one in verdict.gates if one.id == gate).outcome == "FAIL"
    assert counted[0].min() >= 8
    assert counted[1].max() <= 2


def test_what_cannot_be_made_says_why():
    rng = np.random.default_rng(9)
    truth, draws, _ = exact("gaussian", rng, n=600)
    said = controls(prepared(truth, draws))
    assert [item.id for item in said if isinstance(item, NotChecked)] == ["controls.loss"]
    few = controls(prepared(truth[:50], draws[:50]))
    assert isinstance(few[0], NotChecked)
    assert "50 trial(s) of 100 finite draws" in few[0].why
    short = controls(prepared(truth, draws[:, :10]))
    assert isinstance(short[0], NotChecked)
    assert "of 10 finite draws" in short[0].why


def test_draws_without_any_width_break_nothing():
    rng = np.random.default_rng(10)
    truth = rng.standard_normal((600, 1))
    made = prepared(truth, np.repeat(truth[:, None], 40, axis=1), x=rng.standard_normal((600, 3)))
    said = controls(made)
    assert "no trial's draws have a width" in next(item.why for item in said if item.id == "controls.loss")
    reach = {"sbc.bias[theta_1]": 3.0, "sbc.log_width[theta_1]": 3.0, "local.coverage[theta_1]": 3.0}
    found = ladder([item for item in said if isinstance(item, Finding)], reach, POLICY)
    assert {control.kind for control in found if not control.caught} >= {"bias", "width"}
    assert all(math.isfinite(control.size) for control in found)


def test_the_region_is_at_one_end_of_the_feature_that_says_most():
    rng = np.random.default_rng(11)
    truth, draws, x = exact("gaussian", rng, n=2000)
    where, member = region_of(prepared(truth, draws, x=x))
    assert "is at least" in where
    assert member.mean() == pytest.approx(1 / 8, abs=0.01)
    assert abs(truth[member].mean() - truth[~member].mean()) > 2
    where, member = region_of(prepared(truth, draws))
    assert "the location of theta_1" in where
    apart = np.concatenate([x, -x, rng.standard_normal((2000, 4))], axis=1)
    where, _ = region_of(prepared(truth, draws, x=apart))
    assert re.match(r"component \d \(most of it x\[\d\]\) is at", where)
    flat, member = region_of(prepared(np.zeros((400, 1)), np.zeros((400, 30, 1))))
    assert "one of the first 50" in flat
    assert member.sum() == 50


def test_a_policy_moves_what_is_caught():
    """A tolerance wider by 0.1 moves the smallest size by 0.1; power and critical values move it too."""
    truth, draws, _ = exact("gaussian", np.random.default_rng(12))
    said = [item for item in controls(prepared(truth, draws)) if isinstance(item, Finding)]
    wide = make_policy({"tolerance": {"bias": 0.2, "log_width": 0.2}}, source="test")
    sure = make_policy({"planning": {"power": 0.99}}, source="test")
    reach = {"sbc.bias[theta_1]": 3.0, "sbc.log_width[theta_1]": 3.0}

    def sizes(policy, critical=reach):
        return np.array([c.size for c in ladder(said, critical, policy) if c.kind in ("bias", "width")])

    plain = sizes(POLICY)
    np.testing.assert_allclose(sizes(wide) - plain, 0.1, atol=0.015)
    assert (sizes(sure) > plain + 0.01).all()
    assert (sizes(POLICY, dict.fromkeys(reach, 4.0)) > plain + 0.01).all()
    assert len(sizes(POLICY, {})) == 0
    # Of a normal distribution: the sd of a median, over 0.9945 sd in a half-width.
    error = math.sqrt(math.pi / 3 / 1000) / 0.9945 * math.sqrt(1 + 1 / 100)
    assert plain[0] == pytest.approx(0.1 + (3.0 + 1.2816) * error, rel=0.08)
    (bias, *_) = ladder(said, reach, POLICY)
    assert [caught for _, caught in bias.rungs] == [size >= bias.size for size, _ in bias.rungs]
    assert bias.tolerance == 0.1


def test_the_same_seed_gives_the_same_controls_in_any_order():
    truth, draws, x = exact("gaussian", np.random.default_rng(13), n=600)
    order = np.random.default_rng(14).permutation(600)
    trials = make_trials(truth, draws, x=x).assign_coords(trial=np.arange(600))
    there = controls(Prepared(trials_tree(trials), 5))
    back = controls(Prepared(trials_tree(trials.isel(trial=order)), 5))
    for one, other in zip(there, back, strict=True):
        assert one.id == other.id
        np.testing.assert_allclose(one.estimate, other.estimate, atol=1e-9)


def measured(kind, sizes, estimate, error):
    """A control of some sizes that were put in."""
    return PValueFinding(
        id=f"controls.{kind}", quantity="", claim="", null="", reference="", n_trials=1000,
        components=tuple(map(str, sizes)), estimate=np.array(estimate),
        standard_error=np.full(len(sizes), error),
        details=xr.Dataset({"size": ("component", np.array(sizes))}), caveats=("x is {large}",),
    )  # fmt: skip


def test_sizes_in_between_lie_on_a_line_and_a_gap_in_what_is_caught_counts():
    reach = {"local.coverage[a]": 3.0, "informed.rank": 3.0}
    needed = POLICY.tolerance.local + (3.0 + math.sqrt(2) * 1.2815515) * 0.05
    above = [needed - 0.1, needed + 0.1, needed + 0.2]
    (found,) = ladder([measured("region[a]", [1.0, 2.0, 3.0], above, 0.05)], reach, POLICY)
    assert (found.kind, found.parameter, found.caught) == ("region", "a", True)
    assert found.size == pytest.approx(1.5)
    assert found.text == "a bias of 1.5 half-widths where x is {large}"
    assert found.rungs == ((1.0, False), (2.0, True), (3.0, True))
    # What is caught by chance below a size that is not.
    (found,) = ladder([measured("region[a]", [1.0, 2.0, 3.0], above[::-1], 0.05)], reach, POLICY)
    assert (found.caught, found.size) == (False, 3.0)
    (found,) = ladder([measured("region[a]", [1.0, 2.0], [needed + 0.1] * 2, 0.05)], reach, POLICY)
    assert found.size == 1.0
    needed = 0.018 + (3.0 + math.sqrt(2) * 1.2815515) * 0.05
    (found,) = ladder([measured("loss", [0.1, 0.2], [needed - 0.1, needed + 0.1], 0.05)], reach, POLICY)
    assert (found.size, found.caught) == (0.2, True)
    assert found.text == "a loss of information that widens posteriors by 22.14%"
    assert ladder([measured("loss", [0.1], [1.0], 0.05)], {}, POLICY) == ()


def test_faults_in_a_region_show_in_what_the_gate_measures():
    truth, draws, x = exact("gaussian", np.random.default_rng(15), n=2400, parameters=2)
    said = controls(prepared(truth, draws, x=x, parameters=["a", "a b"]))
    regional = {item.id: item for item in said if item.id.startswith("controls.region")}
    assert list(regional) == ["controls.region[a]", "controls.region[a b]"]
    for finding in regional.values():
        assert (np.diff(finding.details["size"]) > 0).all()
        # 1.3 half-widths move the truth across the draws' median in four of ten trials, an eighth of all.
        assert finding.estimate[-1] > max(finding.estimate[0], 0.03)


def test_the_component_that_is_farthest_for_certain_is_the_parameter_s_own():
    finding = measured("region[a]", [0.0] * 4, [0.9, 0.3, -0.5, 0.2], 0.01)
    names = ("a b where x", "a where x", "a where y", "a b where y")
    found = worst([replace(finding, components=names)], ["a", "a b", "c"])
    assert found == [(0.5, 0.01), (0.9, 0.01), (0.0, math.inf)]


def test_losses_are_tried_down_from_what_is_seen_and_up_from_what_is_not():
    """Noise of half a half-width is seen at once where the data are clean, and later where they are none."""
    rng = np.random.default_rng(17)
    truth, draws, x = exact("gaussian", rng, n=1500)
    first = 0.5 * math.log(1 + FIRST**2)
    for data, down in ((x, True), (rng.standard_normal(x.shape), False)):
        (loss,) = (item for item in controls(prepared(truth, draws, x=data)) if item.id == "controls.loss")
        sizes, seen = (
            loss.details["size"].values,
            loss.estimate > TOLERATED + REACH * loss.standard_error,
        )
        assert (np.diff(sizes) > 0).all()
        assert sizes[-1 if down else 0] == pytest.approx(first, rel=0.1)
        assert len(sizes) > 1
        assert seen[1:].all() if down else not seen[:-1].any()


def log_wider_by(draws, unit, noise):
    return lambda size: np.log(half_width(draws + size * unit * noise) / unit).mean()


def test_a_loss_of_the_printed_size_is_caught():
    """At least 4 of 6 fresh audits FAIL (of 90%: all but 2e-2; of a half: in a third), and none of an exact
    estimator."""
    rng = np.random.default_rng(16)
    select = ["informed"]
    verdict = verdict_of(*exact("cauchy", rng, n=1500), seed=1, select=[*select, "controls"])
    (loss,) = (control for control in verdict.controls if control.kind == "loss")
    assert loss.caught
    failed = np.zeros(2, dtype=int)
    for repeat in range(6):
        truth, draws, x = exact("cauchy", rng, n=1500)
        unit = half_width(draws)
        noise = rng.standard_normal(draws.shape) - rng.standard_normal((1500, 1, 1))
        wider = log_wider_by(draws, unit, rng.standard_normal(draws.shape))
        size = brentq(lambda h, wider=wider: wider(h) - loss.size, 0.01, 3.0, xtol=1e-2)
        for column, wrong in enumerate((draws + size * unit * noise, draws)):
            failed[column] += verdict_of(truth, wrong, x, seed=repeat, select=select).outcome == "FAIL"
    assert failed[0] >= 4
    assert failed[1] == 0
