"""Posterior model probabilities as an audit: gates, diagnosis, files."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import special, stats

import gaugeblock as gb
from gaugeblock.auditing.model_choice import DRAWS
from gaugeblock.auditing.verify import verify

NAMES = ["narrow", "wide"]


@pytest.fixture(scope="module")
def made():
    """Two simulators, noise of sd 1 or 1.5, with even odds: data, the truth, and exact log odds."""
    rng = np.random.default_rng(1)
    true = rng.integers(0, 2, 10_000)
    x = rng.normal(size=(10_000, 3)) * np.where(true, 1.5, 1.0)[:, None]
    return x, true, np.stack([stats.norm.logpdf(x, scale=sd).sum(axis=1) for sd in (1.0, 1.5)], axis=1)


def audited(made, change=lambda logs: logs, **options):
    x, true, logs = made
    return gb.audit_models(special.softmax(change(logs), axis=1), true, names=NAMES, x=x, **options)


def test_exact_probabilities_pass_and_the_data_were_asked(made):
    result = audited(made)
    assert result.outcome == "PASS"
    assert {gate.id for gate in result.verdict.gates if gate.required} == {
        *("draws.finite", "informed.rank", "models.confidence"),
        *(f"models.reliability[{name}]" for name in NAMES),
    }
    assert "On the data" in repr(result)


@pytest.mark.parametrize(
    ("named", "change"),
    [
        ("too_flat", lambda logs: logs / 2),
        ("too_sharp", lambda logs: logs * 2),
        ("prior_odds", lambda logs: logs + [0.0, 0.8]),
    ],
)
def test_what_is_wrong_is_named(made, named, change):
    result = audited(made, change)
    assert result.outcome == "FAIL"
    assert result.verdict.diagnosis["named"] == named
    (size,) = result.verdict.diagnosis["parameters"].values()
    assert size["low"] < size["value"] < size["high"]
    wanted = {"too_flat": 2.0, "too_sharp": 0.5}.get(named)
    # 90% intervals, whose errors are of 10,000 trials: three of these errors are 1.8 times the interval.
    assert wanted is None or abs(size["value"] - wanted) < 1.8 * (size["high"] - size["value"])
    assert result.verdict.diagnosis["causes"]
    message = result["models.reliability[wide]"].message
    assert "wide: given" in message
    assert f"tolerated {result['models.confidence'].tolerance:g}" in message


def test_nothing_is_named_where_nothing_is_wrong(made):
    assert audited(made).diagnose().named is None


def test_probabilities_that_ignore_the_data_are_found_out(made):
    """The prior odds are reliable: only a challenger that looks at the data tells."""
    result = audited(made, np.zeros_like)
    assert result["models.reliability[wide]"].outcome == "PASS"
    assert result["informed.rank"].outcome == result.outcome == "FAIL"


def test_probabilities_that_are_not_finite_count_against_the_estimator(made):
    _, true, logs = made
    probability = special.softmax(logs, axis=1)
    probability[3] = np.nan
    result = gb.audit_models(probability, true)
    assert result["draws.finite"].outcome == "FAIL"
    assert result["draws.finite"].statistic == DRAWS
    assert result["models.confidence"].n_trials == 9999


def test_the_draws_are_of_the_probabilities():
    probability = np.repeat([[0.2, 0.5, 0.3], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], 400, axis=0)
    draws = gb.audit_models(probability, np.zeros(1200, dtype=int)).trials["draws"].values[..., 0]
    share = np.array([(draws[:400] == k).mean() for k in range(3)])
    # Four standard errors of 40,000 draws.
    np.testing.assert_allclose(share, [0.2, 0.5, 0.3], atol=4 * 0.0025)
    assert (draws[400:800] == 0).all()
    assert (draws[800:] == 2).all()


def test_an_audit_of_models_is_kept_and_verified(made, tmp_path):
    _, true, logs = made
    names = np.array(NAMES)[true]
    probability = special.softmax(logs / 2, axis=1)
    result = gb.audit_models(probability, names, names=NAMES, seed=3, policy="strict", out=tmp_path)
    content = json.loads((tmp_path / "verdict.json").read_text())
    assert content["verdict"] == "FAIL"
    assert content["diagnosis"]["named"] == "too_flat"
    assert result["models.confidence"].tolerance == 0.03
    assert verify(tmp_path).differences == ()
    kept = gb.read_trials(tmp_path / "trials.nc")
    assert kept["model_probability"]["model"].values.tolist() == NAMES
    np.testing.assert_array_equal(kept["theta_true"].values[:, 0], true)
    assert gb.judge(tmp_path, {"required": ["models"], "tolerance": {"models": 0.3}}).outcome == "PASS"


def test_tables_name_the_models():
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame({"b": [0.9, 0.2, 0.7], "a": [0.1, 0.8, 0.3]})
    true = pandas.Series(["b", "a", "a"])
    found = gb.audit_models(table, true)
    assert found.trials["model_probability"]["model"].values.tolist() == ["b", "a"]
    np.testing.assert_array_equal(found.trials["theta_true"].values[:, 0], [0, 1, 1])
    called = gb.audit_models(table, true.map({"a": "x", "b": "y"}), names=np.array(["y", "x"]))
    np.testing.assert_array_equal(called.trials["theta_true"], found.trials["theta_true"])


def test_what_does_not_fit_together_is_refused():
    even = np.full((4, 2), 0.5)
    with pytest.raises(gb.InputError, match=r"model_true has shape \(3,\); .* each of 4 trials"):
        gb.audit_models(even, [0, 1, 0])
    with pytest.raises(gb.InputError, match="model_true names c; the models are a, b"):
        gb.audit_models(even, ["a", "b", "c", "a"], names=["a", "b"])
    with pytest.raises(gb.InputError, match="whole number from 0 to 1"):
        gb.audit_models(even, [0, 1, 2, 0])
