from __future__ import annotations

from dataclasses import replace
from urllib.parse import unquote

import numpy as np
import pytest
import xarray as xr

from gaugeblock.core.errors import InputError
from gaugeblock.validate import (
    VALIDATORS,
    Finding,
    NotChecked,
    read_findings,
    run_validators,
    trials_tree,
    validators,
    write_findings,
)
from gaugeblock.validate.finding import MeanFinding
from gaugeblock.validate.validators import Validator


def assert_same(first: tuple[Finding, ...], second: tuple[Finding, ...]) -> None:
    assert [finding.id for finding in first] == [finding.id for finding in second]
    for one, other in zip(first, second, strict=True):
        xr.testing.assert_identical(one.to_dataset(), other.to_dataset())
        xr.testing.assert_identical(one.details, other.details)
        assert one == other


@pytest.fixture(scope="module")
def tree(gaussian_trials):
    return trials_tree(gaussian_trials(300, 60, 2, seed=1), gaussian_trials(40, 120, 2, seed=2, ratio=1.2))


def test_every_finding_says_what_it_is(tree):
    findings, not_checked = run_validators(tree, seed=3)
    unchecked = {item.id.split(".")[0] for item in not_checked}
    ran = {finding.validator for finding in findings}
    assert ran | unchecked == {name for name, validator in VALIDATORS.items() if validator.by_default}
    assert not unchecked & {"draws", "sbc", "coverage", "importance", "local", "conformal"}
    assert len({finding.id for finding in findings}) == len(findings)
    for finding in findings:
        assert finding.claim
        assert finding.null
        assert finding.reference
        assert finding.estimate.shape == finding.standard_error.shape == (len(finding.components),)
        if isinstance(finding, MeanFinding):
            assert finding.influence.shape[0] == len(finding.components)
    ids = {finding.id for finding in findings}
    assert {"draws.finite", "sbc.bias[p0]", "sbc.log_width[p1]", "sbc.uniform[p0]"} <= ids
    assert {"coverage.central", "coverage.deviation", "importance.ess", "importance.khat"} <= ids
    population = {finding.id: finding.population for finding in findings}
    assert population["importance.ess"] == "importance"
    assert population["coverage.central"] == "trials"


def test_the_same_seed_gives_the_same_bits_and_another_does_not(tree):
    first, second, other = (run_validators(tree, seed=seed)[0] for seed in (3, 3, 4))
    assert_same(first, second)
    pits = [next(f for f in found if f.id == "sbc.uniform[p0]").details["pit"] for found in (first, other)]
    assert not np.array_equal(*pits)


def test_the_order_of_trials_does_not_matter(tree, gaussian_trials):
    trials = gaussian_trials(200, 30, 2, seed=5)
    shuffled = trials.isel(trial=np.random.default_rng(6).permutation(200))
    for one, other in zip(*(run_validators(t, seed=7)[0] for t in (trials, shuffled)), strict=True):
        np.testing.assert_allclose(one.estimate, other.estimate, rtol=1e-9, atol=1e-12)
        for name in one.details.data_vars:
            if "trial" in one.details[name].dims:
                xr.testing.assert_identical(one.details[name], other.details[name].sortby("trial"))


def test_findings_survive_the_disk_exactly(tree, tmp_path):
    findings, _ = run_validators(tree, seed=3)
    not_checked = (NotChecked("importance.ess", "needs log_q"),)
    path = write_findings(findings, not_checked, tmp_path / "findings.nc")
    again, unchecked = read_findings(path)
    assert_same(findings, again)
    assert unchecked == not_checked
    # Equal as values too, and of the same classes.
    assert again == findings
    with xr.open_datatree(path) as opened:
        assert opened.attrs["schema_version"] == 2
        assert {unquote(name) for name in opened.children} == {finding.id for finding in findings}


def test_ids_that_no_netcdf_name_may_hold_survive_the_disk(tree, tmp_path):
    finding = run_validators(tree, seed=3, select=["draws"])[0][0]
    names = ["a/b", " a ", "a\u2028b", "..", "é" * 200, "x" * 400 + "1", "x" * 400 + "2", "%2F", "/"]
    findings = tuple(replace(finding, id=f"sbc.bias[{name}]") for name in names)
    again, _ = read_findings(write_findings(findings, (), tmp_path / "findings.nc"))
    assert [f.id for f in again] == [f.id for f in findings]


def test_findings_file_that_is_none(tree, tmp_path):
    tree.to_dataset().to_netcdf(tmp_path / "t.nc", engine="netcdf4")
    with pytest.raises(InputError, match="holds no findings"):
        read_findings(tmp_path / "t.nc")
    (tmp_path / "bad.nc").write_bytes(b"\x89HDF\r\n\x1a\n1234")
    with pytest.raises(InputError, match="not read here"):
        read_findings(tmp_path / "bad.nc")
    with pytest.raises(InputError, match="no such file"):
        read_findings(tmp_path / "missing.nc")


@pytest.mark.parametrize("missing", [["log_q"], ["log_prior"], ["log_q", "log_likelihood", "log_prior"]])
def test_what_could_not_be_checked_is_listed_with_the_reason(gaussian_trials, missing):
    trials = gaussian_trials(50, 30, 2, seed=8).drop_vars(missing)
    findings, not_checked = run_validators(trials, seed=1, select=["draws", "sbc", "coverage", "importance"])
    assert {item.id for item in not_checked} == {"importance.ess", "importance.khat", "importance.evidence"}
    assert all(item.why.endswith("lack " + ", ".join(missing)) for item in not_checked)
    assert not any(finding.id.startswith("importance") for finding in findings)


def test_validators_can_be_selected(tree):
    findings, _ = run_validators(tree, seed=1, select=["coverage"])
    assert {finding.validator for finding in findings} == {"coverage"}
    with pytest.raises(InputError, match="unknown validator sbcc; there are draws, sbc"):
        run_validators(tree, seed=1, select=["sbcc"])


def test_nan_draws_are_counted_and_the_others_run_without_those_trials(gaussian_trials):
    trials = gaussian_trials(200, 60, 2, seed=9)
    draws, log_q = trials["draws"].values.copy(), trials["log_q"].values.copy()
    draws[3, 4, 1], draws[3, 5, 0], draws[7, :, 0], log_q[9, 1] = np.nan, np.inf, -np.inf, np.nan
    broken = trials.assign(draws=(trials["draws"].dims, draws), log_q=(trials["log_q"].dims, log_q))
    findings = {finding.id: finding for finding in run_validators(broken, seed=1)[0]}
    count = findings["draws.finite"]
    assert dict(zip(count.components, count.estimate, strict=True)) == {"draws": 62.0, "log_q": 1.0}
    assert count.caveats == ("in 3 of 200 trials: 3, 7, 9",)
    assert findings["sbc.bias[p0]"].n_trials == findings["coverage.central"].n_trials == 198
    assert findings["importance.ess"].n_trials == 197
    assert "2 of 200 trials have NaN or infinite draws" in findings["sbc.bias[p0]"].caveats[0]
    whole = {f.id: f for f in run_validators(trials.isel(trial=np.delete(np.arange(200), [3, 7])), seed=1)[0]}
    np.testing.assert_array_equal(findings["coverage.central"].estimate, whole["coverage.central"].estimate)


def test_nothing_but_nan_draws(gaussian_trials):
    trials = gaussian_trials(20, 30, 2, seed=10)
    trials = trials.assign(draws=trials["draws"] * np.nan)
    findings, not_checked = run_validators(trials, seed=1)
    assert [finding.id for finding in findings] == ["draws.finite"]
    assert findings[0].estimate.tolist() == [600.0, 0.0]
    assert {item.id for item in not_checked} >= {"sbc.bias", "coverage.central", "importance.ess"}


def test_weights_that_could_not_be_computed_are_said(gaussian_trials):
    trials = gaussian_trials(20, 60, 1, seed=11)
    likelihood = trials["log_likelihood"].values.copy()
    likelihood[2, 3], likelihood[4, 5] = np.nan, -np.inf
    trials = trials.assign(log_likelihood=(("trial", "draw"), likelihood))
    ess = next(f for f in run_validators(trials, seed=1)[0] if f.id == "importance.ess")
    assert ess.values[0, 2] == 0
    assert ess.values[0, 4] == pytest.approx(59 / 60)
    assert "in 1 trial(s) a weight could not be computed" in ess.caveats[0]


def test_a_handful_of_trials_and_draws(gaussian_trials):
    for n, draws in ((1, 2), (2, 2), (3, 5)):
        findings, not_checked = run_validators(gaussian_trials(n, draws, 2, seed=12), seed=1)
        assert all(np.isfinite(finding.estimate).all() for finding in findings)
        assert ("sbc.bias" in {item.id for item in not_checked}) == (n == 1)


def test_a_broken_estimator_shows_where_it_is_broken(gaussian_trials):
    trials = gaussian_trials(2000, 100, 2, seed=13, ratio=0.8, bias=0.3, density=False)
    findings = {finding.id: finding for finding in run_validators(trials, seed=1)[0]}
    for name in ("p0", "p1"):
        width, shift = findings[f"sbc.log_width[{name}]"], findings[f"sbc.bias[{name}]"]
        assert abs(np.exp(width.estimate[0]) - 0.8) < 0.05
        assert abs(shift.estimate[0] - 0.3 / 0.8) < 0.1  # in the estimator's own sd
        assert findings[f"sbc.uniform[{name}]"].p_value < 1e-9


def test_a_statistic_is_computed_once_and_held_until_it_is_last_looked_at(tree, monkeypatch):
    """Of many trials each takes room, some of them most of what there is."""
    computed = []

    def shared(block):
        computed.append("shared")
        return block.theta_true[:, 0]

    def early(block):
        computed.append("early")
        return block.theta_true[:, 1]

    def looks(*at):
        return lambda prepared: [NotChecked(f"{len(prepared.per_trial(one))}", "looked") for one in at]

    chosen = {
        "one": Validator(looks(shared, early), (shared, early)),
        "two": Validator(looks(shared), (shared,)),
        "undeclared": Validator(looks(early)),
    }
    monkeypatch.setattr(validators, "VALIDATORS", chosen)
    _, said = run_validators(tree, seed=1, select=["one", "two"])
    assert [item.id for item in said] == ["300"] * 3
    assert sorted(computed) == ["early", "shared"]
    # Who has not said what it looks at has it computed again.
    computed.clear()
    run_validators(tree, seed=1)
    assert sorted(computed) == ["early", "early", "shared"]
