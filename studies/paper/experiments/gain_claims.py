"""Which number of the pairs each claim is about, and what is said beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from studies.kit.resume import Arrays
from studies.paper.experiment import Found
from studies.paper.experiments.gain_pairs import ALPHA, GAIN_RANGE, KINDS, MEMBERS
from studies.paper.judge import Measured, Untestable
from studies.paper.numbers import by_claim

Both = tuple[float, float]
Parts = dict[str, dict[str, float]]

BOOTSTRAPS = 1000
PRIOR_WIDTH = 0.9 * (GAIN_RANGE[1] - GAIN_RANGE[0])
"""Central 90 per cent of the gain's prior."""

SHIFT = 3.0
"""Per cent of gain."""

_NORM = (
    "in dex, {natural:+.4f} in natural logarithms: the study states no unit; less exact posteriors' "
    "{less exact:+.4f} dex"
)

STUDY = {"again": "epic-pn-bright", "cut": "epic-pn-bright-cut"}
"""The study's bright network trained again, and the same training cut at a bad epoch, as its own was."""

_OTHERS = (
    "such a bias is the flow's more than the gain's: on pairs that ours shifts by {beside:+.4f} dex, the "
    "study's network trained again does by {again:+.4f} ± {again error:.4f}, cut at a bad epoch by "
    "{cut:+.4f} ± {cut error:.4f}"
)

CURVE = {"down 3": -SHIFT, "down 1": -1.0, "up 1": 1.0, "up 3": SHIFT}
"""Per cent of gain of the curve of amplitudes."""


def claims_of(
    found: Mapping[str, Arrays], seeds: int, record: Mapping[str, Any], rng: np.random.Generator
) -> tuple[Parts, Parts]:
    """Numbers by claim and part, and their standard errors."""
    numbers: Parts = {}
    errors: Parts = {}

    def put(claim: str, part: str, value: Both) -> None:
        numbers.setdefault(claim, {})[part] = value[0]
        errors.setdefault(claim, {})[part] = value[1]

    runs = {level: [found[f"{level}-{k}"] for k in range(seeds)] for level in ("medium", "bright")}
    every = {level: _joined(parts) for level, parts in runs.items()}
    exact = {level: found[f"{level}-exact"] for level in runs}
    fixed, free = (_shift(every["medium"], kind, "alpha") for kind in KINDS)
    put("gm.bias.fixed.medium", "value", _mean(fixed))
    put("gm.bias.fixed.medium", "over its error", (_mean(fixed)[0] / _mean(fixed)[1], float("nan")))
    put("gm.bias.marg.medium", "value", _mean(free))
    put("gm.bias.marg.medium", "less fixed", _mean(free - fixed))
    put("gm.bias.bright", "value", _mean(_shift(every["bright"], "fixed", "alpha")))
    put("gm.bias.bright", "marginalised", _mean(_shift(every["bright"], "marginalised", "alpha")))
    # Exact posteriors of the first pairs: what a perfect flow would say of them.
    for claim, level, kind in (
        ("gm.bias.fixed.medium", "medium", "fixed"),
        ("gm.bias.marg.medium", "medium", "marginalised"),
        ("gm.bias.bright", "bright", "fixed"),
    ):
        put(claim, "less exact", _less_exact(runs[level][0], exact[level], kind, "alpha"))
    in_sd = {level: _in_sd(every[level]) for level in runs}
    _put_extremes(put, "gm.bias.sigma.medium", in_sd["medium"])
    _put_extremes(put, "gm.bias.sigma.bright", in_sd["bright"])
    _put_extremes(put, "gm.bias.allsigma", in_sd["medium"] + in_sd["bright"])
    curve = {name: _shift(found[f"curve {name}"], "fixed", "alpha") for name in CURVE}
    put("gm.bias.lin.3pc", "value", _line({CURVE[name]: shift for name, shift in curve.items()}))
    for name, shift in curve.items():
        put("gm.bias.lin.3pc", name, _mean(shift))
    for claim, kind in (("gm.KPL.bias.fixed", "fixed"), ("gm.KPL.bias.marg", "marginalised")):
        put(claim, "value", _mean(_shift(every["bright"], kind, "norm")))
        put(claim, "natural", _mean(np.log(10.0) * _shift(every["bright"], kind, "norm")))
        put(claim, "less exact", _less_exact(runs["bright"][0], exact["bright"], kind, "norm"))
    for part, name in STUDY.items():
        put("gm.KPL.bias.fixed", part, _mean(_shift(found["bright-study"], name, "norm")))
    put("gm.KPL.bias.fixed", "beside", _mean(_shift(runs["bright"][0], "fixed", "norm")))
    _gain(put, every)
    covered = [_coverage(every["medium"], kind, member) for kind in KINDS for member in MEMBERS]
    _put_extremes(put, "gm.cov90", covered)
    _put_extremes(put, "gm.width.ratio.mean", [_ratio_of_means(run, rng) for run in runs["medium"]])
    _put_extremes(put, "gm.width.ratio.med90", [_change_of_median(run, rng) for run in runs["medium"]])
    numbers["gm.train"] = {"simulations": float(record["training"]["simulations"])}
    return numbers, errors


def _joined(runs: Sequence[Arrays]) -> Arrays:
    return {name: np.concatenate([run[name] for run in runs]) for name in runs[0]}


def _shift(run: Arrays, kind: str, name: str) -> Array:
    """Shifted less clean, ``(pair,)``."""
    return np.asarray(run[f"{kind}-shifted-{name}"] - run[f"{kind}-clean-{name}"])


def _mean(values: Array) -> Both:
    return float(values.mean()), float(values.std(ddof=1) / np.sqrt(len(values)))


def _less_exact(run: Arrays, exact: Arrays, kind: str, name: str) -> Both:
    """A flow's bias less that of exact posteriors of the same pairs."""
    own = _shift(exact, "exact", name)
    return _mean(_shift(run, kind, name)[: len(own)] - own)


def _in_sd(run: Arrays) -> list[Both]:
    """The bias in posterior sd by both flows: mean over mean sd, and mean of the ratios."""
    found = []
    for kind in KINDS:
        shift, sd = _shift(run, kind, "alpha"), run[f"{kind}-clean-alpha-sd"]
        mean, error = _mean(shift)
        found += [(mean / float(sd.mean()), error / float(sd.mean())), _mean(shift / sd)]
    return found


def _put_extremes(put: Any, claim: str, values: Sequence[Both]) -> None:
    put(claim, "least", min(values))
    put(claim, "most", max(values))


def _line(shifts: Mapping[float, Array]) -> Both:
    """What a straight line through no bias at no gain says at the largest amplitude."""
    amplitude = np.array(list(shifts))
    mean, error = np.array([_mean(values) for values in shifts.values()]).T
    norm = SHIFT / (amplitude**2).sum()
    return float(norm * (amplitude @ mean)), float(norm * np.sqrt((amplitude**2) @ (error**2)))


def _gain(put: Any, every: Mapping[str, Arrays]) -> None:
    """Widths of the gain, and the spectra that exclude 1."""
    widths, excluded, number = [], 0, 0
    for level, run in every.items():
        for member in MEMBERS:
            low, high = (run[f"marginalised-{member}-gain-{end}"] for end in ("low", "high"))
            widths.append(_mean((high - low) / PRIOR_WIDTH))
            put("gm.g.width", f"{level} {member}", widths[-1])
        out = (low > 1.0) | (high < 1.0)
        put("gm.g.exclude", level, _mean(out.astype(float)))
        excluded, number = excluded + int(out.sum()), number + len(out)
    _put_extremes(put, "gm.g.width", widths)
    share = excluded / number
    put("gm.g.exclude", "value", (float(excluded), float(np.sqrt(max(excluded, 1)))))
    put("gm.g.exclude", "share", (share, float(np.sqrt(max(excluded, 1)) / number)))
    put("gm.g.exclude", "spectra", (float(number), float("nan")))


def _coverage(run: Arrays, kind: str, member: str) -> Both:
    truth = run["theta"][:, ALPHA]
    low, high = (run[f"{kind}-{member}-alpha-{end}"] for end in ("low", "high"))
    return _mean(((truth >= low) & (truth <= high)).astype(float))


def _ratio_of_means(run: Arrays, rng: np.random.Generator) -> Both:
    """Mean sd of the photon index, free over fixed, on clean spectra."""
    free, fixed = (run[f"{kind}-clean-alpha-sd"] for kind in KINDS[::-1])
    pick = rng.integers(len(fixed), size=(BOOTSTRAPS, len(fixed)))
    return float(free.mean() / fixed.mean()), float((free[pick].mean(1) / fixed[pick].mean(1)).std(ddof=1))


def _change_of_median(run: Arrays, rng: np.random.Generator) -> Both:
    """Change of the median central 90 per cent width of the photon index, per cent, on clean spectra."""
    free, fixed = (run[f"{kind}-clean-alpha-high"] - run[f"{kind}-clean-alpha-low"] for kind in KINDS[::-1])
    pick = rng.integers(len(fixed), size=(BOOTSTRAPS, len(fixed)))
    replicates = np.median(free[pick], axis=1) / np.median(fixed[pick], axis=1)
    return 100.0 * float(np.median(free) / np.median(fixed) - 1.0), 100.0 * float(replicates.std(ddof=1))


def found_of(table: xr.Dataset) -> Found:
    """Every claim's measurement; of the study's training, what ours is instead."""
    numbers, errors = by_claim(table), by_claim(table, "standard_error")
    notes = {
        "gm.bias.fixed.medium": "less exact posteriors' of the same spectra {less exact:+.4f}",
        "gm.bias.marg.medium": "less the fixed flow's {less fixed:+.4f}, less exact posteriors' "
        "{less exact:+.4f}",
        "gm.bias.bright": "gain-marginalised {marginalised:+.4f}; less exact posteriors' {less exact:+.4f}",
        "gm.bias.lin.3pc": "a line through {down 3:+.4f}, {down 1:+.4f}, {up 1:+.4f} and {up 3:+.4f} at -3, "
        "-1, 1 and 3 per cent",
        "gm.KPL.bias.fixed": _NORM,
        "gm.KPL.bias.marg": _NORM,
        "gm.g.exclude": "at 90 per cent, of {spectra:.0f}; medium {medium:.1%}, bright {bright:.1%}",
    }
    because = {"gm.KPL.bias.fixed": _OTHERS}
    found: dict[str, Measured | Untestable] = {
        claim: Measured(
            parts,
            errors.get(claim) or None,
            note=notes.get(claim, "").format_map(parts),
            because=because.get(claim, "").format_map(
                parts | {f"{part} error": error for part, error in errors.get(claim, {}).items()}
            ),
        )
        for claim, parts in numbers.items()
    }
    train = numbers["gm.train"]
    found["gm.train"] = Untestable(
        "the study's flow is not published; ours learned from {simulations:,.0f} spectra".format_map(train),
        train,
    )
    return found
