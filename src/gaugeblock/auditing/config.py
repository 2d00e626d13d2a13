"""What to audit, as a TOML file says it: the tables simulator, estimator, trials and policy."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, PrivateAttr, model_validator

from gaugeblock.auditing.samples import Plan
from gaugeblock.core.errors import InputError
from gaugeblock.core.settings import apply_settings
from gaugeblock.core.tables import Named, Table, checked, read_toml
from gaugeblock.core.trust import modules_in, refuse_trust
from gaugeblock.validate.policy import SHIPPED, Policy, make_policy, read_policy
from gaugeblock.validate.validators import check_validators

Count = Annotated[int, Field(gt=0)]
LIKELIHOODS, SHARE = 1000, 4
# No more than there is of the whole.
_PARTS = {"importance_number": "number", "joint_number": "number", "joint_draws": "draws"}


class TrialsTable(Table):
    """How many trials and draws, from which seed.

    `block` trials are simulated and sampled together, with one random generator (1 is for simulators of a
    minute a call); it is part of what makes a run repeatable to the bit. The first `importance_number` trials
    get `importance_draws` further draws each, with densities; the likelihood is evaluated at the first
    `joint_draws` draws of the first `joint_number` trials (1,000, or a quarter where that is more). With
    `anytime` trials are watched block by block, and `number` is the most there can be. `observation` is a
    file with the data in hand, around which calibration is looked at too.
    """

    number: Annotated[int, Field(ge=10)] = 4000
    draws: Annotated[int, Field(ge=2)] = 250
    block: Count = 200
    importance_number: Annotated[int, Field(ge=0)] = 200
    importance_draws: Annotated[int, Field(ge=10)] = 500
    joint_number: Annotated[int, Field(ge=0)] | None = None
    joint_draws: Annotated[int, Field(ge=2)] = 100
    seed: Annotated[int, Field(ge=0)] = 20260611
    anytime: bool = False
    observation: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _renamed(cls, table: Any) -> Any:
        if isinstance(table, dict) and "chunk" in table:
            raise ValueError("chunk is no longer a key; its name is block")
        return table

    @model_validator(mode="after")
    def _subset(self) -> TrialsTable:
        for name, whole in _PARTS.items():
            part, most = getattr(self, name), getattr(self, whole)
            if part is not None and part > most and name in self.model_fields_set:
                raise ValueError(f"{name} {part} is more than {whole} {most}")
        return self

    def plan(self) -> Plan:
        """What to collect; a default that is more than there is means all there is."""
        held = self.model_dump(include={one.name for one in fields(Plan)})
        if held["joint_number"] is None:
            held["joint_number"] = max(LIKELIHOODS, self.number // SHARE)
        return Plan(**held | {name: min(held[name], held[whole]) for name, whole in _PARTS.items()})


def as_trials_table(
    trials: int | Mapping[str, Any] | TrialsTable | None = None,
    *,
    draws: int | None = None,
    seed: int | None = None,
) -> TrialsTable:
    """How many trials, given as a number or as a table, with `draws` and `seed` put over it.

    Raises
    ------
    InputError
        For an unknown key or an impossible value.

    >>> as_trials_table(500, draws=100).plan().joint_number
    500
    """
    given: Mapping[str, Any] = {}
    if isinstance(trials, TrialsTable):
        given = trials.model_dump(exclude_unset=True)
    elif isinstance(trials, Mapping):
        given = trials
    elif trials is not None:
        given = {"number": trials}
    over = {name: value for name, value in (("draws", draws), ("seed", seed)) if value is not None}
    return checked(TrialsTable, {**given, **over}, where="trials")


PolicyLike = str | os.PathLike[str] | Mapping[str, Any] | Policy


def as_policy(policy: PolicyLike, *, where: str = "policy") -> Policy:
    """A policy by its name, from a file, from a table over another (``base``), or as it is.

    Raises
    ------
    InputError
        If there is no such policy, or a key or value in it cannot be.

    >>> as_policy({"base": "strict", "tolerance": {"bias": 0.2}}).tolerance.bias
    0.2
    """
    if isinstance(policy, Policy):
        return policy
    if isinstance(policy, Mapping):
        own = dict(policy)
        return make_policy(own, source=where, base=as_policy(own.pop("base", "default"), where=where))
    if not isinstance(policy, str | os.PathLike):
        raise InputError(
            f"{where} cannot be a {type(policy).__name__}: give {' or '.join(SHIPPED)}, a TOML file, a table "
            "or a Policy"
        )
    return read_policy(policy)


class AuditConfig(Table):
    """A whole audit. Without any table: the shipped reference flow on EPIC-pn at medium counts.

    `summaries` is ``module:function``, a function of the data that `gaugeblock.audit` takes.

    >>> AuditConfig.build({}).simulator.options
    {'response': 'epic-pn', 'level': 'medium'}
    """

    simulator: Named = Named.model_validate({"name": "xray", "response": "epic-pn", "level": "medium"})
    estimator: Named = Named.model_validate({"name": "npe", "path": "shipped:epic-pn-medium"})
    trials: TrialsTable = TrialsTable()
    policy: dict[str, Any] = Field(default_factory=dict)
    validators: tuple[str, ...] | None = None
    summaries: str | None = None
    # Modules that whoever read a file named besides; None where there was no file.
    _modules: frozenset[str] | None = PrivateAttr(default=None)

    @property
    def modules(self) -> frozenset[str] | None:
        """Modules that may load though nobody declares them; None for any."""
        return self._modules

    @classmethod
    def build(cls, table: Mapping[str, Any], *, where: str = "configuration") -> AuditConfig:
        """Check plain data, as TOML gives it.

        Raises
        ------
        InputError
            One line that names the first key that is unknown or whose value cannot be used.
        """
        config = checked(cls, table, where=where)
        config.read_policy(where=where)
        check_validators(config.validators or ())
        return config

    def read_policy(self, *, where: str = "configuration") -> Policy:
        """The policy: a shipped one or a file by ``base``, with the table's other keys put over it.

        Raises
        ------
        InputError
            If there is no such base or a key cannot be.
        """
        return as_policy(self.policy, where=f"{where}: policy")


def read_config(
    path: str | os.PathLike[str] | None,
    *,
    settings: Mapping[str, Any] | None = None,
    draws_given: bool = False,
    allow_modules: Iterable[str] = (),
) -> AuditConfig:
    """Read an audit's TOML (none: the reference case) with dotted `settings` put over it.

    Paths inside the file are relative to the file. Modules that it names load only if they are in
    `allow_modules` or in `settings`, or an installed package declares them (`gaugeblock.core.trust`). With
    `draws_given` (trials from disk) nothing is simulated or sampled, so only the policy and the choice of
    validators have a say.

    Raises
    ------
    InputError
        If the file cannot be read, is not TOML, or holds an unknown key or an impossible value; or, with
        `draws_given`, a key that has no say.
    """
    where = "command line" if path is None else str(path)
    table = {} if path is None else _anchored(read_toml(path), Path(path).resolve().parent)
    refuse_trust(table, where)
    table = apply_settings(table, settings or {})
    idle = [name for name in ("simulator", "estimator", "trials") if name in table]
    if draws_given and idle:
        raise InputError(
            f"{where}: {idle[0]} has no say where draws are given; only policy, validators and summaries do"
        )
    config = AuditConfig.build(_completed(table), where=where)
    if path is not None:
        config._modules = frozenset(allow_modules) | modules_in(settings or {})
    return config


_PATHS = (
    ("simulator", ("pha", "rmf", "arf", "priors")),
    ("estimator", ("path", "python", "diagnosis")),
    ("trials", ("observation",)),
    ("policy", ("base",)),
)


def _anchored(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Relative paths that exist beside the configuration are meant from there."""
    anchored = dict(table)
    for name, keys in _PATHS:
        entry = anchored.get(name)
        if isinstance(entry, dict):
            found = {key: _beside(folder, entry[key]) for key in keys if isinstance(entry.get(key), str)}
            anchored[name] = {**entry, **found}
    estimator = anchored.get("estimator")
    if isinstance(estimator, dict):
        estimator = {**estimator, **_anchored_program(estimator, folder)}
        if isinstance(estimator.get("base"), dict):
            estimator["base"] = _anchored({"estimator": estimator["base"]}, folder)["estimator"]
        anchored["estimator"] = estimator
    return anchored


def _anchored_program(estimator: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """The files that a stranger's builder, source and command name."""
    found: dict[str, Any] = {}
    builder, command = estimator.get("builder"), estimator.get("command")
    if isinstance(builder, str):
        file, colon, function = builder.rpartition(":")
        found["builder"] = f"{_beside(folder, file)}{colon}{function}" if colon else builder
    options = estimator.get("options")
    if isinstance(options, dict) and isinstance(options.get("source"), str):
        found["options"] = {**options, "source": _beside(folder, options["source"])}
    if isinstance(command, str | list):
        words = shlex.split(command) if isinstance(command, str) else command
        found["command"] = [_beside(folder, word, file=True) for word in map(str, words)]
    return found


def _beside(folder: Path, name: str, *, file: bool = False) -> str:
    path = folder / name
    return str(path) if (path.is_file() if file else path.exists()) else name


def _completed(table: dict[str, Any]) -> dict[str, Any]:
    """A table without a name means the reference case with some options exchanged."""
    completed = dict(table)
    defaults = AuditConfig()
    for name in ("simulator", "estimator"):
        entry = completed.get(name)
        reference: Named = getattr(defaults, name)
        if entry is None or (isinstance(entry, dict) and "name" not in entry):
            entry = entry or {}
            # A spectrum of one's own excludes the built-in response and level.
            keep = {} if "rmf" in entry else reference.options
            completed[name] = {"name": reference.name, **keep, **entry}
    return completed
