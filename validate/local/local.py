"""Local calibration: coverage within regions of parameters and data, so that faults cannot cancel.

Regions are functions of the data: of data features, and of where the posterior lies. They may not be regions
of the truth, because not even an exact posterior is calibrated given the truth: of small truths more
posteriors lie too high than too low. ``local.coverage[feature]`` is judged; ``local.homogeneous`` is one
p-value over everything, and ranks the regions.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.check import circular_parameters
from gaugeblock.validate.finding import Finding, MeanFinding, NotChecked
from gaugeblock.validate.local.homogeneity import homogeneous_finding
from gaugeblock.validate.local.regions import LEAST, Regions, quantile_regions
from gaugeblock.validate.marginal.coverage import inside_central, steadied_error
from gaugeblock.validate.marginal.half_widths import SHIFTS, UNIT, half_widths, log_stretch, moved_pit
from gaugeblock.validate.prepared import Prepared, TrialBlock
from gaugeblock.validate.quantiles import quantile_of, roots_of
from gaugeblock.validate.ranks import truth_weight

LEVELS = (0.5, 0.8, 0.95)
# One-sided coverage stands beside the central levels: a bias of 0.3 sd changes these by 0.02 and it by 0.12.
CHECKS = (*(f"{level:g}" for level in LEVELS), "lower half")
NOMINAL = np.array([*LEVELS, 0.5])
REFERENCE = "Zhao et al. 2021, arXiv:2102.10473; coverage of the randomised PIT within regions of the data"
# More components than this widen all simultaneous intervals for little: beyond it, fewer data features.
MOST_COMPONENTS = 250


class LocalCoverage(NamedTuple):
    """Per region, parameter and check: gap and its error; influences ``(..., trial)`` on all trials."""

    gap: Array
    standard_error: Array
    influence: Array


def location(block: TrialBlock) -> Array:
    """Statistic: mean of the truth and its draws together, ``(trial, parameter)``.

    The mean of the draws alone would favour truths on the other side of it; given the *pool*, truth and draws
    of an exact posterior are exchangeable, so ranks are uniform within any region of pooled means.
    """
    if block.weight is None:
        mean = (block.draws.sum(axis=1) + block.theta_true) / (block.draws.shape[1] + 1)
    else:
        # As everywhere: the truth weighs as much as one effective draw.
        own = truth_weight(block.weight)[:, None]
        total = block.weight.sum(axis=1)[:, None] + own
        mean = (np.einsum("td,tdp->tp", block.weight, block.draws) + own * block.theta_true) / total
    for column, period in circular_parameters(block.prepared.main).items():
        # Blocks hold circular parameters relative to their pooled mean; how far the truth was moved tells it.
        moved = block.prepared.theta_true[block.rows, column] - block.theta_true[:, column]
        mean[:, column] = (mean[:, column] + moved) % period
    return np.asarray(mean, dtype=float)


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
    (2, 1, 4)
    """
    inside = held(pit)
    member = np.asarray(members, dtype=bool)
    count = member.sum(axis=1)[:, None, None]
    hits = np.einsum("pct,rt->rpc", inside.astype(float), member.astype(float))
    scaled = member * (member.shape[1] / member.sum(axis=1))[:, None]
    influence = (inside - (hits / count)[..., None]) * scaled[:, None, None, :]
    return LocalCoverage(hits / count - NOMINAL, steadied_error(hits, count), influence)


def local_finding(
    pit: ArrayLike,
    regions: Regions,
    parameters: Sequence[str],
    *,
    scores: Array | None = None,
    caveats: tuple[str, ...] = (),
) -> Finding:
    """Coverage gaps of the parameters in the regions of one feature, from PIT ``(trial, parameter)``.

    `scores`, from `half_widths`, give the conditional bias (68% half-widths) and log width (of the 68%
    interval) in the details.
    """
    u = np.asarray(pit, dtype=float)
    found = local_coverage(u, regions.members)
    dims = ("region", "parameter")
    details = xr.Dataset(
        {
            "low": ("region", regions.low),
            "high": ("region", regions.high),
            "n": ("region", regions.count),
            "gap": ((*dims, "check"), found.gap),
            "z": ((*dims, "check"), found.gap / found.standard_error),
        },
        coords={"parameter": list(parameters), "check": list(CHECKS)},
    )
    if scores is not None:
        moved = np.moveaxis(moved_pit(scores, u), 1, 0) - 0.5
        shifts = [roots_of(SHIFTS, moved[:, member]) for member in regions.members]
        details["bias"], details["bias_error"] = (
            (dims, np.stack(part)) for part in zip(*(root[:2] for root in shifts), strict=True)
        )
        narrower = -log_stretch(scores, u, UNIT)
        widths = [
            [quantile_of(column, 1 - UNIT) for column in narrower[member].T] for member in regions.members
        ]
        for k, name in enumerate(("log_width", "log_width_error")):
            details[name] = (dims, np.array(widths)[..., k])
    said = caveats
    if len(regions) < 4:
        said = (*caveats, f"{len(regions)} regions of {regions.name}: each needs at least {LEAST} trials")
    components = tuple(
        f"{name}{part} in {regions.describe(region)} @ {level:g}"
        for region in range(len(regions))
        for name in parameters
        for part, level in (*(("", level) for level in LEVELS), (" (lower half)", 0.5))
    )
    return MeanFinding(
        id=f"local.coverage[{regions.name}]",
        quantity="local",
        claim=f"coverage minus level within regions of {regions.name}, of central intervals and of the lower "
        "half of the posterior",
        null="coverage equal to the level in every region of the data, exactly, for an exact posterior",
        reference=REFERENCE,
        n_trials=len(u),
        components=components,
        estimate=found.gap.ravel(),
        standard_error=found.standard_error.ravel(),
        influence=found.influence.reshape(-1, len(u)),
        details=details,
        caveats=said,
    )


def local(prepared: Prepared) -> list[Finding | NotChecked]:
    """Coverage within regions of each parameter's location and of data features, and whether it varies."""
    n = len(prepared.trial)
    if n < 2 * LEAST:
        why = f"{n} trial(s) with finite draws; regions need at least {2 * LEAST}"
        return [NotChecked("local.coverage", why), NotChecked("local.homogeneous", why)]
    chosen, said = _regions(prepared)
    caveats = prepared.caveats + said
    if not chosen:
        why = "no parameter's location and no data feature differs between trials"
        return [NotChecked("local.coverage", why), NotChecked("local.homogeneous", why)]
    findings: list[Finding | NotChecked] = [
        local_finding(
            prepared.pit[:, columns],
            regions,
            [prepared.parameters[k] for k in columns],
            scores=prepared.per_trial(half_widths)[:, columns],
            caveats=caveats,
        )
        for regions, columns in chosen
    ]
    order = np.argsort(prepared.trial)  # so that the p-value does not depend on the order of trials
    return [
        *findings,
        homogeneous_finding(
            held(prepared.pit)[..., order],
            [(regions.members[:, order], columns) for regions, columns in chosen],
            [finding for finding in findings if isinstance(finding, Finding)],
            seed=prepared.seed,
            caveats=caveats,
        ),
    ]


def _regions(prepared: Prepared) -> tuple[list[tuple[Regions, list[int]]], tuple[str, ...]]:
    """Regions with the parameters whose coverage is looked at in them; what to say of features left out."""
    every = list(range(len(prepared.parameters)))
    places = prepared.per_trial(location)
    wanted = [(name, places[:, k], [k]) for k, name in enumerate(prepared.parameters)]
    features = prepared.features
    if features is not None:
        # The total and whatever the user gave always; components as far as they are not too many.
        first = [name for name in features.names if not name.startswith("component ")]
        wanted += [(name, features.column(name), every) for name in first]
        for name in features.names:
            size = 4 * len(CHECKS) * (sum(len(columns) for _, _, columns in wanted) + len(every))
            if name not in first and size <= MOST_COMPONENTS:
                wanted.append((name, features.column(name), every))
    chosen: list[tuple[Regions, list[int]]] = []
    constant: list[str] = []
    unusable: list[str] = []
    for name, values, columns in wanted:
        label = f"{name} (data)" if columns is every and name in prepared.parameters else name
        if not np.isfinite(values).all():
            unusable.append(label)
            continue
        regions = quantile_regions(label, values)
        if len(regions) > 1:
            chosen.append((regions, columns))
        else:
            constant.append(label)
    said = []
    if constant:
        said.append(f"too few trials differ in {', '.join(constant)} for regions of it")
    if unusable:
        said.append(f"{', '.join(unusable)}: NaN or infinite values; no regions of it")
    return chosen, tuple(said)
