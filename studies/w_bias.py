"""XSPEC's W beside the joint likelihood: how bright is a source by either, how large the statistic of a bin?

    python -m studies w-bias [--workers N]
    python -m studies w-bias --page            # docs/xray.md of results/w-bias.nc; runs nothing

A power law and a smooth background, recorded by EPIC-pn in channels of 5 eV; the background region is as
large as the source's. The brightness alone is fitted, everything else of the source is true: by W, each
channel's background at its likeliest, and by the joint likelihood, fitted together with the background as
searches model it. Both meet the same counts.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import cache, partial
from typing import Any

import numpy as np
import xarray as xr
from scipy.optimize import minimize_scalar

from gaugeblock import discovery, simulators
from gaugeblock.core.arrays import Array
from gaugeblock.core.progress import Bars
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.held_out import deviance
from gaugeblock.simulators.marginals import Uniform
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.xray import Response, XraySpectrum, data, w_statistic, with_background
from studies.kit.command import carried_out, given, parser
from studies.kit.page import fill, table
from studies.kit.results import measured, of_commit, read, record, write
from studies.kit.resume import Arrays, Pieces

NAME = "studies w-bias"
BACKGROUNDS = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Expected background counts of a channel, on average."""

SOURCES = (1.0, 10.0)
"""Expected counts of the source, in those of the background under it."""

THETA = {"tbabs_1.nh": 0.25, "powerlaw_1.alpha": 2.0, "powerlaw_1.norm": 3e-4}
BAND = (0.5, 4.0)
BRIGHTEST = 4.0
"""Most that is tried, in units of the true brightness."""

CHUNK = 20


@cache
def observed(counts: float) -> XraySpectrum:
    """The source, exposed until it has so many counts a channel, on average."""
    paths = [data.path(f"{data.EXAMPLE}{name}") for name in ("PN.rmf", "PN.arf")]
    prior = Prior({name: Uniform(0.0, BRIGHTEST * value) for name, value in THETA.items()})
    source = XraySpectrum("tbabs*powerlaw", Response.from_ogip(*paths, band=BAND, exposure=1e3), prior)
    mean = source.expected(list(THETA.values())).mean()
    return source.with_exposure(1e3 * counts / float(mean))


def behind(source: XraySpectrum, counts: float) -> Array:
    """Expected background ``(channel,)``, falling with energy, of so many counts on average."""
    low, high = source.channels.T
    level = np.exp(-(low + high) / 6.0) * (high - low)
    return np.asarray(counts * level / level.mean())


def brightest_by_w(found: Array, other: Array, mean: Array) -> tuple[float, float]:
    """The factor of `mean` at which W is least, and W there; all ``(channel,)``."""

    def w(factor: float) -> float:
        return float(w_statistic(found, other, factor * mean, 1.0))

    grid = np.linspace(0.0, BRIGHTEST, 101)
    best = int(np.argmin([w(factor) for factor in grid]))
    ends = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    found_best = minimize_scalar(w, bounds=ends, method="bounded", options={"xatol": 1e-5})
    return float(found_best.x), float(found_best.fun)


def replicates(background: float, ratio: float, rows: slice, rng: np.random.Generator) -> Arrays:
    """Spectra of one brightness ``(rows,)``: its ratio to the true one by either fit, statistics a bin.

    `w` is W where W is least, over its channels; `w_joint` W of the joint fit, which searches print; `c` the
    joint deviance over the channels of both regions.
    """
    source, true = observed(ratio * background), np.array(list(THETA.values()))
    mean, level = source.expected(true), behind(source, background)
    made: list[tuple[float, ...]] = []
    for _ in range(rows.stop - rows.start):
        found, other = rng.poisson(mean + level).astype(float), rng.poisson(level).astype(float)
        both, x = with_background(source, other, 1.0), np.concatenate([found, other])
        start = np.concatenate([true, both.prior.center[len(true) :]])
        joint = fit(both, x[None], start=start[None], fixed=tuple(THETA)[:2])
        factor, least = brightest_by_w(found, other, mean)
        beside = float(both.w_statistic(joint.theta[0], x, 1.0))
        c = float(deviance(x, joint.expected[0]))
        made.append((factor, joint.theta[0, 2] / true[2], least / len(found), beside / len(found), c))
    names = ("by_w", "by_joint", "w", "w_joint", "c")
    return dict(zip(names, np.array(made).reshape(-1, len(names)).T, strict=True))


def run(chosen: argparse.Namespace, command: str) -> None:
    """Every cell in pieces, and all of them as one table."""
    code = measured(discovery, simulators)
    with Bars() as bars:
        work = chosen.work or chosen.out / "checkpoints"
        pieces = Pieces(
            work, {"seed": chosen.seed, "code": code["code"]}, "w-bias", bars.show, chosen.workers
        )
        cells = [
            [
                pieces.rows(
                    f"{background:g}-{ratio:g}", chosen.replicates, CHUNK,
                    partial(replicates, background, ratio), chosen.seed,
                )
                for ratio in SOURCES
            ]
            for background in BACKGROUNDS
        ]  # fmt: skip
    stacked = {name: np.array([[cell[name] for cell in row] for row in cells]) for name in cells[0][0]}
    made = xr.Dataset(
        {name: (("background", "source", "replicate"), values) for name, values in stacked.items()},
        {"background": list(BACKGROUNDS), "source": list(SOURCES)},
        record(command, chosen.seed, **code),
    )
    write({"": made}, chosen.out / "w-bias.nc")
    sys.stdout.write(shown(made) + "\n")


def shown(made: xr.Dataset) -> str:
    """Bias of the brightness and statistics a bin, by background and source, with standard errors."""

    def mean(values: Any) -> tuple[float, float]:
        return float(values.mean()), float(values.std(ddof=1) / np.sqrt(values.size))

    rows = []
    for source in made["source"].values:
        for background in made["background"].values:
            cell = made.sel(background=background, source=source)
            bias = [
                "{:+.1%} ± {:.1%}".format(*mean(cell[name].values - 1.0)) for name in ("by_w", "by_joint")
            ]
            scatter = f"{float(cell['by_joint'].std(ddof=1)):.1%}"
            statistics = [
                "{:.3f} ± {:.3f}".format(*mean(cell[name].values)) for name in ("w", "w_joint", "c")
            ]
            rows.append([f"{background:g}", f"{source * background:g}", *bias, scatter, *statistics])
    heads = [
        "background counts a bin", "source counts a bin", "brightness by W", "by the joint likelihood",
        "one spectrum's scatter", "W / bin, its own fit", "W / bin, the joint fit", "C / bin, the joint fit",
    ]  # fmt: skip
    number = made.sizes["replicate"]
    return f"{table(heads, rows)}\n\n{number} spectra a row: `{made.attrs['command']}`{of_commit(made)}."


def main(arguments: Sequence[str]) -> int:
    """Run it, or make the page of what is stored."""
    options = parser(NAME, __doc__)
    options.add_argument("--replicates", type=int, default=400, help="spectra of each brightness")
    options.add_argument("--page", action="store_true", help="only make the page of what is stored")
    chosen = options.parse_args(arguments)
    if chosen.page:
        return carried_out(
            lambda: fill(chosen.docs / "xray.md", {"w statistic": shown(read(chosen.out / "w-bias.nc"))})
        )
    return carried_out(partial(run, chosen, given(NAME, arguments)))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
