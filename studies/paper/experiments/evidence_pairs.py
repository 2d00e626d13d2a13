"""Log evidences of pairs with and without a gain, also at bright, where the study has no measurement.

Members of a pair have one theta and either the noise that two Poisson counts can share at most, or the same
seed, as in the study: the same seed is not the same noise. Evidences are of importance weights of our own
flows, under the prior of the study's nested sampling.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.validate.designs import count_ratio_regression
from studies.kit.resume import Arrays, Pieces, stream
from studies.paper.experiment import Experiment, Setting
from studies.paper.experiments.evidence import PRIOR
from studies.paper.experiments.gain_claims import SHIFT
from studies.paper.experiments.gain_pairs import MEMBERS, GainPairs

LEVELS = ("medium", "bright")
DESIGNS = ("coupled", "seeded")
CHUNK = 25
FLOW = "shipped:epic-pn-{level}"
PUBLISHED = 12
"""Pairs of the study."""


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """Log evidences, their errors and total counts, ``(level, design, pair, member)``."""
    kept: dict[str, list[Any]] = {"log_evidence": [], "error": [], "counts": []}
    for level in LEVELS:
        made = pieces.rows(level, sizes["pairs"], CHUNK, _maker(level, sizes["draws"]), seed)
        for name, rows in kept.items():
            rows.append(
                [
                    np.stack([made[f"{design}-{member}-{name}"] for member in MEMBERS], axis=1)
                    for design in DESIGNS
                ]
            )
    dims = ("level", "design", "pair", "member")
    return xr.Dataset(
        {name: (dims, np.array(rows)) for name, rows in kept.items()},
        coords={"level": list(LEVELS), "design": list(DESIGNS), "member": list(MEMBERS)},
    )


def _maker(level: str, draws: int) -> Any:
    from gaugeblock.estimators.importance_refined import ImportanceRefined
    from gaugeblock.estimators.npe import load
    from gaugeblock.simulators.xray import reference

    pairs = GainPairs(level)
    refined = ImportanceRefined(load(FLOW.format(level=level)), reference(level=level, prior=PRIOR))

    def make(rows: slice, rng: np.random.Generator) -> Arrays:
        number = rows.stop - rows.start
        theta, coupled = pairs.drawn(number, SHIFT, rng)
        drawn = {"coupled": coupled, "seeded": pairs.seeded(theta, SHIFT, rng.integers(2**31, size=number))}
        made: Arrays = {}
        for design, members in drawn.items():
            found = refined.weights(np.concatenate(list(members.values())), draws, rng)
            for k, (member, counts) in enumerate(members.items()):
                mine, name = slice(k * number, (k + 1) * number), f"{design}-{member}"
                made |= {
                    f"{name}-log_evidence": found.log_evidence[mine],
                    f"{name}-error": found.log_evidence_error[mine],
                    f"{name}-counts": counts.sum(axis=1),
                }
        return made

    return make


def summaries(table: xr.Dataset, *, seed: int = 0) -> dict[tuple[str, str], dict[str, float]]:
    """By level and design: mean difference and its error, also at equal counts, scatter, what 12 pairs have.

    `mean` is of gain less clean, in nats; `chance` the share of its variance that the weights make.
    """
    found = {}
    for level in LEVELS:
        for design in DESIGNS:
            here = table.sel(level=level, design=design)
            first, second = here["log_evidence"].values.T
            rng = np.random.default_rng(stream(seed, level, design))
            fitted = count_ratio_regression(second - first, *here["counts"].values.T, rng=rng)
            scatter = float((second - first).std(ddof=1))
            found[level, design] = {
                "pairs": float(fitted.n),
                "mean": fitted.raw_effect,
                "error": fitted.raw_error,
                "p": fitted.p_raw,
                "equal": fitted.effect,
                "equal_error": fitted.effect_error,
                "share": fitted.r_squared,
                "slope": fitted.slope,
                "scatter": scatter,
                "twelve": float(scatter / np.sqrt(PUBLISHED)),
                "chance": float((here["error"].values ** 2).sum(axis=1).mean() / scatter**2),
            }
    return found


EXPERIMENT = Experiment(
    name="evidence_pairs",
    says="paired evidences of a gain, at medium and at bright, with shared noise and as published",
    sizes={Setting.FULL: {"pairs": 250, "draws": 1000}, Setting.TWIN: {"pairs": 25, "draws": 200}},
    run=run,
    flows=tuple(FLOW.format(level=level) for level in LEVELS),
    extra="xray",
)
