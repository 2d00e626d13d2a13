"""Experiments, one a file, by name: `EXPERIMENTS` measure claims, `PAST` goes past them."""

from __future__ import annotations

import importlib

from studies.paper.experiment import Experiment

EXPERIMENTS = (
    "published",
    "setup",
    "counts",
    "information",
    "posteriors",
    "line_bias",
    "evidence",
    "nested",
    "detection",
    "detection_nicer",
    "importance",
    "calibration_published",
    "calibration_retrained",
    "calibration_nicer",
    "conformal",
    "gain_marginalised",
    "cross_check",
)
"""Names of files here; each has `EXPERIMENT`."""

PAST = (
    *("evidence_pairs", "residuals", "outputs", "learning_curve", "go_no_go"),
    *("gain_ours", "detection_ours", "calibration_ours", "conformal_ours"),
)
"""Those that measure what the study did not: no claim needs them."""


def load(name: str) -> Experiment:
    """The experiment of a name in `EXPERIMENTS` or `PAST`."""
    module = importlib.import_module(f"{__name__}.{name}")
    found: Experiment = module.EXPERIMENT
    return found
