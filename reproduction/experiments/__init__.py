"""Experiments, one a file. `EXPERIMENTS` names what is built, `PLANNED` what is not yet."""

from __future__ import annotations

import importlib
from collections.abc import Iterable

from gaugeblock.reproduction.experiment import Experiment

EXPERIMENTS = (
    "published",
    "setup",
    "counts",
    "information",
    "posteriors",
    "evidence",
    "nested",
    "detection",
    "detection_nicer",
    "importance",
    "calibration_published",
    "calibration_nicer",
    "conformal",
    "gain_marginalised",
    "cross_check",
)
"""Names of files here; each has `EXPERIMENT`."""

PAST = ("evidence_pairs",)
"""Those that measure what the study did not: no claim needs them."""

PLANNED = {
    "calibration_retrained": "the published network's bright flow from other seeds: ranks and coverage",
}
"""What will measure the claims that nothing measures yet."""


def load(name: str) -> Experiment:
    """The experiment of a name in `EXPERIMENTS` or `PAST`."""
    module = importlib.import_module(f"{__name__}.{name}")
    found: Experiment = module.EXPERIMENT
    return found


def loaded(names: Iterable[str] = (*EXPERIMENTS, *PAST)) -> dict[str, Experiment]:
    """Experiments by name."""
    return {name: load(name) for name in names}
