"""Local calibration: coverage in regions that earlier trials suggest, so that faults cannot cancel.

Three tenths of the trials teach where each parameter's ranks look wrong: a tree of depth three over all that
is declared (`declared`), one for each parameter. In the other trials coverage is measured in every node of
it. Regions are functions of the data, of the pool of truth and draws, and of earlier trials. They may not
be regions of the truth, because not even an exact posterior is calibrated given the truth: of small truths
more posteriors lie too high than too low. ``local.coverage[parameter]`` is judged; ``local.homogeneous`` is
one p-value over everything.

A gap in a small region ruins less and is known less well. Gaps are judged as in a twentieth of the trials: in
a share f they count as sqrt(f / 0.05) times as much.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy import special

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import generator
from gaugeblock.validate.finding import Finding, MeanFinding, NotChecked
from gaugeblock.validate.learned.c2st import spread_out
from gaugeblock.validate.local.calibration_map import calibration_map
from gaugeblock.validate.local.declared import Rows, declared_features
from gaugeblock.validate.local.homogeneity import homogeneous_finding
from gaugeblock.validate.local.regions import LEAST, as_in_a_twentieth
from gaugeblock.validate.local.trees import Region, grow
from gaugeblock.validate.marginal.coverage import inside_central, steadied_error
from gaugeblock.validate.marginal.half_widths import SHIFTS, UNIT, half_widths, log_stretch, moved_pit
from gaugeblock.validate.messages import DEPTH, LOWER, SHARE
from gaugeblock.validate.prepared import Prepared
from gaugeblock.validate.quantiles import quantile_of, roots_of

LEVELS = (0.8, 0.95)
# One-sided coverage stands beside the central levels: a bias of 0.3 sd changes these by 0.02 and it by 0.12.
CHECKS = (*(f"{level:g}" for level in LEVELS), "lower half")
NOMINAL = np.array([*LEVELS, 0.5])
REFERENCE = (
    "coverage of the randomised PIT in regions learned on other trials; Zhao et al. 2021, arXiv:2102.10473"
)
# Share of the trials that teaches.
TAUGHT = 0.3
# A region has at least LEAST trials, and some, by chance, a few less among those tested; not fewer than this.
FEWEST = 60
LEAST_TRIALS = int(2 * LEAST / (1 - TAUGHT)) + 1
# Where normal scores of ranks end, and ranks that their moments are computed on.
MOST_SD, GRID = 3.0, 10_000
# Regions that a tree can have: its nodes, and two unions.
MOST_REGIONS = 2 ** (DEPTH + 1)


class LocalCoverage(NamedTuple):
    """Per region, parameter and check: gap and its error; influences ``(..., trial)`` on all trials."""

    gap: Array
    standard_error: Array
    influence: Array


class Regional(NamedTuple):
    """Regions of each parameter, learned on some trials, and the `rows` of the others, which are tested.

    `values` ``(tested, feature)`` of features `names`; `regions` and `members` ``(region, tested)`` by
    parameter; `taught` trials were learned from; `left_out` says which features could not be used.
    """

    names: tuple[str, ...]
    rows: Rows
    values: Array
    regions: tuple[tuple[Region, ...], ...]
    members: tuple[NDArray[np.bool_], ...]
    taught: int
    left_out: tuple[str, ...]


def held(pit: ArrayLike) -> NDArray[np.bool_]:
    """Whether central intervals, and the lower half of the posterior, hold the truth: ``(parameter, check,
    trial)`` from randomised PIT ``(trial, parameter)``."""
    u = np.asarray(pit, dtype=float)
    return np.concatenate([inside_central(u, LEVELS), (u.T <= 0.5)[:, None]], axis=1)


def local_coverage(pit: ArrayLike, members: ArrayLike) -> LocalCoverage:
    """Coverage minus level within regions, from PIT ``(trial, parameter)`` and members ``(region, trial)``.

    Influences are zero outside a region and scaled by trials over members inside, so that regions and whole
    samples share one bootstrap.

    >>> u = np.random.default_rng(0).random((400, 1))
    >>> local_coverage(u, np.arange(400) < [[200], [400]]).gap.shape
    (2, 1, 3)
    """
    inside = held(pit)
    member = np.asarray(members, dtype=bool)
    count = member.sum(axis=1)[:, None, None]
    hits = np.einsum("pct,rt->rpc", inside.astype(float), member.astype(float))
    scaled = member * (member.shape[1] / member.sum(axis=1))[:, None]
    influence = (inside - (hits / count)[..., None]) * scaled[:, None, None, :]
    return LocalCoverage(hits / count - NOMINAL, steadied_error(hits, count), influence)


def teaching_scores(pit: ArrayLike) -> Array:
    """What trees look at, ``(parameter, score, trial)``, of mean 0 and variance 1 for an exact posterior.

    Where the truth lies, in normal scores of its rank; the square of that, which sees widths best; and
    whether the 80% interval misses it.
    """
    u = np.asarray(pit, dtype=float)
    place = _place(u.T)
    grid = _place((np.arange(GRID) + 0.5) / GRID)
    square = (place**2 - np.mean(grid**2)) / np.std(grid**2)
    missed = (LEVELS[0] - inside_central(u, LEVELS[:1])) / np.sqrt(LEVELS[0] * (1 - LEVELS[0]))
    return np.concatenate([place[:, None] / grid.std(), square[:, None], missed], axis=1)


def _place(u: Array) -> Array:
    """Normal scores, cut off where one trial would outweigh many."""
    return np.asarray(np.clip(special.ndtri(u), -MOST_SD, MOST_SD))


def learned_regions(prepared: Prepared) -> Regional:
    """Learn on three tenths of the unaffected trials where each parameter looks wrong; regions of the others.

    The trials' numbers and the seed decide which teach, whatever the order in which they are stored.
    """
    by_number = np.argsort(prepared.trial)
    n = len(by_number)
    order = by_number[generator(prepared.seed, "order of the regions", n).permutation(n)]
    number = int(TAUGHT * n)
    # In the order of their numbers: sums are the same bits in whatever order trials are stored.
    taught, tested = (part[np.argsort(prepared.trial[part])] for part in (order[:number], order[number:]))
    declared = declared_features(prepared, taught)
    values = declared.values[tested]
    share = max(SHARE, LEAST / len(tested))
    regions, members = [], []
    for scores in teaching_scores(prepared.pit[taught]):
        tree = grow(declared.values[taught], scores.T, smallest=share)
        found = {region: region.members(values) for region in tree.regions}
        kept = {region: inside for region, inside in found.items() if FEWEST <= inside.sum() < len(tested)}
        regions.append(tuple(kept))
        members.append(np.array(list(kept.values())).reshape(len(kept), len(tested)))
    return Regional(declared.names, tested, values, tuple(regions), tuple(members), number, declared.left_out)


def local_finding(
    found: Regional,
    which: int,
    parameter: str,
    pit: ArrayLike,
    *,
    n: int,
    scores: Array | None = None,
    caveats: tuple[str, ...] = (),
) -> Finding:
    """Coverage gaps of parameter number `which` in its regions, as in a twentieth, from PIT ``(tested,)``.

    `n` counts all trials. `scores`, from `half_widths`, give the conditional bias (68% half-widths) and log
    width (of the 68% interval) in the details.
    """
    u = np.asarray(pit, dtype=float)[:, None]
    regions, members = found.regions[which], found.members[which]
    measured = local_coverage(u, members)
    gap, error = measured.gap[:, 0], measured.standard_error[:, 0]
    scale = as_in_a_twentieth(members.mean(axis=1))[:, None]
    estimate = gap * scale
    names = np.array([region.describe(found.names) for region in regions])
    worst, check = np.unravel_index(int(np.abs(estimate).argmax()), estimate.shape)
    details = xr.Dataset(
        {
            "region": ("region", names),
            "n": ("region", members.sum(axis=1)),
            "share": ("region", members.mean(axis=1)),
            # How many times a gap there counts, by component.
            "scale": ("component", np.repeat(scale[:, 0], len(CHECKS))),
            "gap": (("region", "check"), gap),
            "z": (("region", "check"), gap / error),
            "features": ((), len(found.names)),
        },
        coords={"check": list(CHECKS)},
    )
    details = details.merge(
        calibration_map(regions, int(worst), found.values, found.names, held(u)[0, check] - NOMINAL[check])
    ).assign(map_check=((), CHECKS[check]))
    if scores is not None:
        details = details.merge(_faults(scores, u, members))
    return MeanFinding(
        id=f"local.coverage[{parameter}]",
        quantity="local",
        claim=f"coverage minus level of {parameter}, of central intervals and of the lower half of the "
        f"posterior, in regions that a tree of depth {DEPTH} over {len(found.names)} features found on other "
        "trials; as in a twentieth of the trials",
        null="coverage equal to the level in every region of the data, exactly, for an exact posterior",
        reference=REFERENCE,
        n_trials=n,
        components=tuple(
            f"{parameter} where {name}{part} @ {level:g}"
            for name in names
            for part, level in (*(("", level) for level in LEVELS), (LOWER, 0.5))
        ),
        estimate=estimate.ravel(),
        standard_error=(error * scale).ravel(),
        influence=spread_out(
            (measured.influence[:, 0] * scale[..., None]).reshape(-1, len(u)), found.rows, n
        ),
        details=details,
        caveats=(*caveats, f"regions learned on {found.taught:,} trials, tested on the other {len(u):,}"),
    )


def _faults(scores: Array, u: Array, members: NDArray[np.bool_]) -> xr.Dataset:
    """Bias in 68% half-widths and log width of the 68% interval in each region, with their errors."""
    moved = np.moveaxis(moved_pit(scores, u), 1, 0)[0] - 0.5
    narrower = -log_stretch(scores, u, UNIT)[:, 0]
    shifts = np.array([np.ravel(roots_of(SHIFTS, moved[None, member])[:2]) for member in members])
    widths = np.array([quantile_of(narrower[member], 1 - UNIT)[:2] for member in members])
    columns = {"bias": shifts[:, 0], "bias_error": shifts[:, 1]}
    columns |= {"log_width": widths[:, 0], "log_width_error": widths[:, 1]}
    return xr.Dataset({name: ("region", column) for name, column in columns.items()})


def local(prepared: Prepared) -> list[Finding | NotChecked]:
    """Coverage of each parameter within regions that were learned, and whether it varies between them."""
    found = regional(prepared)
    if isinstance(found, str):
        return [NotChecked("local.coverage", found), NotChecked("local.homogeneous", found)]
    regions, findings = found
    pit = prepared.pit[regions.rows]
    groups = [(regions.members[k], [k]) for k, some in enumerate(regions.regions) if some]
    everywhere = homogeneous_finding(
        held(pit), groups, seed=prepared.seed, caveats=prepared.caveats + regions.left_out
    )
    return [*findings, everywhere]


def regional(prepared: Prepared) -> tuple[Regional, list[Finding]] | str:
    """Learned regions and coverage within those of each parameter, or why there are none."""
    n = len(prepared.trial)
    if n < LEAST_TRIALS:
        return f"{n} trial(s) with finite draws; regions need at least {LEAST_TRIALS}"
    found = learned_regions(prepared)
    if not any(found.regions):
        return "no parameter's location and no data feature differs enough between trials for regions of it"
    caveats = prepared.caveats + found.left_out
    pit, scores = prepared.pit[found.rows], prepared.per_trial(half_widths)[found.rows]
    return found, [
        local_finding(
            found, k, prepared.parameters[k], pit[:, k], n=n, scores=scores[:, [k]], caveats=caveats
        )
        for k, regions in enumerate(found.regions)
        if regions
    ]
