"""How far an audit trusts its simulator and its estimator, and what lowers what the verdict is worth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gaugeblock.auditing.estimator_from import FunctionEstimator, LibraryEstimator
from gaugeblock.core.trust import Trust
from gaugeblock.estimators.protocol import Confined, has_density, layers, untrusted
from gaugeblock.simulators.from_function import FunctionSimulator
from gaugeblock.validate import Finding

DRAWS: dict[str, Any] = {"estimator": "draws from disk", "caveats": []}
NO_SANDBOX = "The estimator ran without a sandbox, because whoever ran the audit trusts it."
SEED = "The seed was given: an estimator whose author knows it can draw the truths again."
DENSITIES = "Log densities are the estimator's own word: density.normalisation did not check them."
_WRAPPED = (FunctionEstimator, LibraryEstimator, FunctionSimulator)


def trust_record(simulator: object, estimator: object, *, seed_given: bool) -> dict[str, Any]:
    """The levels of both, by name, and in sentences what lowers the worth of a verdict on the estimator."""
    level = trust_of(estimator)
    caveats = [NO_SANDBOX] if level is Trust.TRUSTED else []
    if untrusted(estimator):
        caveats += [SEED] if seed_given else []
    record: dict[str, Any] = {"simulator": trust_of(simulator).value, "estimator": level.value}
    if untrusted(estimator) and has_density(estimator):
        record["densities"] = "claimed"
    return {**record, "caveats": caveats}


def trust_of(thing: object) -> Trust:
    """The lowest level of a simulator or an estimator and of what it wraps."""
    found = {_level(layer) for layer in layers(thing)}
    return next(level for level in Trust if level in found)


def _level(layer: object) -> Trust:
    if untrusted(layer) and isinstance(layer, Confined):
        return Trust.CONFINED if isinstance(layer.confinement()["sandbox"], Mapping) else Trust.TRUSTED
    ours = type(layer).__module__.startswith("gaugeblock.") and not isinstance(layer, _WRAPPED)
    return Trust.SHIPPED if ours else Trust.NAMED


def with_densities(record: Any, findings: Sequence[Finding]) -> Any:
    """The record with a caveat where what an estimator claims of its densities was held to nothing."""
    claimed = isinstance(record, Mapping) and record.get("densities") == "claimed"
    if not claimed or any(finding.id == "density.normalisation" for finding in findings):
        return record
    return {**record, "caveats": [*record["caveats"], DENSITIES]}
