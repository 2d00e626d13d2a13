"""What an estimator is called with, and what it remembers."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest

import gaugeblock as gb
from gaugeblock.auditing.estimator_from import LibraryEstimator
from gaugeblock.validate import make_policy

SMALL = {"trials": 400, "draws": 60, "progress": False}
# What fails most broken estimators, which is when an audit diagnoses.
QUICK = {"validators": ("draws", "sbc")}
# What fails draws that do not know their data.
SEEN = {"validators": ("draws", "local")}
PRIOR = gb.Prior({"a": gb.Normal(0.0, 1.0), "b": gb.Normal(2.0, 1.0)})


def simulate(theta, rng):
    return theta + 0.5 * rng.normal(size=theta.shape)


def right(x, n, rng):
    mean = (np.asarray(x) / 0.25 + [0.0, 2.0]) / 5
    return mean[:, None] + np.sqrt(0.2) * rng.standard_normal((len(x), n, 2))


CALLS = {
    "x_scale": lambda x, n, rng: right(np.asarray(x) / 37, n, rng),
    # Between two of those that are tried, as the scale is.
    "x_shift": lambda x, n, rng: right(np.asarray(x) - 3.4 * np.std(x), n, rng),
    "x_order": lambda x, n, rng: right(np.asarray(x)[:, ::-1], n, rng),
}


@cache
def audited(symptom):
    return gb.audit(CALLS[symptom], simulate, prior=PRIOR, **SMALL, **QUICK)


@pytest.mark.parametrize("symptom", CALLS)
def test_how_the_estimator_should_be_called_is_found_by_calling_it(symptom):
    result = audited(symptom)
    said = result.verdict.diagnosis
    assert result.outcome == "FAIL"
    # Another zero of the data moves normal posteriors as another zero of the draws does.
    equal = {"x_shift": {"x_shift", "shift"}}.get(symptom, {symptom})
    assert equal & {said["named"], *said["indistinguishable"]}
    assert [*said["trials_to_tell"]] == said["indistinguishable"]
    for other, trials in said["trials_to_tell"].items():
        would = "nor would a hundred times as many" if trials is None else f"some {trials:,} would"
        assert f"{other} ({would})" in said["text"]
    assert said["called"]


def test_a_chain_is_a_chain_and_knows_nothing():
    """Of which audits keep every so many-th draw, so that few are left to look at."""

    def chain(x, n, rng):
        z = rng.standard_normal((len(x), n, 2))
        for step in range(1, n):
            z[:, step] = 0.97 * z[:, step - 1] + np.sqrt(1 - 0.97**2) * z[:, step]
        return (np.asarray(x) / 0.25 + [0.0, 2.0])[:, None] / 5 + np.sqrt(0.2) * z

    result = gb.audit(chain, simulate, prior=PRIOR, trials=300, draws=100, progress=False, **QUICK)
    found = result.verdict.diagnosis
    assert found["called"]
    assert found["named_all"] == ["autocorrelated"]
    assert "100 are worth" in found["text"]


def test_the_same_numbers_are_no_chain_where_values_are_few():
    prior = gb.Prior({"a": gb.Discrete((0.0, 1.0, 2.0, 3.0), (0.1, 0.4, 0.3, 0.2))})

    def seeded(x, n, rng):
        values = np.arange(4)
        log = np.log([0.1, 0.4, 0.3, 0.2]) - 0.5 * ((np.asarray(x) - values) / 0.7) ** 2
        share = np.cumsum(np.exp(log - log.max(axis=1, keepdims=True)), axis=1)
        u = np.random.default_rng(7).random(n)
        return (u[None, :, None] > (share / share[:, -1:])[:, None]).sum(axis=2)[..., None].astype(float)

    result = gb.audit(
        seeded,
        lambda t, r: t + 0.7 * r.normal(size=t.shape),
        prior=prior,
        trials=300,
        draws=100,
        progress=False,
        **QUICK,
    )
    assert result.diagnose().named == "fixed_seed"


def test_draws_alone_do_not_show_how_the_estimator_is_called():
    found = audited("x_scale").diagnose()
    assert not found.called
    assert found.named != "x_scale"


class Remembers:
    """Gives draws around the truths it was told of, and honest ones for anything else."""

    def __init__(self):
        self.truths = {}

    def sample(self, x, n, rng):
        rows = [self.truths.pop(np.asarray(row).tobytes(), None) for row in x]
        found = right(x, n, rng)
        for row, truth in enumerate(rows):
            if truth is not None:
                found[row] = truth + 0.1 * (found[row] - found[row].mean(axis=0) + 0.4 * rng.normal(size=2))
        return found


def test_an_estimator_that_knows_the_truths_gives_itself_away_when_it_is_asked_again():
    knowing = Remembers()

    def leaking(theta, rng):
        x = simulate(theta, rng)
        knowing.truths.update({row.tobytes(): truth for row, truth in zip(x, theta, strict=True)})
        return x

    said = gb.audit(knowing, leaking, prior=PRIOR, **SMALL, **QUICK).verdict.diagnosis
    assert said["named"] == "knows_truth"


def test_the_diagnosis_stands_in_every_output_and_is_derived_again(tmp_path, capsys, monkeypatch):
    from gaugeblock.auditing.verify import verify
    from gaugeblock.cli.commands import main

    rng = np.random.default_rng(3)
    theta = PRIOR.sample(300, rng)
    x = simulate(theta, rng)
    draws = right(x, 60, rng)[..., ::-1]
    out, names = tmp_path / "out", ["a", "b"]
    result = gb.audit_draws(theta, draws, x=x, names=names, out=out, progress=False, **QUICK)
    content = json.loads((tmp_path / "out" / "verdict.json").read_text())["diagnosis"]
    assert content["named"] == "columns"
    assert set(content) >= {"named", "indistinguishable", "causes", "parameters", "gap", "text"}
    assert set(content["gap"]) == {"before", "after"}
    assert content["gap"]["after"] < 0.1 * content["gap"]["before"]
    assert all(set(each) == {"value", "low", "high"} for each in content["parameters"].values())
    assert "a is in the column of b" in content["text"]
    for name in ("summary.md", "report.html"):
        assert "is in the column of" in (tmp_path / "out" / name).read_text()
    assert result.diagnose().to_json() == content
    assert verify(tmp_path / "out").differences == ()
    before = (tmp_path / "out" / "verdict.json").read_bytes()
    monkeypatch.setattr("sys.argv", ["gaugeblock", "diagnose", str(tmp_path / "out")])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (0, None)
    assert "is in the column of" in capsys.readouterr().out
    assert (tmp_path / "out" / "verdict.json").read_bytes() == before


def test_a_pass_has_none_until_it_is_asked_for(tmp_path):
    policy = make_policy({"required": ["sbc"], "tolerance": {"bias": 0.2, "log_width": 0.2}}, source="test")
    result = gb.audit(right, simulate, prior=PRIOR, policy=policy, out=tmp_path, **SMALL, **QUICK)
    assert result.outcome == "PASS"
    assert result.verdict.diagnosis is None
    assert result.diagnose().named is None


def test_too_few_trials_say_so():
    rng = np.random.default_rng(3)
    theta = PRIOR.sample(60, rng)
    found = gb.audit_draws(theta, right(simulate(theta, rng), 40, rng) + 5, names=["a", "b"], progress=False)
    assert found.outcome == "FAIL"
    assert "150 are needed" in found.diagnose().text


def test_an_estimator_that_refuses_other_data_is_no_error():
    def strict(x, n, rng):
        if np.abs(x).max() > 20:
            raise ValueError("these are no data of mine")
        return right(x, n, rng) + 1.0

    said = gb.audit(strict, simulate, prior=PRIOR, **SMALL, **QUICK).verdict.diagnosis
    assert "shift" in (said["named"], *said["indistinguishable"])


def test_data_that_nobody_scaled_are_said_to_be_where_draws_ignore_them():
    def prior_itself(x, n, rng):
        return PRIOR.sample(len(x) * n, rng).reshape(len(x), n, 2)

    for factor, said in ((1e5, True), (1.0, False), (1e-3, True)):
        result = gb.audit(
            prior_itself, lambda t, r, f=factor: simulate(t, r) * f, prior=PRIOR, **SMALL, **SEEN
        )
        found = result.verdict.diagnosis
        assert found["named"] == "ignored_parameter"
        assert ("x is not scaled: its standard deviations are" in found["text"]) is said
        assert "Mended" not in found["text"]
        assert found["repair"] == []


def test_a_sampler_that_rejects_for_ever_is_given_seconds_only_where_data_are_tried_on_it():
    class Model:
        patience = 600.0

        def describe(self):
            return {"library": "none"}

        def sample(self, x, n, seed):
            seen.append(self.patience)
            return np.zeros((len(x), n, 2))

    seen, model = [], Model()
    estimator = LibraryEstimator(model)
    estimator.sample_briefly(np.zeros((2, 2)), 3, np.random.default_rng(1))
    estimator.sample(np.zeros((2, 2)), 3, np.random.default_rng(1))
    assert seen[0] <= 10
    assert seen[1] == 600.0


def test_information_that_no_repair_finds_has_causes_all_the_same():
    """Only the sign of the data reaches the estimator: exact given that, and far from what they say."""

    def coarse(x, n, rng):
        # Truths whose data have the same signs, drawn anew: the posterior given the signs alone.
        theta = PRIOR.sample(200 * n, rng)
        sign = simulate(theta, rng) > [0, 2]
        mine = np.asarray(x) / 100 > [0, 2]
        return np.stack([rng.choice(theta[(sign == row).all(axis=1)], n) for row in mine])

    result = gb.audit(coarse, lambda t, r: 100 * simulate(t, r), prior=PRIOR, **SMALL, **SEEN)
    found = result.verdict.diagnosis
    assert found["named"] == "other"
    assert "what the data say beyond the draws" in found["text"]
    assert found["causes"][0]["cause"].startswith("x is not scaled")
    assert any("embedding" in each["cause"] for each in found["causes"])
