"""Importance weights and what is made of them: flows whose answers are known, scores whose AUCs are."""

import numpy as np
import pytest
from scipy import stats
from studies.paper.auc_error import null_auc_error
from studies.paper.experiments import importance_cells
from studies.paper.experiments.importance import measured, populations, table_of
from studies.paper.experiments.importance_cells import (
    Cell,
    Score,
    cell_of,
    median,
    pooled,
    score_of,
    selected,
    training,
)
from studies.paper.experiments.importance_weights import diagnostics
from studies.paper.judge import Agreement, judge
from studies.paper.registry import claims

LOW, HIGH = np.array([0.0, 0.0, 1.0, 0.0, 1.0]), np.array([1.0, 1.0, 2.0, 1.0, 2.0])


class Box:
    """Draws uniform over the box, widened upwards by a share in its first parameter."""

    box = (LOW, HIGH)

    def __init__(self, widened=0.0):
        self.width = (HIGH - LOW) * (1.0 + widened * np.eye(5)[0])

    def raw(self, x, n, rng):
        theta = LOW + self.width * rng.random((len(x), n, 5))
        return theta, np.full(theta.shape[:2], -np.log(self.width).sum())

    def inside(self, theta):
        return ((theta >= LOW) & (theta <= HIGH)).all(axis=-1)


class Flat:
    """The same likelihood everywhere; of weights of a Pareto tail where `shape` is given."""

    def __init__(self, shape=None):
        self.shape = shape

    def log_likelihood(self, theta, counts):
        assert ((theta >= LOW) & (theta <= HIGH)).all()
        # What lies outside the box is given as its lowest corner.
        first = np.maximum(theta[..., 0], 1e-9)
        return np.zeros(theta.shape[:2]) if self.shape is None else -self.shape * np.log(first)


def weights_of(flow, likelihood, draws=4000):
    rng = np.random.default_rng(5)
    return diagnostics(flow, likelihood, np.ones((20, 3)), draws=draws, few=draws // 4, rng=rng)


def test_draws_of_the_posterior_all_count_under_its_own_prior_only():
    found = weights_of(Box(), Flat())
    np.testing.assert_allclose(found["effective"], 1.0)
    np.testing.assert_array_equal(found["accepted"], 1.0)
    # Under the reciprocal of both norms, each uniform from 1 to 2: (E[1/K]^2 / E[1/K^2])^2, K from 1 to 2.
    expected = (np.log(2.0) ** 2 / 0.5) ** 2
    assert found["effective_simulated"].mean() == pytest.approx(expected, abs=0.004)


def test_draws_outside_the_box_have_no_weight():
    found = weights_of(Box(widened=0.25), Flat())
    assert found["accepted"].mean() == pytest.approx(0.8, abs=0.01)
    np.testing.assert_allclose(found["effective"], found["accepted"])


def test_the_first_few_draws_are_judged_as_if_there_were_no_others():
    found = weights_of(Box(widened=0.25), Flat(0.5))
    rng = np.random.default_rng(5)
    theta, _ = Box(widened=0.25).raw(np.ones((20, 3)), 4000, rng)
    first = theta[:, :1000, 0]
    weight = np.where(first <= 1.0, first**-0.5, 0.0)
    expected = weight.sum(axis=1) ** 2 / (weight**2).sum(axis=1) / 1000
    np.testing.assert_allclose(found["few-effective"], expected)


@pytest.mark.parametrize("shape", [0.2, 0.5, 0.9])
def test_khat_is_the_shape_of_a_pareto_tail(shape):
    """The weight u^-k of a uniform u has a Pareto tail of shape k, for any threshold."""
    assert weights_of(Box(), Flat(shape))["khat"].mean() == pytest.approx(shape, abs=0.07)


def test_areas_of_known_scores():
    rng = np.random.default_rng(0)
    clean, suspicious = rng.normal(size=3000), rng.normal(1.0, size=2000)
    score = score_of(clean, suspicious, rng)
    assert score.auc == pytest.approx(stats.norm.cdf(np.sqrt(0.5)), abs=4 * score.error)
    assert score.low == pytest.approx(score.auc - 1.96 * score.error, abs=0.002)
    assert score.p == pytest.approx(1e-4)
    assert score_of(clean[:150], clean[150:250], rng).p > 0.01


def test_few_effective_draws_and_a_large_khat_are_suspicious():
    rng = np.random.default_rng(1)
    good = {"effective": rng.random(50) + 1, "effective_simulated": rng.random(50), "khat": rng.random(50)}
    bad = {"effective": rng.random(40), "effective_simulated": rng.random(40) + 1, "khat": rng.random(40) + 1}
    areas = [score.auc for score in cell_of("a", 0.0, good, bad, rng).scores]
    assert areas == [1.0, 0.0, 1.0]


def test_the_error_of_a_median():
    """sqrt(pi / 2n) for normal values."""
    errors = [
        median(np.random.default_rng(k).normal(size=400), np.random.default_rng(9))[1] for k in range(8)
    ]
    assert np.mean(errors) == pytest.approx(np.sqrt(np.pi / 800), rel=0.15)


def test_populations_against_each_other():
    rng = np.random.default_rng(2)
    found, error = pooled([np.array([1.0, 2.0]), np.array([3.0, 4.0])], rng)
    assert found == 0.0 or found == 1.0
    assert error == pytest.approx(null_auc_error(2, 2), rel=0.1)
    same, error = pooled([rng.random(100) for _ in range(8)], rng)
    assert same == pytest.approx(0.5, abs=4 * error)
    # Two populations alone have the error of one AUC; eight of them share theirs in part.
    assert null_auc_error(100, 100) / np.sqrt(28) < error < null_auc_error(100, 100) / 2


def test_luck_alone_elevates_a_seed_set():
    rng = np.random.default_rng(3)
    error = null_auc_error(150, 100)

    def cells(areas):
        score = [Score(auc=area, error=error, low=0.0, p=1.0) for area in areas]
        return [Cell(name="", amplitude=0.1, effective=one, simulated=one, khat=one) for one in score]

    sets = {0: cells([0.5, 0.5]), 1: cells([0.6, 0.55]), 2: cells([0.4, 0.65])}
    found = selected(sets, (150, 100), rng)
    assert (found["least"][0], found["most"][0]) == (0.55, 0.6)
    assert found["first"][0] == pytest.approx(0.1 / error)
    assert found["second"][0] == pytest.approx(0.15 / error)
    # Shared clean spectra leave the extremes of cells less than those of as many independent ones: sd 0.6.
    assert 0.4 < found["second"][1] < 0.9


def test_every_population_is_drawn_once():
    sizes = {"clean": 150, "suspicious": 100}
    named = list(populations(sizes))
    names = [name for name, *_ in named]
    assert len(set(names)) == len(names)
    assert sum(number for *_, number in named) == 6 * 150 + 100 * (8 + 4 + 16)


def test_other_weights_are_told_by_claim():
    clean = {"effective": np.array([0.05, 0.2, 0.3]), "khat": np.array([0.1, 0.2, 0.9])}
    lined = {"effective": np.array([0.01, 0.25]), "khat": np.array([0.5, 1.0])}
    found = training(clean, lined)
    assert found["is.essfrac.bright"] == 0.2
    assert found["is.lowess.bright"] == pytest.approx(1 / 3)
    assert found["tab4.IS.B1.bright"] == pytest.approx(4 / 6)
    assert found["is.khat.B1.bright"] == pytest.approx(5 / 6)


def weights(rng, number, *, effective):
    """As `diagnostics` gives them, of spectra of so many effective draws in the median."""
    share = np.clip(effective * np.exp(0.5 * rng.standard_normal(number)), 0.0, 1.0)
    names = [f"{prefix}{name}" for prefix in ("", "few-") for name in ("effective", "effective_simulated")]
    return {
        "counts": np.full(number, 1000.0),
        "accepted": np.full(number, 0.96),
        **dict.fromkeys(names, share),
        "khat": 1.0 - share,
        "few-khat": 1.0 - share,
    }


def test_a_table_measures_every_claim_and_explains_the_flow_that_was_cut(monkeypatch):
    monkeypatch.setattr(importance_cells, "PERMUTATIONS", 199)
    monkeypatch.setattr(importance_cells, "BOOTSTRAPS", 100)
    rng = np.random.default_rng(6)
    sizes = {"clean": 60, "suspicious": 40, "draws": 6000}
    usual = {"medium": 0.25, "bright": 0.06}
    found = {
        name: weights(rng, number, effective=usual[level] * (0.2 if kind == "line" else 1.0))
        for name, level, kind, _, number in populations(sizes)
    }
    found |= {f"cut-{kind}": weights(rng, 40, effective=0.01) for kind in ("clean", "line")}
    found |= {f"ceiling-{level}": {"ceiling": rng.random(20)} for level in usual}
    table = table_of(found, {"best": -15.8, "cut": -12.4}, sizes, rng)
    said = measured(table)
    mine = {name: claim for name, claim in claims().items() if claim.by == "importance"}
    assert set(said) == set(mine)
    judged = {name: judge(claim, said[name]) for name, claim in mine.items()}
    assert judged["is.draws"].verdict is Agreement.AGREES
    # In the middle of its margin, by errors that include what kept trainings scatter by; just past another.
    assert judged["is.essfrac.medium"].verdict is Agreement.AGREES
    assert judged["is.essfrac.bright"].verdict is Agreement.UNDECIDED
    assert "our training gives 0.01" in said["is.essfrac.bright"].because
    assert judged["is.lowess.bright"].ours["cut"] == 1.0
    assert table["auc"].sel(cell="medium-line-0", score="khat") > 0.9
