"""Runs of MCMC and nested samplers as trials; what is not installed has stand-ins of the same calls."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from gaugeblock import trials_from_samplers
from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import generator

TRUTHS = np.array([[0.3, -0.2], [1.0, 0.5], [-0.4, 0.1]])


def points(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Points spread widely, whose weights make them N((1, -1), 0.3)."""
    wide = np.random.default_rng(seed).normal(0, 2, size=(40_000, 2))
    log_weight = stats.norm([1, -1], 0.3).logpdf(wide).sum(1) - stats.norm(0, 2).logpdf(wide).sum(1)
    return wide, log_weight


@pytest.mark.parametrize("kind", ["pair", "dynesty", "nautilus"])
def test_weighted_points_are_drawn_by_their_weights(kind):
    made = [points(seed) for seed in range(3)]
    runs = {
        "pair": made,
        "dynesty": [SimpleNamespace(samples=p, logwt=w) for p, w in made],
        "nautilus": [SimpleNamespace(posterior=lambda p=p, w=w: (p, w, 0 * w)) for p, w in made],
    }[kind]
    trials = trials_from_samplers(runs, TRUTHS, draws=300, names=["a", "b"], x=TRUTHS)
    assert dict(trials.sizes) == {"trial": 3, "draw": 300, "parameter": 2, "channel": 2}
    np.testing.assert_allclose(trials["draws"].mean("draw"), [[1, -1]] * 3, atol=0.1)
    np.testing.assert_allclose(trials["draws"].std("draw"), 0.3, rtol=0.25)
    assert "autocorrelated" not in trials.attrs


def test_dynesty_itself():
    dynesty = pytest.importorskip("dynesty")

    def log_likelihood(theta):
        return -0.5 * float(np.sum((theta - 0.5) ** 2)) / 0.25

    sampler = dynesty.NestedSampler(
        log_likelihood, stats.norm.ppf, 2, nlive=60, rstate=np.random.default_rng(1)
    )
    sampler.run_nested(print_progress=False)
    drawn = trials_from_samplers([sampler.results], [[0.4, 0.4]])["draws"]
    np.testing.assert_allclose(drawn.mean("draw"), 0.4, atol=0.15)


def test_chains_go_walker_after_walker_without_what_is_discarded():
    chain = np.arange(7 * 2)[:, None] + np.zeros(2)
    chain = chain.reshape(7, 2, 2)  # step, walker, parameter
    trials = trials_from_samplers([SimpleNamespace(get_chain=lambda: chain)] * 3, TRUTHS, discard=4)
    assert trials.attrs["autocorrelated"] == 1
    assert trials["draws"].values[0, :, 0].tolist() == [8, 10, 12, 9, 11, 13]


def test_folders_and_results_of_ultranest(tmp_path):
    (tmp_path / "chains").mkdir()
    rows = np.random.default_rng(2).normal(size=(300, 2))
    np.savetxt(tmp_path / "chains" / "equal_weighted_post.txt", rows, header="a b", comments="")
    trials = trials_from_samplers([tmp_path, {"samples": rows}, rows], TRUTHS, draws=100)
    for drawn in trials["draws"].values:
        assert set(map(tuple, drawn.round(9))) <= set(map(tuple, rows.round(9)))
        assert len({tuple(row) for row in drawn}) == 100
    with pytest.raises(InputError, match="run 0 has 300 draws; 400 are asked for"):
        trials_from_samplers([rows], TRUTHS[:1], draws=400)
    (tmp_path / "chains" / "equal_weighted_post.txt").write_text("a b\n1 nonsense\n")
    with pytest.raises(InputError, match="is no table of numbers"):
        trials_from_samplers([tmp_path], TRUTHS[:1])


@pytest.mark.parametrize(
    ("runs", "said"),
    [
        ([], "no runs"),
        ([object()], "run 0 is a object; expected an emcee"),
        ([(np.zeros((5, 2)), np.full(5, -np.inf))], "some of them finite"),
        ([np.zeros((9, 2)), np.zeros((9, 3, 2))], "give runs of one kind"),
        (["nowhere"], "no such file"),
    ],
)
def test_what_is_no_run_is_one_line(runs, said):
    with pytest.raises(InputError, match=said):
        trials_from_samplers(runs, TRUTHS[: len(runs)], draws=5)


def test_every_run_is_drawn_from_with_a_stream_of_its_own():
    """Of equal weights none twice; by their weights with what NumPy chooses; points without weight never."""
    rows = np.random.default_rng(1).normal(size=(2, 40, 2))
    equal = trials_from_samplers(list(rows), TRUTHS[:2], draws=30, seed=5)["draws"].values
    log_weight = np.log(np.arange(40.0) + 1) - 1000.0
    log_weight[[3, 9]] = -np.inf
    runs = [(points, log_weight) for points in rows]
    weighed = trials_from_samplers(runs, TRUTHS[:2], draws=50, seed=5)["draws"].values
    weight = np.exp(log_weight - log_weight.max())
    for trial in range(2):
        rng = generator(5, "trials_from_samplers", trial)
        np.testing.assert_array_equal(equal[trial], rows[trial][rng.permutation(40)[:30]])
        rng = generator(5, "trials_from_samplers", trial)
        np.testing.assert_array_equal(
            weighed[trial], rows[trial][rng.choice(40, 50, p=weight / weight.sum())]
        )
    whole = trials_from_samplers([rows[0]], TRUTHS[:1], draws=40)["draws"].values[0]
    assert sorted(map(tuple, whole)) == sorted(map(tuple, rows[0]))


def test_truths_of_one_parameter_and_data():
    chain = np.arange(12.0).reshape(3, 4, 1)
    made = trials_from_samplers([chain, chain + 1], [0.5, 0.6], x=[[1.0], [2.0]], names=["m"])
    assert made["theta_true"].values.tolist() == [[0.5], [0.6]]
    assert made["draws"].values[0, :, 0].tolist() == [0, 4, 8, 1, 5, 9, 2, 6, 10, 3, 7, 11]
    assert made["x"].values.tolist() == [[1.0], [2.0]]
    assert made["parameter"].values.tolist() == ["m"]
    assert trials_from_samplers([chain[..., 0]], TRUTHS[:1, :1].repeat(4, 1), draws=3).sizes["parameter"] == 4


@pytest.mark.parametrize(
    ("run", "said"),
    [
        ((np.zeros((5, 2)), np.zeros(4)), "points of shape (5, 2) with log weights of shape (4,); expected"),
        ((np.zeros(5), np.zeros(5)), "points of shape (5,) with log weights of shape (5,); expected"),
        *(
            (
                (np.zeros((5, 2)), np.array(log_weight)),
                ": log weights must be finite or -inf, and some of them",
            )
            for log_weight in ([0.0, 0.0, np.nan, 0.0, 0.0], [0.0, np.inf, 0.0, 0.0, 0.0], [-np.inf] * 5)
        ),
        (np.zeros((3, 2, 2, 2)), " has the shape (3, 2, 2, 2); expected an emcee EnsembleSampler"),
        (np.zeros(7), " has the shape (7,); expected an emcee EnsembleSampler"),
        ({"sample": 3}, " is a dict; expected an emcee EnsembleSampler"),
        (np.zeros((4, 2)), " has 4 draws; 5 are asked for: give draws=4"),
    ],
)
def test_runs_of_other_shapes_are_told_with_their_trial(run, said):
    with pytest.raises(InputError) as caught:
        trials_from_samplers([np.zeros((9, 2)), run], TRUTHS[:2], draws=5)
    assert str(caught.value).startswith("trials_from_samplers: run 1")
    assert said in str(caught.value)
