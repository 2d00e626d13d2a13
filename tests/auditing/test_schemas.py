"""The schemas, held against what audits and searches write, and against what an audit refuses."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

from gaugeblock import InputError, audit_draws
from gaugeblock.auditing.config import AuditConfig
from gaugeblock.auditing.schemas import SCHEMAS

ROOT = Path(__file__).resolve().parents[2]
jsonschema = pytest.importorskip("jsonschema")


def validator(name):
    schema = SCHEMAS[name]()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("name", SCHEMAS)
def test_what_is_published_is_what_the_code_makes(name):
    published = ROOT / "docs" / "schemas" / f"{name}.json"
    assert json.loads(published.read_text()) == SCHEMAS[name](), f"gaugeblock schema {name} > {published}"


@pytest.fixture(scope="module")
def verdicts(tmp_path_factory):
    """Of draws that pass and of draws that do not, with controls, suggestions, a baseline and a diagnosis."""
    folder = tmp_path_factory.mktemp("schemas")
    rng = np.random.default_rng(5)
    x = rng.normal(size=(600, 2))
    truth = x + rng.normal(size=x.shape)
    draws = x[:, None] + rng.normal(size=(600, 60, 2))
    audit_draws(truth, draws, x=x, out=folder / "exact")
    audit_draws(truth, 2.0 * draws + 1.0, x=x, out=folder / "wrong", baseline=folder / "exact")
    return [json.loads((folder / name / "verdict.json").read_text()) for name in ("exact", "wrong")]


def test_verdicts_are_as_their_schema_says(verdicts):
    check = validator("verdict")
    for verdict in verdicts:
        check.validate(verdict)
        assert verdict["schema_version"] == 1
    wrong = verdicts[1]
    assert wrong["verdict"] == "FAIL"
    assert wrong["controls"]
    assert wrong["baseline"]
    assert wrong["diagnosis"]
    assert wrong["not_checked"]


@pytest.mark.parametrize(
    "change",
    [
        lambda v: v.pop("gates"),
        lambda v: v.update(verdict="MAYBE"),
        lambda v: v.update(schema_version=2),
        lambda v: v.update(more=1),
        lambda v: v["gates"][0].pop("interval"),
        lambda v: v["gates"][0].update(interval=[0.0]),
        lambda v: v["gates"][0].update(n_trials="many"),
        lambda v: v["not_checked"][0].pop("why"),
    ],
)
def test_another_verdict_is_refused(verdicts, change):
    verdict = json.loads(json.dumps(verdicts[1]))
    change(verdict)
    assert not validator("verdict").is_valid(verdict)


@pytest.mark.parametrize("name", ["*.toml", "ci-gate/*.toml"])
def test_examples_are_configurations(name):
    check = validator("configuration")
    audits = [path for path in (ROOT / "examples").glob(name) if path.name.startswith("audit")]
    for path in audits:
        check.validate(tomllib.loads(path.read_text()))
    assert audits or name != "*.toml"


@pytest.mark.parametrize(
    "table",
    [
        {"trial": {}},
        {"trials": {"number": 3}},
        {"trials": {"numbers": 300}},
        {"trials": {"seed": -1}},
        {"policy": {"tolerance": {"bias": 0.0}}},
        {"policy": {"tolerances": {}}},
        {"policy": {"error_budget": 0.9}},
        {"policy": {"levels": {"coverage": []}}},
        {"validators": ["sbd"]},
    ],
)
def test_schema_and_audit_refuse_the_same(table):
    assert not validator("configuration").is_valid(table)
    with pytest.raises(InputError):
        AuditConfig.build(table)


@pytest.mark.parametrize(
    "table",
    [
        {},
        {"simulator": {"name": "xray", "level": "bright"}},
        {"trials": {"number": 300, "anytime": True}},
        {"policy": {"base": "strict", "tolerance": {"bias": 0.2}, "planning": {"power": 0.8}}},
        {"validators": ["sbc", "draws"]},
    ],
)
def test_schema_and_audit_take_the_same(table):
    validator("configuration").validate(table)
    AuditConfig.build(table)
