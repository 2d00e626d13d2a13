"""Runs of MCMC and nested samplers as trials; what is not installed has stand-ins of the same calls."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from gaugeblock import trials_from_samplers
from gaugeblock.core.errors import InputError

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
