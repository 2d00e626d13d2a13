"""The study's network in the study's units: linear parameters, standardised one by one, and raw counts."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from gaugeblock.estimators.npe.published import builder


def build(theta: Tensor, channels: int, *, seed: int, summaries: int) -> Any:
    """sbi's density estimator with first weights from a seed; torch's global generator is left alone.

    `theta` ``(n, parameter)`` float32 decides the standardisation.
    """
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        make = builder((channels,), z_score_theta="independent", summaries=summaries)
        return make(theta, torch.ones((len(theta), channels)))
