"""The study's network in the study's units: linear parameters, standardised one by one, and raw counts."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from gaugeblock.estimators.npe.published import PublishedEmbedding


def build(theta: Tensor, channels: int, *, seed: int) -> Any:
    """sbi's density estimator with first weights from a seed; torch's global generator is left alone.

    `theta` ``(n, parameter)`` float32 decides the standardisation.
    """
    from sbi.neural_nets import posterior_nn

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        make = posterior_nn(
            "nsf",
            num_transforms=5,
            hidden_features=50,
            num_bins=10,
            embedding_net=PublishedEmbedding(channels),
            z_score_theta="independent",
            z_score_x="none",
        )
        return make(theta, torch.ones((len(theta), channels)))
