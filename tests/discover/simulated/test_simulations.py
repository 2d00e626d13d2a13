"""The whole workflow on simulators that can only simulate: names, amplitudes, gaps, and what has no name."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.discovery import discover_simulated, simulations
from gaugeblock.discovery.engine import Comparison, Round
from gaugeblock.discovery.result import Discovery
from gaugeblock.discovery.simulated import judged
from gaugeblock.discovery.simulated.extend import extended_by, refine, refit
from gaugeblock.discovery.simulations import LEAST, Simulations
from gaugeblock.simulators import build_simulator

SMALL = {"simulations": 3000, "replicates": 399}


@pytest.fixture(scope="module")
def spike(ruler, readings):
    x = readings(300, 11, spike={"height": 0.45, "mark": 2.0})
    return discover_simulated(ruler, x, seed=1, **SMALL)


def test_the_hidden_effect_is_named_where_it_is(spike):
    assert isinstance(spike, Discovery)
    assert spike.named == "spike"
    assert spike.named_all == ("spike",)
    assert not any("something is left" in remark for remark in spike.to_json()["remarks"])
    assert spike.p_global <= 4 / 400
    assert spike.candidate("spike").parameters["mark"] == pytest.approx(2.0, abs=0.4)
    region = spike.to_json()["disagreement"]["regions"][0]
    assert region["start"] <= 2 < region["stop"]
    assert region["z"] > 4


def test_its_amplitude_is_recovered(spike):
    (amplitude,) = spike.to_json()["amplitude"]
    low, high = amplitude["interval"]
    error = (high - low) / 3.29
    # Noise of 1 in 300 readings, about 0.06 once the population is free; 4 errors.
    assert 0.05 < error < 0.11
    assert abs(amplitude["value"] - 0.45) < 4 * error


def test_the_gap_shrinks_where_it_was_not_fitted(spike):
    for gap in spike.to_json()["gap"]["in_sample"], spike.to_json()["gap"]["held_out"]:
        assert gap["before"] > 1.8
        assert gap["after"] < 0.6 * gap["before"]
    assert spike.candidate("spike").held_out > 5
    for decoy in spike.to_json()["decoys"]:
        assert decoy["held_out"] < spike.candidate("spike").held_out


def test_what_is_stored_follows_from_moments_and_null(spike):
    """Regions, gaps and intervals of a discovery, computed again from the arrays in its tree."""
    windows, null, held = (spike.tree[name] for name in ("windows", "null", "moments"))
    z, largest = windows["strongest"].values, null["moment"].values
    assert len(z) == 8
    assert len(largest) == 399
    np.testing.assert_array_equal(z, held["z"].values[:8])
    p = [(1 + np.sum(largest >= abs(one))) / 400 for one in z]
    runs = []
    for k in range(8):
        if p[k] > 0.01:
            continue
        if runs and runs[-1][-1] == k - 1 and z[k] * z[k - 1] > 0:
            runs[-1].append(k)
        else:
            runs.append([k])
    runs.sort(key=lambda run: -max(abs(z[k]) for k in run))
    said = spike.to_json()["disagreement"]["regions"]
    assert [(one["start"], one["stop"]) for one in said] == [(run[0], run[-1] + 1) for run in runs]
    for one, run in zip(said, runs, strict=True):
        assert (one["lo"], one["hi"], one["unit"]) == (run[0], run[-1] + 1, "channel")
        assert one["z"] == pytest.approx(max((z[k] for k in run), key=abs), abs=0.01)
        assert one["p_global"] == pytest.approx(min(p[k] for k in run))
    p_largest = (1 + np.sum(largest >= np.abs(held["z"].values).max())) / 400
    p_square = (1 + np.sum(null["square"].values >= (held["z"].values ** 2).mean())) / 400
    assert windows.attrs["p_global"] == pytest.approx(min(1.0, 2 * p_largest, 2 * p_square))
    gap = spike.to_json()["gap"]["in_sample"]
    for side in ("before", "after"):
        assert gap[side] == pytest.approx((held[side].values ** 2).mean())
    (one,) = spike.to_json()["amplitude"]
    assert one["interval"] == pytest.approx(
        [one["value"] + side * 1.64485 * one["standard_error"] for side in (-1, 1)], rel=1e-3
    )
    after = spike.fit.after.parameters
    assert after["spike_1.height"].value == pytest.approx(one["value"])
    assert (spike.data.name, spike.data.n_sources, spike.data.n_channels) == ("300 data sets", 300, 8)


@pytest.fixture(scope="module")
def two(ruler, readings):
    """An engine with a spike, and a tilt that leaves the spike unexplained."""
    x = readings(80, 11, spike={"height": 0.9, "mark": 2.0})
    engine = Simulations(
        ruler, x, seed=1, own=None, only=("spike", "tilt"), most=1, simulations=1000, replicates=399,
        summaries=None, step=lambda _: None,
    )  # fmt: skip
    spike, tilt = engine.fitted(engine.look(), ["spike", "tilt"], None)
    return engine, spike, tilt


def test_the_best_is_of_those_that_leave_nothing_to_explain(two):
    engine, spike, tilt = two
    state, one = np.array([*tilt.fit.state[:2], 0.05]), np.eye(3)
    ahead = replace(tilt, gain=spike.gain + 9.0, fit=replace(tilt.fit, state=state, covariance=1e-6 * one))
    assert ahead.significance > LEAST
    (first, second) = engine.compared([ahead, spike], engine.look())
    assert (first.model, first.lead, first.z) == (spike, 0.0, 0.0)
    assert second.model is ahead
    assert second.lead == pytest.approx(-9.0)
    assert second.z > 3
    left = engine.after(ahead).p_global
    assert engine.after(spike).p_global > 0.01 >= left
    # What is as rare as the level has something left to explain; where all leave something, merit decides.
    engine.thresholds = replace(engine.thresholds, level=left)
    assert engine.compared([ahead, spike], engine.look())[0].model is spike
    engine.thresholds = replace(engine.thresholds, level=1.0)
    assert engine.compared([ahead, spike], engine.look())[0].model is ahead
    # An amplitude that may well be neutral is that of something else that has moved.
    unsure = replace(ahead, fit=replace(ahead.fit, covariance=one))
    assert unsure.significance < LEAST
    assert engine.compared([unsure, spike], engine.look())[0].model is spike
    assert engine.compared([unsure], engine.look())[0].model is unsure


def test_an_interval_is_of_the_normal_error_and_ends_where_the_prior_does(two):
    engine, _, tilt = two
    for slope, low, high in ((0.05, 0.0, 0.2145), (1.0, 0.8355, 1.1645), (1.95, 1.7855, 2.0)):
        state = np.array([*tilt.fit.state[:2], slope])
        made = replace(tilt, fit=replace(tilt.fit, state=state, covariance=np.diag([9.0, 9.0, 0.01])))
        (said,) = engine.amplitudes([Round(engine.look(), (Comparison(made, 0.0, 0.0),))], ())
        assert (said.effect, said.parameter, said.value, said.held_out) == ("tilt", "slope", slope, False)
        assert said.interval == pytest.approx((low, high), abs=1e-4)
        assert (said.standard_error, said.level) == (pytest.approx(0.1), 0.9)
    assert [(one.id, one.why) for one in engine.not_checked()] == [
        ("delta_log_evidence", "the simulator has no likelihood")
    ]
    assert engine.data().name == "80 data sets"


def test_the_same_seed_finds_the_same(ruler, readings):
    x = readings(40, 12, tilt={"slope": 0.2})
    first, second = (discover_simulated(ruler, x, seed=2, simulations=1000, replicates=399) for _ in range(2))
    assert first.to_json() == second.to_json()
    assert first.named == "tilt"


def test_two_effects_are_both_named(ruler, readings):
    x = readings(300, 13, spike={"height": 0.7, "mark": 1.0}, tilt={"slope": 0.15})
    found = discover_simulated(ruler, x, seed=3, most=2, **SMALL)
    assert set(found.named_all) == {"spike", "tilt"}


def test_what_is_not_in_the_library_is_unnamed(ruler, readings):
    # Noise a third too large: no effect of the library does that, and the moments see it.
    found = discover_simulated(ruler, readings(300, 14, spread=1.3), seed=4, **SMALL)
    assert found.named == "unnamed"
    assert found.named_all == ()
    assert found.p_global <= 0.01
    # Whoever reads the population is told.
    assert found.to_json()["remarks"][-1].startswith("something is left that nothing here explains")


def test_what_gains_much_by_a_likeness_is_still_unnamed(ruler, readings):
    # Every second mark is read too high: a spike of the library explains one of them, and gains by that.
    x = readings(300, 18) + 0.7 * (np.arange(8) % 2)
    found = discover_simulated(ruler, x, seed=6, **SMALL)
    assert found.named == "unnamed"
    assert max(one["gain"] or 0.0 for one in found.to_json()["candidates"]) > 25


def test_what_is_not_fitted_yet_is_fitted_again_and_rivals_are_held_against_the_named(
    ruler, readings, monkeypatch
):
    """Steps are made to look as if their fits had not ended: far behind, they are refined all the same."""
    refined, ratios, made = [], [], {}

    def unsettled(candidate, *others):
        one = extended_by(candidate, *others)
        return replace(one, fit=replace(one.fit, converged=False)) if candidate.key == "step" else one

    def noted(one, *others):
        refined.append(one.label)
        return refine(one, *others)

    def refitted(like, *others, **options):
        fitted = refit(like, *others, **options)
        made[id(fitted.base)] = len(like.state)
        kept.append(fitted)  # so that no other base takes its place in memory
        return fitted

    def learned(span, numerator, denominator):
        ratios.append((made.get(id(numerator)), made.get(id(denominator))))
        return ratio(span, numerator, denominator)

    kept, ratio = [], judged.LogRatio.learned
    both = replace(simulations.SIMULATIONS, at_least=2, behind=0.0)
    monkeypatch.setattr(simulations, "SIMULATIONS", both)
    monkeypatch.setattr(simulations, "extended_by", unsettled)
    monkeypatch.setattr(simulations, "refine", noted)
    monkeypatch.setattr(judged, "refit", refitted)
    monkeypatch.setattr(judged.LogRatio, "learned", learned)
    x = readings(300, 11, spike={"height": 0.6, "mark": 2.0})
    found = discover_simulated(ruler, x, seed=1, only=("spike", "step"), **SMALL)
    assert found.named == "spike"
    assert refined.count("step") == 1
    # By the number of parameters: the spike over the model before, the step over the spike; in either half.
    assert [pair for pair in ratios if pair != (None, None)] == [(4, 2), (4, 4)] * 2


def test_one_data_set_alone(ruler, readings):
    """A spike of six errors is the best candidate, at a global p of 0.01, in most of six."""
    right = 0
    for seed in range(100, 106):
        x = readings(1, seed, centre=0.3, width=0.1, spike={"height": 6.0, "mark": 5.0})
        found = discover_simulated(ruler, x, seed=seed, **SMALL).to_json()
        best = found["candidates"][0]
        if found["disagreement"]["p_global"] <= 0.01 and best["effect"] == "spike":
            assert best["parameters"]["mark"] == pytest.approx(5.0, abs=0.5)
            right += 1
        assert {"held_out", "delta_log_evidence"} <= {item["id"] for item in found["not_checked"]}
        assert (found["data"]["name"], found["data"]["n_sources"]) == ("one data set", 1)
    assert right >= 3
    found = discover_simulated(ruler, readings(1, 16, centre=0.3, width=0.1), seed=5, **SMALL)
    assert found.named is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "values", "amplitude"),
    [
        ("reporting_step", {"share": 0.2, "week": 5.5}, "share"),
        ("contact_change", {"factor": 0.87, "week": 4.5}, "factor"),
        ("missed_week", {"share": 0.35, "week": 6.0}, "share"),
    ],
)
def test_effects_on_the_epidemic(name, values, amplitude):
    epidemic = build_simulator("epidemic", nodes=5)
    rng = np.random.default_rng(17)
    theta = epidemic.prior.from_unit_cube(np.clip(rng.normal([0.66, 0.4], 0.16, size=(300, 2)), 0.02, 0.98))
    entry = epidemic.effect_library(theta)[name]
    x = epidemic.with_effect(entry.effect(**values)).simulate(theta, rng)
    found = discover_simulated(epidemic, x, seed=6, simulations=8000)
    assert found.named == name
    (said,) = found.to_json()["amplitude"]
    error = (said["interval"][1] - said["interval"][0]) / 3.29
    assert abs(said["value"] - values[amplitude]) < 4 * error


@pytest.mark.parametrize(
    ("x", "options", "words"),
    [
        (np.zeros((29, 8)), {}, "a population cannot be fitted to 29 data sets; give one, or at least 30$"),
        (np.zeros((0, 8)), {}, r"x: has shape \(0, 8\); it must have the shape .*, \(8,\), or be several"),
        (np.zeros(7), {}, r"x: has shape \(7,\); it must"),
        (np.zeros((40, 9)), {}, r"x: has shape \(40, 9\); it must"),
        (np.full((40, 8), "a"), {}, "x holds <U1 values"),
        (np.full((40, 8), np.nan), {}, "x: 320 of 320 numbers are NaN or infinite"),
        (np.zeros((30, 8)), {"simulations": 999}, "at least 1,000 simulations a state, got 999"),
        (np.zeros((1, 8)), {"simulations": 999}, "at least 1,000 simulations a state, got 999"),
        (np.zeros((40, 8)), {"replicates": 398}, r"at least 399 replicates, got 398: .* global p of 0\.01$"),
        (np.zeros((40, 8)), {"only": ("glow",), "simulations": 1000}, "no effect glow"),
    ],
)
def test_mistakes_are_one_clear_line(ruler, x, options, words):
    with pytest.raises(InputError, match=words) as caught:
        discover_simulated(ruler, x, **options)
    assert "\n" not in str(caught.value)


def test_one_data_set_may_come_without_its_axis(ruler):
    with pytest.raises(InputError, match="no effect glow"):  # which is asked later
        discover_simulated(ruler, np.zeros(8), only=("glow",), simulations=1000)


def test_missing_data_are_left_to_summaries(ruler):
    x = np.where(np.arange(320).reshape(40, 8) % 9 == 0, np.nan, 0.1)

    def of_what_is_there(data):
        return np.stack([np.nanmean(data, axis=1), np.nanstd(data, axis=1)], axis=1)

    with pytest.raises(InputError, match="no effect glow"):
        discover_simulated(ruler, x, only=("glow",), simulations=1000, summaries=of_what_is_there)


def test_a_simulator_without_effects_is_told_so():
    with pytest.raises(InputError, match="TwoMoons has no with_effect"):
        discover_simulated(build_simulator("two_moons"), np.zeros((40, 2)))


def test_what_cannot_be_simulated_is_told_so():
    class Still:
        with_effect = Simulations.fitted

    with pytest.raises(InputError, match="Still has no simulate"):
        discover_simulated(Still(), np.zeros((40, 2)))
