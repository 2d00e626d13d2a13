"""A sealed set: designs drawn from a seed, settled, simulated, and locked away."""

from __future__ import annotations

import secrets
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from studies.hidden.case import Laboratory, designs
from studies.hidden.design import Distances, Shared, settled
from studies.hidden.seal import Answer, SealedCase, seal
from studies.hidden.strata import STRATA, Stratum


def generate(
    folder: Path,
    lab: Laboratory,
    distances: Distances,
    shared: Shared,
    *,
    seed: int | None = None,
    share: float = 1.0,
    strata: Sequence[Stratum] = STRATA,
) -> dict[str, Any]:
    """Write a sealed set and return its hashes; without a seed, one from the operating system's entropy.

    `share` takes only part of every stratum. Cases are numbered in an order that says nothing.
    """
    chosen = secrets.randbits(63) if seed is None else seed
    streams = np.random.default_rng(chosen).spawn(4)
    drawn = designs(strata, streams[0], share=share)
    found = settled(drawn, lab, distances, shared, streams[1])
    order = streams[2].permutation(len(drawn))
    data, answers = [], []
    for number, i in enumerate(order):
        design, (truths, apart) = drawn[i], found[i]
        rng = streams[3].spawn(1)[0]
        counts = np.array([lab.counts(truth, rng) for truth in truths])
        exposure = np.array([truth.exposure for truth in truths])
        data.append(SealedCase(number, design.stratum.setup, counts, exposure))
        rounded = {rival: round(float(value), 3) for rival, value in apart.items()}
        answers.append(Answer(design.stratum.name, design.stratum.kind, design.names, tuple(truths), rounded))
    return seal(folder, data, answers, seed=chosen)
