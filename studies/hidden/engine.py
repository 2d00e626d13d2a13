"""The engine under test: `gaugeblock.discovery`, told nothing but counts, exposures and the claimed model."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from gaugeblock.discovery import Candidates, Discovery, Sources, discover_catalogue, discover_source
from studies.hidden.distance import distances, shared_distances
from studies.hidden.runner import Engine
from studies.hidden.score import FoundNames
from studies.hidden.seal import SealedCase
from studies.hidden.setups import simulator
from studies.hidden.strata import BRIGHT
from studies.kit.statements import said

REPLICATES = 499
"""Simulated data sets behind a global p."""

TYPICAL = {"powerlaw_1.norm": 2e-3, "blackbodyrad_1.norm": 0.4}
"""The brightest sources: a library scaled for them can be shared by all cases of a setup."""


@cache
def library(setup: str, only: tuple[str, ...] = ()) -> Candidates:
    """The candidates of a setup, worked in once; `only` some of them."""
    model = simulator(setup)
    theta = [TYPICAL.get(name, marginal.center) for name, marginal in model.prior.marginals.items()]
    return Candidates.of(model, np.array([theta]), only=only)


def engine(only: tuple[str, ...] = ()) -> Engine:
    """Discovery on one case at a time, compiled functions shared."""

    def search(case: SealedCase, seed: int) -> FoundNames:
        sources = Sources.of(simulator(case.setup), case.counts, scale=case.exposure / BRIGHT)
        if len(sources) > 1:
            several = discover_catalogue([sources], seed=seed, only=only, replicates=REPLICATES)
            return found(case.number, several)
        shared = library(case.setup, only)
        return found(case.number, discover_source(sources, seed=seed, replicates=REPLICATES, library=shared))

    return search


def found(number: int, discovery: Discovery) -> FoundNames:
    """What a discovery says, in the words of the study."""
    gap = discovery.gap.held_out
    return FoundNames(
        number=number,
        named=discovery.named or "",
        named_all=tuple(discovery.named_all),
        alike=tuple(discovery.indistinguishable),
        p_global=discovery.p_global,
        amplitude={one.effect: (one.value, *one.interval) for one in reversed(discovery.amplitude)},
        gap=tuple(float("nan") if side is None else side for side in (gap.before, gap.after)),
        withdrawn="" if discovery.withdrawn is None else discovery.withdrawn.effect,
        why="; ".join(discovery.remarks),
        seconds=0.0,
        statements=said(discovery.to_json()["statements"]),
    )


def apart(setup: str, mean: Any, scale: Any, own: Any, *, only: tuple[str, ...] = ()) -> dict[str, Any]:
    """Distances of single spectra, with the engine's own simulators and library."""
    model = "two" if setup == "background" else setup
    return distances(library(model, only), mean, scale, own)


def apart_shared(setup: str, mean: Any, scale: Any, own: Any) -> dict[str, float]:
    """Distances of a catalogue."""
    return shared_distances(library(setup), mean, scale, own)
