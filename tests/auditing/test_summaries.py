"""Summaries of one's own: what raw data hide from challengers, a function of the data shows them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from typer.testing import CliRunner

import gaugeblock as gb
from gaugeblock.auditing.audit import audit_configured
from gaugeblock.auditing.config import read_config
from gaugeblock.auditing.result import Audit
from gaugeblock.auditing.verify import verify
from gaugeblock.cli import app
from gaugeblock.core.errors import InputError
from gaugeblock.validate import make_trials, summaries
from gaugeblock.validate.trials import read_trials, write_trials

PRIOR = [stats.norm()]
SMALL = {"number": 40, "draws": 20, "block": 20, "seed": 7}


def simulate(theta: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Twelve signs; the sign of theta is the product of the first five, so that fewer of them say nothing."""
    sign = rng.choice([-1.0, 1.0], size=(len(theta), 12))
    sign[:, 4] = np.sign(theta[:, 0]) * sign[:, :4].prod(axis=1)
    return sign


def product(x: np.ndarray) -> np.ndarray:
    return x[:, :5].prod(axis=1)


def other(x: np.ndarray) -> np.ndarray:
    return x[:, :2]


def the_prior(x: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    return rng.normal(size=(len(x), n, 1))


def exact(x: np.ndarray, n: int, rng: np.random.Generator) -> np.ndarray:
    return np.abs(rng.normal(size=(len(x), n, 1))) * product(x)[:, None, None]


def audited(estimator: Any = the_prior, out: Path | None = None, **options: Any) -> Audit:
    options = {"trials": SMALL, "validators": ("sbc", "coverage"), "progress": False, **options}
    return gb.audit(estimator, simulate, prior=PRIOR, names=["a"], out=out, **options)


def said(audit: Audit) -> str:
    return next(gate.message for gate in audit.verdict.gates if gate.id == "informed.rank")


def informed(estimator: Any, **options: Any) -> str:
    options = {"trials": {"number": 1000, "draws": 50, "seed": 1}, "validators": ("informed",), **options}
    found = audited(estimator, policy={"required": ["informed.rank"]}, **options)
    return f"{found.outcome.value} {said(found)}"


def test_a_summary_shows_what_the_values_of_x_hide() -> None:
    assert not informed(the_prior).startswith("FAIL")
    seen = informed(the_prior, summaries=product)
    assert seen.startswith("FAIL")
    assert "summary_1" in seen
    assert not informed(exact, summaries=product).startswith("FAIL")


def test_draws_in_hand_take_them_too() -> None:
    rng = np.random.default_rng(0)
    theta = rng.normal(size=(1000, 1))
    x = simulate(theta, rng)
    options: dict[str, Any] = {
        "validators": ("informed",),
        "policy": {"required": ["informed.rank"]},
        "progress": False,
    }
    outcomes = []
    for function in (None, product, lambda x: pd.DataFrame({"together": product(x)})):
        found = gb.audit_draws(theta, the_prior(x, 50, rng), x=x, summaries=function, **options)
        outcomes.append(found)
    assert outcomes[0].outcome.value != "FAIL"
    assert [found.outcome.value for found in outcomes[1:]] == ["FAIL", "FAIL"]
    assert "summary_together" in said(outcomes[2])
    np.testing.assert_array_equal(outcomes[1].trials["summary_1"], product(x))
    assert "summary_1" not in outcomes[0].trials


def test_trials_keep_them_and_so_an_audit_can_be_verified(tmp_path: Path) -> None:
    found = audited(out=tmp_path, summaries=product, trials={**SMALL, "number": 300}, validators=("local",))
    np.testing.assert_array_equal(found.trials["summary_1"], product(found.trials["x"].values))
    assert verify(tmp_path).differences == ()
    said = json.loads((tmp_path / "verdict.json").read_text())["provenance"]["trials"]["summaries"]
    assert said["class"] == "product"
    assert len(said["source_sha256"]) == 64


def test_an_enlarged_audit_has_them_of_all_its_trials(tmp_path: Path) -> None:
    audited(out=tmp_path, summaries=product)
    grown = audited(out=tmp_path, summaries=product, trials={**SMALL, "number": 60})
    assert grown.verdict.looks.trials == (40, 60)
    fresh = audited(trials={**SMALL, "number": 60}, summaries=product)
    np.testing.assert_array_equal(grown.trials["x"], fresh.trials["x"])
    np.testing.assert_array_equal(grown.trials["summary_1"], fresh.trials["summary_1"])


def test_other_summaries_are_another_look_at_the_same_trials(tmp_path: Path) -> None:
    first = audited(out=tmp_path, summaries=product)
    assert audited(out=tmp_path, summaries=product).verdict.looks.trials == (40,)
    second = audited(out=tmp_path, summaries=other)
    assert second.verdict.looks.trials == (40, 40)
    np.testing.assert_array_equal(first.trials["draws"], second.trials["draws"])
    assert [str(name) for name in second.trials.data_vars if "summary" in str(name)] == [
        "summary_1",
        "summary_2",
    ]
    without = audited(out=tmp_path)
    assert without.verdict.looks.trials == (40, 40, 40)
    assert "summary_1" not in without.trials


def test_what_cannot_be_told_from_another_is_another_look(tmp_path: Path) -> None:
    sign = 1.0
    for looks in ((40,), (40, 40)):
        again = audited(out=tmp_path, summaries=lambda x: sign * product(x))
        assert again.verdict.looks.trials == looks


class Embedding:
    """A thing with weights, as a flow has."""

    def __init__(self, weight: float):
        self.weight = weight

    def embed(self, x: np.ndarray) -> np.ndarray:
        return self.weight * product(x)

    __call__ = embed


@pytest.mark.parametrize("bound", [False, True])
def test_an_embedding_is_known_by_its_weights(tmp_path: Path, bound: bool) -> None:
    looks = []
    for weight in (1.0, 1.0, 2.0):
        of = Embedding(weight)
        looks.append(audited(out=tmp_path, summaries=of.embed if bound else of).verdict.looks.number)
    assert looks == [1, 1, 2]


@pytest.mark.parametrize(
    ("function", "words"),
    [
        (lambda x: x[:3], r"summaries: gave shape \(3, 12\) for 40 data sets; it must give finite numbers"),
        (lambda x: x / 0.0, "it must give finite numbers"),
        (lambda x: x.nothing, "summaries failed on data of shape"),
        (lambda x: np.tile(x, (1, 6)), "summaries: 72 numbers of each data set; give at most 64"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_what_cannot_be_used_is_one_line(function: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        audited(summaries=function)


def test_large_data_are_read_some_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def product_of_some(x: np.ndarray) -> np.ndarray:
        asked.append(len(x))
        return product(x)

    monkeypatch.setattr(summaries, "block_length", lambda values: 15 if values == 12 else 1)
    found = audited(summaries=product_of_some)
    assert asked == [15, 15, 10]
    np.testing.assert_array_equal(found.trials["summary_1"], product(found.trials["x"].values))


def test_sixty_four_are_taken() -> None:
    assert "summary_64" in audited(summaries=lambda x: np.tile(x, (1, 6))[:, :64]).trials


def test_they_need_data_and_an_audit_that_is_no_anytime_one() -> None:
    with pytest.raises(InputError, match="summaries: are made of the data of each trial; give these as x"):
        gb.audit_draws(np.zeros((10, 1)), np.zeros((10, 5, 1)), summaries=product)
    with pytest.raises(InputError, match="summaries: are no part of an anytime audit"):
        audited(summaries=product, anytime=True)


MODULE = """
import numpy as np

def product(x):
    return x[:, :5].prod(axis=1)

nothing = 3
"""


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A module of a user's, in the working directory, and a configuration that names it."""
    (tmp_path / "their_summaries.py").write_text(MODULE)
    config = tmp_path / "audit.toml"
    config.write_text(
        'summaries = "their_summaries:product"\nvalidators = ["sbc"]\n'
        '[simulator]\nname = "linear_gaussian"\n[estimator]\nname = "exact"\n'
        "[trials]\nnumber = 40\ndraws = 20\nimportance_number = 0\njoint_number = 0\n"
    )
    monkeypatch.chdir(tmp_path)
    return config


def test_a_configuration_names_a_function(mine: Path) -> None:
    found = audit_configured(read_config(mine, allow_modules=["their_summaries"]), progress=False)
    np.testing.assert_array_equal(found.trials["summary_1"], product(found.trials["x"].values))
    with pytest.raises(InputError, match="their_summaries"):
        audit_configured(read_config(mine), progress=False)
    with pytest.raises(InputError, match="summaries: int cannot be called; give a function of the data"):
        audited(summaries="their_summaries:nothing")


def test_a_command_summarises_draws_from_disk(mine: Path) -> None:
    rng = np.random.default_rng(3)
    theta = rng.normal(size=(40, 1))
    write_trials(make_trials(theta, rng.normal(size=(40, 20, 1)), x=simulate(theta, rng)), "t.nc")
    config = mine.parent / "draws.toml"
    config.write_text('summaries = "their_summaries:product"\nvalidators = ["sbc"]\n')
    words = ["audit", str(config), "--trials", "t.nc", "--out", "there"]
    assert "their_summaries" in str(CliRunner().invoke(app, words).exception)
    assert not Path("there/trials.nc").exists()
    CliRunner().invoke(app, [*words, "--allow-module", "their_summaries"])
    kept = read_trials("there/trials.nc")
    np.testing.assert_array_equal(kept["summary_1"], product(kept["x"].values))


def test_a_ledger_counts_other_summaries(tmp_path: Path) -> None:
    """In folders of their own, so that the ledger alone knows."""
    options: dict[str, Any] = {"ledger": tmp_path / "ledger.json"}
    audited(out=tmp_path / "a", summaries=product, **options)
    assert audited(out=tmp_path / "b", summaries=other, **options).verdict.looks.number == 2
    # Known by chance alone, and entered once.
    sign = 1.0
    third = audited(out=tmp_path / "c", summaries=lambda x: sign * product(x), **options)
    assert third.verdict.looks.number == 3
