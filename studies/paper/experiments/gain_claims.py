"""Which number of the pairs each claim is about, and what is said beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from studies.kit.resume import Arrays
from studies.paper.experiment import Found
from studies.paper.experiments.gain_pairs import ALPHA, GAIN_RANGE, KINDS, MEMBERS
from studies.paper.numbers import Numbers, Parts, mean_of, measurements
from studies.paper.ours import ours_of, with_ours

Both = tuple[float, float]

BOOTSTRAPS = 1000
CENTRAL = 0.9
"""Of the gain's uniform prior, whose width is what posteriors' is told in."""

SHIFT = 3.0
"""Per cent of gain."""

OURS = "gain_ours"
"""The experiment whose table has the same numbers of our own flows."""

CURVE = {"down 3": -SHIFT, "down 1": -1.0, "up 1": 1.0, "up 3": SHIFT}
"""Per cent of gain of the curve of amplitudes."""


def claims_of(found: Mapping[str, Arrays], seeds: int, rng: np.random.Generator) -> Numbers:
    """Numbers by claim and part."""
    runs = {level: [found[f"{level}-{k}"] for k in range(seeds)] for level in ("medium", "bright")}
    every = {level: _joined(parts) for level, parts in runs.items()}
    exact = {level: found[f"{level}-exact"] for level in runs}

    def less_exact(level: str, kind: str, name: str) -> Both:
        """A flow's bias less that of exact posteriors, what a perfect flow would say, of the first pairs."""
        own = _shift(exact[level], "exact", name)
        return mean_of(_shift(runs[level][0], kind, name)[: len(own)] - own)

    fixed, free = (_shift(every["medium"], kind, "alpha") for kind in KINDS)
    bias = mean_of(fixed)
    in_sd = {level: _in_sd(every[level]) for level in runs}
    curve = {name: _shift(found[f"curve {name}"], "fixed", "alpha") for name in CURVE}
    norm = {kind: _shift(every["bright"], kind, "norm") for kind in KINDS}
    norms: dict[str, Parts] = {
        kind: {
            "value": mean_of(shift),
            "natural": mean_of(np.log(10.0) * shift),
            "less exact": less_exact("bright", kind, "norm"),
        }
        for kind, shift in norm.items()
    }
    return {
        "gm.bias.fixed.medium": {
            "value": bias,
            # In units of its own error.
            "over its error": (bias[0] / bias[1], 1.0),
            "less exact": less_exact("medium", "fixed", "alpha"),
        },
        "gm.bias.marg.medium": {
            "value": mean_of(free),
            "less fixed": mean_of(free - fixed),
            "less exact": less_exact("medium", "marginalised", "alpha"),
        },
        "gm.bias.bright": {
            "value": mean_of(_shift(every["bright"], "fixed", "alpha")),
            "marginalised": mean_of(_shift(every["bright"], "marginalised", "alpha")),
            "less exact": less_exact("bright", "fixed", "alpha"),
        },
        "gm.bias.sigma.medium": _extremes(in_sd["medium"]),
        "gm.bias.sigma.bright": _extremes(in_sd["bright"]),
        "gm.bias.allsigma": _extremes(in_sd["medium"] + in_sd["bright"]),
        "gm.bias.lin.3pc": {
            "value": _line({CURVE[name]: shift for name, shift in curve.items()}),
            **{name: mean_of(shift) for name, shift in curve.items()},
        },
        "gm.KPL.bias.fixed": norms["fixed"],
        "gm.KPL.bias.marg": norms["marginalised"],
        **_gain(every),
        "gm.cov90": _extremes(
            [_coverage(every["medium"], kind, member) for kind in KINDS for member in MEMBERS]
        ),
        "gm.width.ratio.mean": _extremes([_ratio_of_means(run, rng) for run in runs["medium"]]),
        "gm.width.ratio.med90": _extremes([_change_of_median(run, rng) for run in runs["medium"]]),
    }


def _joined(runs: Sequence[Arrays]) -> Arrays:
    return {name: np.concatenate([run[name] for run in runs]) for name in runs[0]}


def _shift(run: Arrays, kind: str, name: str) -> Array:
    """Shifted less clean, ``(pair,)``."""
    return np.asarray(run[f"{kind}-shifted-{name}"] - run[f"{kind}-clean-{name}"])


def _in_sd(run: Arrays) -> list[Both]:
    """The bias in posterior sd by both flows: mean over mean sd, and mean of the ratios."""
    found = []
    for kind in KINDS:
        shift, sd = _shift(run, kind, "alpha"), run[f"{kind}-clean-alpha-sd"]
        mean, error = mean_of(shift)
        found += [(mean / float(sd.mean()), error / float(sd.mean())), mean_of(shift / sd)]
    return found


ENDS = {"least": min, "most": max}


def _extremes(values: Sequence[Both]) -> Parts:
    return {place: pick(values) for place, pick in ENDS.items()}


def _line(shifts: Mapping[float, Array]) -> Both:
    """What a straight line through no bias at no gain says at the largest amplitude."""
    amplitude = np.array(list(shifts))
    mean, error = np.array([mean_of(values) for values in shifts.values()]).T
    norm = SHIFT / (amplitude**2).sum()
    return float(norm * (amplitude @ mean)), float(norm * np.sqrt((amplitude**2) @ (error**2)))


def _gain(every: Mapping[str, Arrays]) -> Numbers:
    """Widths of the gain, and the spectra that exclude 1."""
    widths: dict[str, Both] = {}
    out: dict[str, NDArray[np.bool_]] = {}
    for level, run in every.items():
        for member in MEMBERS:
            low, high = (run[f"marginalised-{member}-gain-{end}"] for end in ("low", "high"))
            widths[f"{level} {member}"] = mean_of((high - low) / (CENTRAL * np.ptp(GAIN_RANGE)))
        out[level] = (low > 1.0) | (high < 1.0)
    excluded, number = float(sum(map(np.sum, out.values()))), float(sum(map(len, out.values())))
    error = float(np.sqrt(max(excluded, 1.0)))
    return {
        "gm.g.width": {
            **widths,
            **_extremes(list(widths.values())),
            **{f"{place} of all": CENTRAL * pick(widths.values())[0] for place, pick in ENDS.items()},
        },
        "gm.g.exclude": {
            **{level: mean_of(values) for level, values in out.items()},
            "value": (excluded, error),
            "share": (excluded / number, error / number),
            "spectra": number,
        },
    }


def _coverage(run: Arrays, kind: str, member: str) -> Both:
    truth = run["theta"][:, ALPHA]
    low, high = (run[f"{kind}-{member}-alpha-{end}"] for end in ("low", "high"))
    return mean_of(((truth >= low) & (truth <= high)).astype(float))


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


_NORM = (
    "in dex, {natural:+.4f} in natural logarithms: the study states no unit; less exact posteriors' "
    "{less exact:+.4f} dex"
)
NOTES = {
    "gm.bias.fixed.medium": "less exact posteriors' of the same spectra {less exact:+.4f}",
    "gm.bias.marg.medium": "less the fixed network's {less fixed:+.4f}, less exact posteriors' "
    "{less exact:+.4f}",
    "gm.bias.bright": "gain-marginalised {marginalised:+.4f}; less exact posteriors' {less exact:+.4f}",
    "gm.bias.lin.3pc": "a line through {down 3:+.4f}, {down 1:+.4f}, {up 1:+.4f} and {up 3:+.4f} at -3, -1, "
    "1 and 3 per cent",
    "gm.KPL.bias.fixed": _NORM,
    "gm.KPL.bias.marg": _NORM,
    "gm.g.width": "over the whole prior {least of all:.3f} to {most of all:.3f}",
    "gm.g.exclude": "at 90 per cent, of {spectra:.0f}; medium {medium:.1%}, bright {bright:.1%}",
}


def measured(table: xr.Dataset) -> Found:
    """Every claim's measurement; beside it what flows of our own give on the same pairs."""
    return measurements(table, with_ours(NOTES, ours_of(OURS)))
