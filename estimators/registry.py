"""Estimators by name: one table of what ships, and `module:object` for a user's own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from gaugeblock.core.errors import InputError
from gaugeblock.estimators.protocol import Estimator
from gaugeblock.simulators.protocol import Simulator
from gaugeblock.simulators.registry import Table, build

ESTIMATORS: Table = {
    "exact": ("gaugeblock.estimators.exact", "Exact", None),
    "npe": ("gaugeblock.estimators.npe", "load", "sbi"),
    "nested_sampling": ("gaugeblock.estimators.nested_sampling", "NestedSampling", "ultranest"),
    "nuts": ("gaugeblock.estimators.nuts", "Nuts", "nuts"),
    "conformal": ("gaugeblock.estimators.conformal", "Conformal", None),
    "importance_refined": ("gaugeblock.estimators.importance_refined", "ImportanceRefined", None),
    "repaired": ("gaugeblock.diagnosis.repaired", "Repaired", None),
    "stranger": ("gaugeblock.stranger.stranger", "build", None),
    "broken": ("gaugeblock.estimators.broken", "Broken", None),
}


def build_estimator(name: str, simulator: Simulator, **options: Any) -> Estimator:
    """Make the estimator of the given name for a simulator, or a user's own given as ``module:object``.

    A user's object may be an instance, or a class or function that is called with the simulator and the
    options. An option `base` that is a table, ``{"name": ..., ...options}``, is an estimator itself and is
    built first.

    >>> from gaugeblock.simulators import build_simulator
    >>> simulator = build_simulator("linear_gaussian")
    >>> build_estimator("exact", simulator).describe()["estimator"]
    'exact'

    Raises
    ------
    InputError
        If there is no such name, it cannot be imported, the options do not fit it, or what it makes
        lacks `sample`.
    MissingExtraError
        If it needs a library that is not installed.
    """
    where = f"estimator {name!r}"
    base = options.get("base")
    if isinstance(base, Mapping):
        inner = dict(base)
        if "name" not in inner:
            raise InputError(f"{where}: its base needs a name, as in base = {{ name = 'npe', path = ... }}")
        options["base"] = build_estimator(inner.pop("name"), simulator, **inner)
    made = build(ESTIMATORS, "estimator", name, options, ("sample",), given={"simulator": simulator})
    return cast(Estimator, made)
