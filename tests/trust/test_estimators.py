"""Claims of an estimator's author that draws do not bear out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

import gaugeblock as gb
from gaugeblock.auditing.audit import audit
from gaugeblock.estimators.exact import Exact
from gaugeblock.validate import Outcome
from gaugeblock.validate.finding import finding_from
from gaugeblock.validate.joint.normalisation import lacking_density, unconfirmed
from gaugeblock.validate.prepared import Prepared
from gaugeblock.validate.trials import make_trials, trials_tree

TABLE = {"number": 60, "draws": 300, "joint_number": 0, "importance_number": 60, "importance_draws": 300}
NEEDED = {"required": ["importance.ess"], "tolerance": {"log_width": 9.0}}


class Wide(Exact):
    """The exact posterior by what it says, and draws `factor` times as wide."""

    factor, shift = 4.0, 0.0

    def sample(self, x: Any, n: int, rng: np.random.Generator) -> Any:
        draws = super().sample(x, n, rng)
        return draws.mean(axis=1, keepdims=True) + self.factor * (draws - draws.mean(axis=1, keepdims=True))

    def log_prob(self, theta: Any, x: Any) -> Any:
        return super().log_prob(theta, x) + self.shift


class Loud(Wide):
    """As wide, and its log q moved so that draws and log q agree where draws are dense."""

    shift = -2.4


def judged(estimator: Any, parameters: int) -> Any:
    simulator = {"name": "linear_gaussian", "parameters": parameters, "data": parameters}
    return audit(
        estimator,
        simulator,
        trials=TABLE,
        policy=NEEDED,
        validators=["importance"],
        progress=False,
    )


@pytest.mark.attack("every fifth draw exact, the others garbage, and called a chain", "FAIL or INCONCLUSIVE")
@pytest.mark.parametrize(("width", "outcome"), [(50.0, Outcome.FAIL), (1.0, Outcome.INCONCLUSIVE)])
def test_a_chain_of_which_one_offset_is_good(width: float, outcome: Outcome) -> None:
    rng = np.random.default_rng(3)
    theta = rng.standard_normal((300, 1))
    x = theta + 0.5 * rng.standard_normal(theta.shape)
    draws = 0.8 * x[:, None] + np.sqrt(0.2) * rng.standard_normal((300, 500, 1))
    only = ["draws", "sbc"]
    good = gb.audit_draws(theta, draws[:, ::5], validators=only, progress=False)
    assert good.outcome is not Outcome.FAIL
    others = np.arange(500) % 5 != 2
    draws[:, others] = width * rng.standard_normal((300, int(others.sum()), 1))
    found = gb.audit_draws(theta, draws, autocorrelated=True, validators=only, progress=False)
    assert found.outcome is outcome


@pytest.mark.attack("draws four times too wide, their log q exact", "importance gates INCONCLUSIVE")
@pytest.mark.parametrize("parameters", [1, 2, 5])
@pytest.mark.parametrize("estimator", [Wide, Loud])
def test_weights_of_a_density_that_is_not_the_draws(estimator: Any, parameters: int) -> None:
    found = judged(estimator, parameters)
    assert found.verdict.outcome is Outcome.INCONCLUSIVE
    (gate,) = (gate for gate in found.verdict.gates if gate.id == "importance.ess")
    # The weights themselves are all the same.
    assert gate.outcome is Outcome.INCONCLUSIVE
    assert gate.statistic == pytest.approx(1.0)
    assert "but the draws do not confirm that log q is their density" in gate.message
    assert {"importance.khat", "importance.evidence"} <= {one.id for one in found.not_checked}
    doubt = found.findings[0].doubt
    assert doubt
    assert finding_from(found.findings[0].to_dataset()).doubt == doubt


@pytest.mark.parametrize("parameters", [1, 2, 5])
def test_weights_of_the_draws_own_density(parameters: int) -> None:
    found = judged(Exact, parameters)
    assert found.verdict.outcome is Outcome.PASS
    assert found["importance.ess"].statistic == pytest.approx(1.0)


def shaped(name: str, rng: np.random.Generator, size: tuple[int, ...]) -> tuple[Any, Any]:
    """Draws of a shape that people have, and their log density."""
    if name == "heavy tails":
        draws = rng.standard_t(3, size)
        return draws, stats.t.logpdf(draws, 3).sum(axis=-1)
    if name == "a spike":
        width = np.where(rng.random(size) < 0.5, 1.0, 0.01)
        draws = rng.normal(size=size) * width
        halves = [stats.norm.logpdf(draws, scale=scale) for scale in (1.0, 0.01)]
        return draws, (np.logaddexp(*halves) - np.log(2)).sum(axis=-1)
    if name == "an edge":
        draws = rng.exponential(size=size)
        return draws, -draws.sum(axis=-1)
    draws = rng.normal(size=size)
    density = stats.norm.logpdf(draws).sum(axis=-1)
    if name == "a banana":
        draws[..., 1] = 0.1 * draws[..., 1] + draws[..., 0] ** 2
        density = density - np.log(0.1)
    return draws, density


@pytest.mark.parametrize("name", ["a Gaussian", "heavy tails", "a spike", "an edge", "a banana"])
def test_no_shape_lacks_density_at_its_own_draws(name: str) -> None:
    """Means over 200 trials, of exact densities, of which none may come near the limit of 0.7 nat."""
    for number in (100, 500):
        lacking = lacking_density(*shaped(name, np.random.default_rng(5), (200, number, 2)))
        assert lacking.mean() < 0.05


def test_ratios_that_cannot_be_relied_on_confirm_nothing() -> None:
    """Spikes in ten parameters: an exact density, of which so few draws do not tell."""
    rng = np.random.default_rng(5)
    draws, log_q = shaped("a spike", rng, (200, 500, 10))
    truth, _ = shaped("a spike", rng, (200, 1, 10))
    trials = make_trials(truth[:, 0], draws, log_q=log_q)
    kept = np.ones(200, dtype=bool)
    assert "not to be relied on" in unconfirmed(Prepared(trials_tree(trials), 1), trials, kept)
    few = trials.isel(draw=slice(0, 40))
    assert "it takes 128 draws" in unconfirmed(Prepared(trials_tree(few), 1), few, kept)
