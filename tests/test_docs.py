"""What is measured is described, and what is described is measured."""

import re
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import pytest

from gaugeblock.validate import VALIDATORS, make_trials, run_validators, trials_tree

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def said():
    """Ids without their brackets, of everything that a full set of trials lets the default validators say."""
    rng = np.random.default_rng(1)
    theta = rng.normal(size=(400, 2))
    x = theta + rng.normal(size=theta.shape)
    draws = x[:, None] / 2 + np.sqrt(0.5) * rng.normal(size=(400, 60, 2))

    def normal(value, sd):
        return (-0.5 * (value / sd) ** 2 - np.log(sd) - 0.5 * np.log(2 * np.pi)).sum(axis=-1)

    full = make_trials(
        theta, draws, ["a", "b"], x=x,
        log_q=normal(draws - x[:, None] / 2, np.sqrt(0.5)), log_q_true=normal(theta - x / 2, np.sqrt(0.5)),
        log_likelihood=normal(draws - x[:, None], 1.0), log_likelihood_true=normal(theta - x, 1.0),
        log_prior=normal(draws, 1.0),
    )  # fmt: skip
    full["quantity_first"] = full["draws"].isel(parameter=0, drop=True)
    full["quantity_first_true"] = full["theta_true"].isel(parameter=0, drop=True)
    findings, not_checked = run_validators(trials_tree(full), seed=1)
    return {item.id.partition("[")[0] for item in (*findings, *not_checked)}


def test_every_finding_is_described(said):
    text = (ROOT / "docs" / "validators.md").read_text(encoding="utf-8")
    named = re.findall(r"`([a-z0-9_]+\.[a-z_*]+)(?:\[\w+\])?`", text)
    missing = {item for item in said if not any(fnmatch(item, pattern) for pattern in named)}
    assert not missing


def test_every_validator_has_its_word(said):
    assert {name for name, validator in VALIDATORS.items() if validator.by_default} == {
        item.partition(".")[0] for item in said
    }


@pytest.mark.parametrize("needs", ["", "torch"])
def test_the_page_on_priors_runs(needs):
    """Its blocks, one after the other; those marked torch after all others, where torch and sbi are."""
    text = (ROOT / "docs" / "priors.md").read_text(encoding="utf-8")
    names = {}
    for kind, block in re.findall(r"```python ?(\w*)\n(.*?)```", text, flags=re.DOTALL):
        if kind:
            pytest.importorskip("sbi") if needs else None
        if not kind or needs:
            exec(compile(block, "docs/priors.md", "exec"), names)


def test_the_page_on_priors_names_every_distribution():
    from gaugeblock.simulators.prior import _DISTRIBUTIONS

    text = (ROOT / "docs" / "priors.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in text for name in _DISTRIBUTIONS if name != "scipy")


def test_the_page_on_results_runs():
    text = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
    for block in re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL):
        exec(compile(block, "docs/results.md", "exec"), {})
