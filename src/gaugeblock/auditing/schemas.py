"""JSON schemas of what goes in and comes out: configuration, verdict, discovery; made of the code itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gaugeblock.auditing.config import AuditConfig
from gaugeblock.core.json_schema import Schema, schema_of
from gaugeblock.discovery.result import Discovery, Region
from gaugeblock.validate.finding import NotChecked
from gaugeblock.validate.looks import Looks
from gaugeblock.validate.policy import Policy
from gaugeblock.validate.validators import VALIDATORS
from gaugeblock.validate.verdict import SCHEMA_VERSION, Control, Gate, Verdict

_DIALECT = "https://json-schema.org/draft/2020-12/schema"


def configuration() -> Schema:
    """Of CONFIG.toml; options of simulators and estimators are their own."""
    made = AuditConfig.model_json_schema()
    policy = Policy.model_json_schema()
    definitions = made.setdefault("$defs", {}) | policy.pop("$defs")
    for each in (policy, *(definitions[name] for name in ("Tolerance", "Levels", "Planning"))):
        each.pop("required", None)  # what a table leaves out is as in its base
    policy["properties"]["base"] = {
        "type": "string",
        "description": "default, strict or a TOML file",
        "default": "default",
    }
    definitions["Policy"] = policy
    # A table without a name is the reference case with some options exchanged.
    definitions["Named"].pop("required")
    made["properties"]["policy"] = {"$ref": "#/$defs/Policy"}
    made["properties"]["validators"]["anyOf"][0]["items"] = {"enum": sorted(VALIDATORS)}
    made["$defs"] = definitions
    return _headed(made, "configuration", "An audit: simulator, estimator, trials and policy (CONFIG.toml)")


def verdict() -> Schema:
    """Of verdict.json, which states the version of this schema."""
    definitions: dict[str, Schema] = {}
    changes = {
        Gate: _of_a_gate,
        Control: _of_a_control,
        Looks: _of_looks,
        NotChecked: _of_what_was_not_checked,
        Verdict: _of_a_verdict,
    }
    schema_of(Verdict, definitions, changes)
    made = definitions.pop("Verdict")
    return _headed(
        {**made, "$defs": definitions}, "verdict", "verdict.json: outcome, gates and where they come from"
    )


def discovery() -> Schema:
    """Of discovery.json."""
    definitions: dict[str, Schema] = {}
    schema_of(Discovery, definitions, {Region: _of_a_region})
    made = definitions.pop("Discovery")
    return _headed(
        {**made, "$defs": definitions}, "discovery", "discovery.json: what was found, and how surely"
    )


SCHEMAS: dict[str, Callable[[], Schema]] = {
    "configuration": configuration,
    "verdict": verdict,
    "discovery": discovery,
}


def _headed(made: Schema, name: str, title: str) -> Schema:
    return {**made, "$schema": _DIALECT, "$id": f"urn:gaugeblock:{name}:{SCHEMA_VERSION}", "title": title}


def _of_a_gate(made: Schema) -> None:
    made["properties"]["verdict"] = made["properties"].pop("outcome")


def _of_a_control(made: Schema) -> None:
    number: dict[str, Any] = {"type": ["number", "null"]}
    made["properties"]["rungs"] = {
        "type": "array",
        "items": {
            "type": "object",
            "properties": {"size": number, "caught": {"type": "boolean"}},
            "required": ["size", "caught"],
        },
    }


def _of_looks(made: Schema) -> None:
    made["properties"]["number"] = {"type": "integer"}


def _of_what_was_not_checked(made: Schema) -> None:
    del made["properties"]["without_data"]


def _of_a_verdict(made: Schema) -> None:
    _of_a_gate(made)
    made["properties"]["schema_version"] = {"const": SCHEMA_VERSION}
    made["properties"]["reported"] = {
        "description": "Findings that no gate judges",
        "type": "array",
        "items": {
            "type": "object",
            "properties": {"id": {"type": "string"}, "claim": {"type": "string"}},
            "required": ["id", "claim", "estimate", "standard_error", "p_value", "n_trials"],
        },
    }


def _of_a_region(made: Schema) -> None:
    energies = ("energy_lo_kev", "energy_hi_kev")
    made["properties"] |= {name: {"type": ["number", "null"]} for name in energies}
    made["optional"] = energies
