"""Ten spectra with a free gain, exactly and by flows: how much of what they say of the gain a flow keeps.

The study's ten come from pools whose seed is not published: these are of pools of ours, chosen as it
describes its own. Exact are importance weights of a flow's draws, held against UltraNest, and NUTS as a
second family of samplers. Everything exact is there under two priors: norms are uniform in the study's nested
sampling, while spectra and flows are drawn with log-uniform ones. Claims are of the study's network with a
free gain, trained again; the columns of the table are of flows of our own, which stand beside it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from studies.kit.resume import Arrays, Pieces
from studies.paper.experiment import SHIPPED, Experiment, Setting
from studies.paper.experiments import cross_posteriors as posteriors
from studies.paper.experiments.counts import SEED
from studies.paper.experiments.cross_claims import measured, numbers_of
from studies.paper.experiments.cross_spectra import INFORMATIVE, PRIORS, chosen_bright, chosen_medium, pool
from studies.paper.experiments.information import LEVELS
from studies.paper.numbers import TRAINING, as_table
from studies.paper.paper_flow import TRAININGS, paper_flow
from studies.paper.registry import claims

RECIPE = "epic-pn-{level}-gain"
"""The flows, as the study's network and ours are named."""

POOLS = (417, 500, 1000)
SEEDS = (*range(SEED, SEED + 60), *range(20260630, 20260643), 101, 202, 303)
"""Sizes and seeds that the study's pool may have: those it uses elsewhere and what lies near them."""

CHECKED = 416
NEAR = 4.0
"""Standard deviations of its counts within which a spectrum could be theirs."""

SAMPLED = (1, 0)
"""Bright spectra that NUTS samples, in the places of i394 and i416."""


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Shrinks of the gain by every way, and the numbers of the claims by one training."""
    shared = pieces.without(TRAINING)

    def once(kind: str, make: Callable[..., Mapping[str, Any]], *given: Any, of: Pieces = shared) -> Arrays:
        return of.one(kind, partial(make, *given), seed)

    searched = once("seeds", _searched)
    pools = {level: once(f"pool-{level}", pool, level, sizes) for level in LEVELS}
    rows = {"medium": chosen_medium(pools["medium"]), "bright": chosen_bright(pools["bright"])}
    counts = {level: pools[level]["counts"][rows[level]].astype(float) for level in LEVELS}
    exact = {
        (prior, level): once(
            f"exact-{level}-{prior}", _exactly, counts[level], level, prior, sizes["proposals"]
        )
        for prior in PRIORS
        for level in LEVELS
    }
    bright = counts["bright"]
    nested = shared.each(
        "nested", INFORMATIVE, lambda i, rng: posteriors.nested(bright[i], sizes["live"], rng), seed
    )
    boundary = once("boundary", posteriors.boundary, counts["medium"][0], sizes)
    chains = shared.each(
        "nuts", 2, lambda i, rng: posteriors.chain(bright[list(SAMPLED)], i + 1, sizes, rng), seed
    )

    def of_flows(flow_of: Callable[[str], Any], of: Pieces) -> dict[str, Any]:
        """Variables of flows that are given by their level."""
        found = {
            level: once(f"flow-{level}", _by_flow, flow_of, level, counts[level], sizes["draws"], of=of)
            for level in LEVELS
        }
        sampled = found["bright"]["draws"][list(SAMPLED)]
        # The same draws of the flow, and the same splits, against a chain and against one of twice its steps.
        steps = once("steps", _by_steps, chains, sampled, of=of)
        apart = once("apart", _apart, exact, sampled, sizes["told"], of=of)
        return _variables(list(found.values()), truth, apart, steps)

    parts = {prior: [exact[prior, level] for level in LEVELS] for prior in PRIORS}
    refined = [once(f"refined-{level}", _refined, level, counts[level], sizes["draws"]) for level in LEVELS]

    def column(kind: str, name: str) -> Array:
        return np.concatenate([part[name] for part in parts[kind]])

    def drawn(name: str) -> Array:
        return np.concatenate([pools[level][name][rows[level]] for level in LEVELS])

    truth = np.column_stack([drawn("theta"), np.ones(sum(map(len, rows.values())))])
    linear = "published_linear_norm"
    variables = {
        "pool_row": np.concatenate([rows[level] for level in LEVELS]),
        "counts": drawn("counts").sum(axis=1),
        "soft": drawn("soft"),
        "information": drawn("information"),
        "gain_error": drawn("gain_error"),
        "exact": column(linear, "shrink"),
        "exact_error": column(linear, "shrink_error"),
        "exact_effective": column(linear, "effective"),
        "folded": column(linear, "folded"),
        "folded_effective": column(linear, "folded_effective"),
        "exact_reference": column("reference", "shrink"),
        "exact_reference_error": column("reference", "shrink_error"),
        **{name: np.concatenate([part[key] for part in refined]) for name, key in REFINED.items()},
    }
    every: dict[str, Any] = {name: ("spectrum", values) for name, values in variables.items()}
    every["level"] = ("spectrum", np.repeat(list(LEVELS), [len(rows[level]) for level in LEVELS]))
    every |= {f"z_{kind}": _away(part, truth) for kind, part in parts.items()}
    for name in nested[0]:
        every[name] = ("run", np.array([float(run[name]) for run in nested]))
    for name in chains[0]:
        if name != "draws":
            every[f"nuts_{name}"] = (("steps", "sampled"), np.stack([part[name] for part in chains]))
    for label, numbers in (("boundary", boundary), ("searched", searched)):
        every |= {f"{label}_{name}": ((), float(value)) for name, value in numbers.items()}
    every |= {f"pool_{level}": (f"pool_of_{level}", pools[level]["shrink"]) for level in LEVELS}
    every["pool_counts"] = ("pool_of_bright", pools["bright"]["counts"].sum(axis=1))
    table = xr.Dataset(every)
    study = table.assign(of_flows(partial(_of_the_study, sizes[TRAINING]), pieces))
    ours = table.assign(of_flows(_ours, shared))
    return ours.merge(as_table(numbers_of(study))).assign(study=study["flow"])


REFINED = {"refined": "shrink", "refined_error": "shrink_error", "refined_effective": "effective"}
"""Columns of draws with importance weights."""


def _variables(levels: Sequence[Arrays], truth: Array, apart: Arrays, steps: Arrays) -> dict[str, Any]:
    """What a flow says of all spectra, and how its bright draws are told from exact ones."""

    def column(name: str) -> Array:
        return np.concatenate([level[name] for level in levels])

    return {
        "flow": ("spectrum", column("shrink")),
        "flow_error": ("spectrum", column("shrink_error")),
        "flow_by_set": (("spectrum", "set"), column("by_set")),
        "z_flow": _away(levels, truth),
        **{f"nuts_{name}": (("steps", "sampled"), values) for name, values in steps.items()},
        **{name: (("pair", "sampled")[-values.ndim :], values) for name, values in apart.items()},
    }


def _away(levels: Sequence[Arrays], truth: Array) -> tuple[tuple[str, str], Array]:
    """How far posteriors' means lie from the truth, in their sds."""
    mean, sd = (np.concatenate([level[name] for level in levels]) for name in ("mean", "sd"))
    return ("spectrum", "parameter"), (mean - truth) / sd


def _ours(level: str) -> Any:
    from gaugeblock.estimators.npe import load

    return load(SHIPPED + RECIPE.format(level=level))


def _of_the_study(training: str, level: str) -> Any:
    return paper_flow(RECIPE.format(level=level) + training)


def _searched(rng: np.random.Generator) -> Mapping[str, Any]:  # noqa: ARG001
    """Whether a natural seed of a pool gives the counts of its spectrum 416."""
    from gaugeblock.simulators.xray import published, reference

    simulator = reference(level="bright")
    wanted = claims()["xc.i416.counts"].parts["value"]
    tried = [(number, seed) for number in POOLS for seed in SEEDS]
    theta = np.array([published.theta(number, seed)[CHECKED] for number, seed in tried])
    expected = simulator.expected(theta).sum(axis=1)
    near = np.flatnonzero(np.abs(expected - wanted) < NEAR * np.sqrt(wanted))
    hits = 0
    for place in near:
        number, seed = tried[place]
        mean = simulator.expected(published.theta(number, seed))
        hits += any(
            np.random.default_rng(start).poisson(mean)[CHECKED].sum() == wanted for start in (seed, seed + 1)
        )
    return {"pools": len(tried), "near": len(near), "hits": hits}


def _exactly(
    counts: Array, level: str, prior: str, draws: int, rng: np.random.Generator
) -> Mapping[str, Any]:
    return posteriors.exact(_ours(level), counts, level, prior, draws, rng)


def _refined(level: str, counts: Array, draws: int, rng: np.random.Generator) -> Mapping[str, Any]:
    return posteriors.refined(_ours(level), counts, level, draws, rng)


def _by_flow(
    flow_of: Callable[[str], Any], level: str, counts: Array, draws: int, rng: np.random.Generator
) -> Mapping[str, Any]:
    return posteriors.by_flow(flow_of(level), counts, draws, rng)


def _apart(
    exact: Mapping[tuple[str, str], Arrays],
    flow: Array,
    number: int,
    rng: np.random.Generator,
) -> Mapping[str, Any]:
    """Two bright spectra: draws of flow and exact posteriors told apart, and exact ones of both priors.

    The three pairs are flow and exact under the flow's prior, flow and exact under the other one, exact and
    exact.
    """
    own, other = (
        exact[prior, "bright"]["draws"][list(SAMPLED)] for prior in ("reference", "published_linear_norm")
    )
    pairs = ((own, flow), (other, flow), (other, own))
    found = np.array(
        [
            [posteriors.told_apart(a, b, rng, number) for a, b in zip(first, second, strict=True)]
            for first, second in pairs
        ]
    )
    names = ("accuracy", "accuracy_error", "gain_accuracy", "gain_accuracy_error")
    return {
        **{name: found[..., k] for k, name in enumerate(names)},
        "overlap": np.array(
            [[posteriors.overlap(a, b) for a, b in zip(f, s, strict=True)] for f, s in pairs]
        ),
        # Of absorption, photon index and norm, which the study names.
        "dimension": np.array([posteriors.effective_dimension(draws[:, :3]) for draws in other]),
        "dimension_flow": np.array([posteriors.effective_dimension(draws[:, :3]) for draws in flow]),
    }


def _by_steps(chains: Sequence[Arrays], flow: Array, rng: np.random.Generator) -> Mapping[str, Any]:
    """How well draws of the flow are told from those of a chain, ``(steps, sampled)``: accuracy and error."""
    seed = int(rng.integers(2**31))
    found = np.array(
        [
            [
                posteriors.told_apart(draws, other, np.random.default_rng((seed, at)), len(draws))[:2]
                for at, (draws, other) in enumerate(zip(part["draws"], flow, strict=True))
            ]
            for part in chains
        ]
    )
    return {"accuracy": found[..., 0], "accuracy_error": found[..., 1]}


EXPERIMENT = Experiment(
    name="cross_check",
    says="ten spectra by nested sampling and NUTS with a free gain, and by the study's network and our flows",
    sizes={
        Setting.FULL: {
            "pool": 500,
            "screen": 400,
            "draws": 16_000,
            "proposals": 60_000,
            "live": 400,
            "warmup": 500,
            "chain": 8_000,
            "told": 1_000,
        },
        Setting.TWIN: {
            "pool": 40,
            "screen": 100,
            "draws": 2_000,
            "proposals": 2_000,
            "live": 40,
            "warmup": 60,
            "chain": 100,
            "told": 40,
        },
    },
    run=run,
    measured=measured,
    flows=tuple(SHIPPED + RECIPE.format(level=level) for level in LEVELS),
    retrained=tuple(RECIPE.format(level=level) for level in LEVELS),
    trainings=TRAININGS,
    extra="xray",
)
