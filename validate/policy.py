"""Policy: what is tolerated, what is required, and how often a sound estimator may be blocked."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from importlib import resources
from typing import Annotated, Any

from pydantic import Field, field_validator

from gaugeblock.core.tables import Table, checked, read_toml
from gaugeblock.validate.levels import LARGEST, LEVELS, OUTERMOST

SHIPPED = ("default", "strict")

Probability = Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)]
Gap = Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)]
Size = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class Tolerance(Table):
    """The largest fault that is tolerated, per quantity; for `ess` the least fraction.

    bias: half-widths of 68% intervals (of a Gaussian: sd). log_width: natural log of the factor by which
    central intervals are too wide. coverage, joint, tails, informed, models: probability. local: probability
    in a region of a twentieth of the trials; in one of a share f, sqrt(0.05 / f) times this.
    normalisation: natural log of a density. outliers: share of draws.
    """

    bias: Size
    log_width: Size
    coverage: Gap
    joint: Gap
    local: Size
    informed: Gap
    normalisation: Size
    outliers: Gap
    tails: Gap
    models: Gap
    ess: Annotated[float, Field(ge=0, lt=1, allow_inf_nan=False)]


class Levels(Table):
    """Which central intervals are judged: up to 95% always; beyond, in the tails, where draws resolve them.

    `coverage` and `tails` are probabilities, each list rising.
    """

    coverage: Annotated[tuple[Annotated[float, Field(gt=0, le=LARGEST)], ...], Field(min_length=1)] = LEVELS
    tails: tuple[Annotated[float, Field(gt=LARGEST, lt=1)], ...] = OUTERMOST

    @field_validator("coverage", "tails")
    @classmethod
    def _rising(cls, levels: tuple[float, ...]) -> tuple[float, ...]:
        if list(levels) != sorted(set(levels)):
            raise ValueError("must rise, each level once")
        return levels

    def of(self, finding: str) -> tuple[float, ...] | None:
        """Levels at which a finding of this id is judged; None for one that is none of these intervals."""
        judged = {
            "coverage.central": self.coverage,
            "anytime.coverage": self.coverage,
            "tails.coverage": self.tails,
        }
        return judged.get(finding)


class Planning(Table):
    """Power at which smallest detectable faults are stated."""

    power: Annotated[float, Field(gt=0.5, lt=1, allow_inf_nan=False)]


class Policy(Table):
    """Tolerances, familywise error budget, and which gates must PASS.

    `required` holds validators' names or beginnings of gate ids: ``sbc`` means all its gates, ``sbc.bias``
    the bias of every parameter, ``sbc.bias[tbabs_1.nh]`` one. ``informed.rank`` is required of trials that
    hold data x.
    """

    error_budget: Annotated[float, Field(gt=0, le=0.5, allow_inf_nan=False)]
    required: Annotated[tuple[Annotated[str, Field(min_length=1)], ...], Field(min_length=1)]
    tolerance: Tolerance
    levels: Levels = Levels()
    planning: Planning

    def requires(self, gate: str) -> bool:
        """Whether the gate of this id must PASS."""
        return any(covers(entry, gate) for entry in self.required)

    def tolerated(self, quantity: str) -> float | None:
        """Tolerance of a quantity; None for one that is not judged."""
        return getattr(self.tolerance, quantity) if quantity in Tolerance.model_fields else None


def covers(entry: str, gate: str) -> bool:
    """Whether an entry of `required` names the gate, or the validator or group that it belongs to.

    >>> covers("sbc", "sbc.bias[a]"), covers("sbc.bias", "sbc.bias[a]"), covers("sbc.bias[a]", "sbc.bias[ab]")
    (True, True, False)
    """
    return gate == entry or gate.startswith((f"{entry}.", f"{entry}["))


def make_policy(table: Mapping[str, Any], *, source: str, base: Policy | None = None) -> Policy:
    """A Policy from plain data; what the table leaves out is as in `base`, or as in the default policy.

    Raises
    ------
    InputError
        For an unknown key or an impossible value; one line that names the key and `source`.
    """
    merged = _shipped_table("default") if base is None else base.model_dump(mode="json")
    for key, value in table.items():
        inner = merged.get(key)
        merged[key] = {**inner, **value} if isinstance(inner, dict) and isinstance(value, Mapping) else value
    return checked(Policy, merged, where=source)


def read_policy(path_or_name: str | os.PathLike[str]) -> Policy:
    """A shipped policy by name (default, strict), or one from a TOML file.

    Raises
    ------
    InputError
        If there is no such policy or file, it is not TOML, or a key or value in it cannot be.

    >>> read_policy("default").tolerance.bias
    0.1
    """
    if str(path_or_name) in SHIPPED:
        return make_policy(_shipped_table(str(path_or_name)), source=f"policy {path_or_name}")
    table = read_toml(path_or_name, remedy=f"give a TOML file, or the name {' or '.join(SHIPPED)}")
    return make_policy(table, source=str(path_or_name))


def _shipped_table(name: str) -> dict[str, Any]:
    text = (
        resources.files("gaugeblock.validate")
        .joinpath("policies", f"{name}.toml")
        .read_text(encoding="utf-8")
    )
    return tomllib.loads(text)
