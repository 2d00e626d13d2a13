"""What a calibration gate runs with: the call has it, else the marker, the command line, the ini file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from gaugeblock.auditing.config import TrialsTable, as_policy
from gaugeblock.core.errors import InputError
from gaugeblock.core.tables import checked
from gaugeblock.testing.outcomes import INCONCLUSIVE
from gaugeblock.validate.policy import SHIPPED, Policy
from gaugeblock.validate.validators import check_validators

MARKED = ("trials", "draws", "seed", "policy", "validators", "inconclusive")
OPTIONS = ("trials", "draws", "seed", "policy", "ledger", "out", "inconclusive")
_TRIALS = {"trials": "number", "draws": "draws", "seed": "seed"}


@dataclass(frozen=True)
class Layer:
    """Settings of one origin: how it writes a key, what it says, and from where its paths are meant."""

    spelling: str
    values: Mapping[str, Any]
    folder: Path

    def where(self, key: str) -> str:
        """The key as it was written there."""
        return self.spelling.format(key)


@dataclass(frozen=True, kw_only=True)
class GateSettings:
    """Everything decided. `out` is where the files go, if anywhere but a temporary folder."""

    trials: TrialsTable
    policy: Policy
    policy_name: str
    validators: tuple[str, ...] | None
    inconclusive: str
    ledger: Path | None
    out: Path | None
    own_folder: bool


def outer_layers(item: pytest.Item) -> list[Layer]:
    """Marker (the closest first), command line and ini file of a test.

    Raises
    ------
    InputError
        If the marker holds what it cannot, or the ini file's number is none.
    """
    config = item.config
    layers = []
    for marker in item.iter_markers("calibration"):
        if marker.args:
            raise InputError("@pytest.mark.calibration takes keywords only, as in calibration(trials=1000)")
        for key in marker.kwargs:
            if key not in MARKED:
                raise InputError(
                    f"@pytest.mark.calibration: unknown key {key}; there are {', '.join(MARKED)}"
                )
        layers.append(Layer("@pytest.mark.calibration({}=...)", marker.kwargs, item.path.parent))
    given = {name: config.getoption(f"calibration_{name}") for name in OPTIONS}
    layers.append(Layer("--calibration-{}", given, config.invocation_params.dir))
    try:
        written = {name: config.getini(f"calibration_{name}") for name in OPTIONS}
    except (TypeError, ValueError, pytest.UsageError) as error:
        raise InputError(f"calibration settings in {config.inipath}: {error}") from None
    beside = config.inipath.parent if config.inipath else config.rootpath
    return layers + [Layer("calibration_{} in the ini file", written, beside)]


def decide(layers: Sequence[Layer], root: Path) -> GateSettings:
    """The first layer that says anything about a key has it; what none does is as in the defaults.

    Raises
    ------
    InputError
        One line that names what cannot be used and where it was written.
    """
    said: dict[str, tuple[Layer, Any]] = {}
    for layer in reversed(layers):
        said |= {key: (layer, value) for key, value in layer.values.items() if value is not None}
    table: dict[str, Any] = {}
    for key, name in _TRIALS.items():
        if key in said:
            layer, value = said[key]
            checked(TrialsTable, {name: _whole(value, layer.where(key))}, where=layer.where(key))
            table[name] = int(value)
    policy, name = _policy(*said.get("policy", (layers[0], "default")), root)
    validators = _validators(*said["validators"]) if "validators" in said else None
    out, ledger = said.get("out"), said.get("ledger")
    return GateSettings(
        trials=checked(TrialsTable, table, where="calibration_gate"),
        policy=policy,
        policy_name=name,
        validators=validators,
        inconclusive=_inconclusive(*said["inconclusive"]) if "inconclusive" in said else "fail",
        ledger=ledger[0].folder / ledger[1] if ledger else None,
        out=out[0].folder / out[1] if out else None,
        own_folder=bool(out and out[0] is layers[0]),
    )


def _whole(value: object, where: str) -> int:
    try:
        return int(value) if isinstance(value, str) else value  # type: ignore[return-value]
    except ValueError:
        raise InputError(f"{where} = {value!r} cannot be: it must be a whole number") from None


def _policy(layer: Layer, value: Any, root: Path) -> tuple[Policy, str]:
    where = layer.where("policy")
    if isinstance(value, Mapping):
        base = str(value.get("base", "default"))
        return as_policy({**value, "base": _policy(layer, base, root)[0]}, where=where), f"{base}, changed"
    if isinstance(value, str | Path) and str(value) not in SHIPPED:
        value = next((at / value for at in (layer.folder, root) if (at / value).is_file()), value)
    try:
        chosen = as_policy(value, where=where)
    except InputError as error:
        said = str(error)
        raise InputError(said if said.startswith(where) else f"{where}: {said}") from None
    return chosen, "given as an object" if isinstance(value, Policy) else str(value)


def _validators(layer: Layer, value: object) -> tuple[str, ...]:
    names = (value,) if isinstance(value, str) else value
    chosen = tuple(names) if isinstance(names, Iterable) else ()
    if not chosen or not all(isinstance(name, str) for name in chosen):
        raise InputError(f"{layer.where('validators')} must be names of validators, got {value!r}")
    try:
        check_validators(chosen)
    except InputError as error:
        raise InputError(f"{layer.where('validators')}: {error}") from None
    return chosen


def _inconclusive(layer: Layer, value: object) -> str:
    if value not in INCONCLUSIVE:
        raise InputError(
            f"{layer.where('inconclusive')} = {value!r} cannot be: there are {', '.join(INCONCLUSIVE)}"
        )
    return str(value)
