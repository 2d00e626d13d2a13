"""Helpers of the exact cross-check, against answers that are known."""

import numpy as np
import pytest
import xarray as xr
from studies.paper import claims
from studies.paper.experiment import committed
from studies.paper.experiments import load
from studies.paper.experiments.arithmetic import GAIN_PRIOR_SD
from studies.paper.experiments.cross_claims import capture, numbers_of, pulls_of
from studies.paper.experiments.cross_posteriors import (
    effective_dimension,
    overlap,
    shrink_of,
    thread_scatter,
    told_apart,
)
from studies.paper.experiments.cross_spectra import chosen_bright, weighted_sd
from studies.paper.numbers import by_claim
from studies.paper.paper_flow import TRAININGS
from studies.paper.trainings import by_training

from gaugeblock.estimators.nested_sampling import NestedPoints
from gaugeblock.validate.evidence import threads_of
from gaugeblock.validate.evidence.perfect_runs import perfect_run


def test_a_shrink_and_its_error_are_those_of_many_samples():
    rng = np.random.default_rng(1)
    gain = rng.normal(1.0, 0.6 * GAIN_PRIOR_SD, (2000, 400))
    found, error = shrink_of(gain, np.full(gain.shape, 1 / 400))
    # Of 2,000 shrinks: mean to 0.0005, scatter to 1.6 per cent.
    assert found.mean() == pytest.approx(0.6, abs=0.002)
    assert error.mean() == pytest.approx(found.std(), rel=0.06)


def test_errors_by_threads_are_the_scatter_of_runs():
    """A value that falls with the likelihood, as a distance does: runs by a perfect sampler."""
    rng = np.random.default_rng(8)
    found, errors = [], []
    for _ in range(60):
        run = perfect_run(lambda v: -50.0 * np.exp(2.0 * v / 3.0), live_points=60, depth=14.0, rng=rng)
        # In another order than the contours', and with as many values on either side of 0.
        order = rng.permutation(len(run.log_likelihood))
        points = NestedPoints(run.log_likelihood[order], run.birth_log_likelihood[order])
        value = np.sqrt(-points.log_likelihood) * rng.choice([-1.0, 1.0], len(order))
        errors.append(thread_scatter(points, value, rng))
        whole = threads_of(points)
        live = whole.live_points(np.ones((1, len(order))))
        weight = np.exp(whole.log_likelihood - np.cumsum(1.0 / live)) / live[0]
        ordered = value[np.argsort(points.log_likelihood, kind="stable")]
        found.append(weighted_sd(ordered, weight / weight.sum()))
    # Of 60 runs: scatter to 9 per cent.
    assert np.mean(errors) == pytest.approx(np.std(found, ddof=1), rel=0.3)


def test_weights_count_as_many_draws():
    values = np.array([0.0, 1.0, 3.0])
    repeated = np.array([0.0, 1.0, 1.0, 3.0])
    assert weighted_sd(values, np.array([0.25, 0.5, 0.25])) == pytest.approx(repeated.std())


def test_capture_is_1_for_the_exact_width_and_0_for_the_prior_s():
    assert capture(np.array([0.7, 1.0, 0.85]), 0.7) == pytest.approx([1.0, 0.0, 0.5])


def test_what_flows_keep_is_the_study_networks_training_by_training_and_ours_beside():
    table = committed("cross_check")
    found = load("cross_check").measured(table)["xc.bright.capture"]
    three = np.flatnonzero(table["level"].values.astype(str) == "bright")[:3]
    exact = table["exact_reference"].values[three]
    for place, part in enumerate(("first", "second", "third, least")):
        kept = by_training(claims()["xc.bright.capture"], part)
        assert len(kept) == len(TRAININGS)
        # The column is the first training's.
        assert kept[0] == pytest.approx((1 - table["study"].values[three[place]]) / (1 - exact[place]))
        assert found.parts[part] == pytest.approx(kept.mean())
        ours = (1 - table["flow"].values[three[place]]) / (1 - exact[place])
        assert f"{part} {ours:.4g}" in found.note.partition("flows of our own give ")[2]
    assert found.trainings == len(TRAININGS)


def test_what_16_sets_of_draws_keep_and_what_twice_the_steps_change():
    """Of our flows, whose columns are kept, counted again: sets by their own capture, steps by accuracies."""
    table = committed("cross_check")
    again = numbers_of(table)
    bright = np.flatnonzero(table["level"].values.astype(str) == "bright")[0]
    sets = (1 - table["flow_by_set"].values[bright]) / (1 - table["exact_reference"].values[bright])
    assert len(sets) == 16
    assert again["xc.bright.capture"]["of a set"] == pytest.approx((sets.mean(), sets.std(ddof=1) / 4))
    assert again["xc.bright.capture"]["scatter of sets"] == pytest.approx(sets.std(ddof=1))
    said, (numbers, errors) = (
        load("cross_check").measured(table),
        (by_claim(table, name)["xc.bright.capture"] for name in ("number", "standard_error")),
    )
    mean, error, spread = numbers["of a set"], errors["of a set"], numbers["scatter of sets"]
    assert said["xc.bright.capture"].note.startswith(
        f"16 sets of draws of the first keep {mean:.3f} ± {error:.3f} on average, one of them scatters by "
        f"{spread:.3f};"
    )
    # Together the sets are the draws: mean squares of both but for the sets' own means.
    whole = table["flow"].values
    np.testing.assert_allclose(np.sqrt((table["flow_by_set"].values ** 2).mean(axis=1)), whole, rtol=3e-3)
    accuracy, error = table["nuts_accuracy"].values, table["nuts_accuracy_error"].values
    worst = np.abs(accuracy[1] - accuracy[0]).argmax()
    moved, chance = np.abs(accuracy[1] - accuracy[0])[worst], np.hypot(*error[:, worst])
    assert again["xc.c2st"]["steps"] == pytest.approx((moved, chance))
    assert again["xc.c2st"]["chain"] == accuracy[0].max()
    step, its_error = (by_claim(table, name)["xc.c2st"]["steps"] for name in ("number", "standard_error"))
    assert f"twice its steps move it by {step:.3f} ± {its_error:.3f}" in said["xc.c2st"].note
    # Two sets of 4,000 draws: the error of a binomial share of 8,000.
    np.testing.assert_allclose(error, np.sqrt(accuracy * (1 - accuracy) / 8000), rtol=0.3)


def test_dimensions_of_one_two_and_three_directions():
    draws = np.random.default_rng(2).normal(size=(20_000, 3))
    line = draws[:, :1] + 1e-6 * draws
    plane = np.column_stack([draws[:, 0], draws[:, 0], draws[:, 1]])
    assert effective_dimension(draws) == pytest.approx(3.0, abs=0.01)
    assert effective_dimension(line) == pytest.approx(1.0, abs=1e-6)
    assert effective_dimension(plane) == pytest.approx(9.0 / 5.0, abs=0.02)


def test_overlap_is_of_the_68_per_cent_intervals():
    draws = np.random.default_rng(3).normal(size=(40_000, 2))
    assert overlap(draws, draws) == 1.0
    assert overlap(draws, 2.0 * draws) == pytest.approx(0.5, abs=1e-9)
    assert overlap(draws, draws + 1.0) == pytest.approx(1.0 / 3.0, abs=0.02)
    assert overlap(draws, draws + 5.0) == 0.0


def test_a_classifier_tells_apart_what_differs_in_the_gain_alone():
    pytest.importorskip("sklearn")
    rng = np.random.default_rng(4)
    first, same = rng.normal(size=(2, 600, 6))
    other = same + np.array([0, 0, 0, 0, 0, 1.5])
    every, error, gain, _ = told_apart(first, other, rng, 500)
    # Two normal distributions 1.5 apart: 0.773 is the best that can be had.
    assert every == pytest.approx(0.773, abs=5 * error)
    assert gain == pytest.approx(0.773, abs=5 * error)
    every, error, gain, _ = told_apart(first, same, rng, 500)
    assert abs(every - 0.5) < 4 * error > abs(gain - 0.5)


def test_bright_spectra_are_chosen_by_what_is_published_of_them():
    rng = np.random.default_rng(5)
    error = np.geomspace(0.02, 1.0, 60)
    counts = rng.integers(1_000, 9_000, (60, 1))
    counts[np.argmin(np.abs(error - 0.037))] = 54_000
    found = {"gain_error": error, "counts": counts, "soft": (0.3 * counts[:, 0]).astype(int)}
    found["soft"][40] = int(0.06 * counts[40, 0])
    chosen = chosen_bright(found)
    np.testing.assert_allclose(error[chosen[:3]], [0.037, 0.05, 0.039], rtol=0.08)
    assert len(set(chosen)) == 4
    assert chosen[3] == 40


def test_pulls_of_equal_posteriors_are_equal_and_wider_ones_are_seen():
    rng = np.random.default_rng(6)
    z = rng.normal(size=(10, 6))
    table = xr.Dataset(
        {
            "z_published_linear_norm": (("spectrum", "parameter"), z),
            "z_reference": (("spectrum", "parameter"), z),
            "z_flow": (("spectrum", "parameter"), 1.5 * z),
        }
    )
    found = pulls_of(table)["xc.zrms"]
    assert found["flow"][0] == pytest.approx(1.5 * found["exact"][0])
    assert found["p"][0] < 1e-6
    # RMS of 60 normal numbers: relative error 1 / sqrt(120).
    assert found["exact"][1] == pytest.approx(1 / np.sqrt(120), rel=0.5)


def test_weights_make_a_poor_proposal_exact():
    """A flow that is wrong on purpose: draws from the prior, of a model whose posterior is known."""
    from studies.paper.experiments.cross_posteriors import weighted_draws

    from gaugeblock.simulators import Prior, Uniform

    class Straight:
        prior = Prior({f"p{k}": Uniform(0.0, 0.05) for k in range(5)} | {"p5": Uniform(0.0, 2.0)})

        def expected(self, theta):
            return 100.0 * np.asarray(theta)

    class FromThePrior:
        def sample_and_log_prob(self, x, n, rng):
            theta = Straight.prior.sample(n, rng)[None]
            return theta, Straight.prior.log_prob(theta)

        def log_prob(self, theta, x):
            return Straight.prior.log_prob(theta)

    target, counts = Straight(), np.array([1.0, 1.0, 1.0, 1.0, 1.0, 100.0])
    found = weighted_draws(FromThePrior(), target, counts, 60_000, np.random.default_rng(4))
    # A Poisson mean under a flat prior: a gamma distribution of shape 101, scale 1/100.
    assert found["mean"][5] == pytest.approx(1.01, abs=5e-3)
    assert found["sd"][5] == pytest.approx(np.sqrt(101.0) / 100.0, rel=0.03)
    assert found["draws"][:, 5].std() == pytest.approx(found["sd"][5], rel=0.05)
    assert found["shrink_error"] / found["shrink"] == pytest.approx(
        1.0 / np.sqrt(2.0 * found["effective"]), rel=0.1
    )
