"""Where in data space do learned truths and draws differ? Local C2ST over the trials' own x.

``lc2st.local`` holds the ranks of the learned score (see `learned`) to the local tolerance, region by region
of the data's features; gaps count as in a twentieth of the trials. For observations in hand there is
`local_c2st`, in a file of its own.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import generator
from gaugeblock.validate.features import TrialFeatures
from gaugeblock.validate.finding import Finding, MeanFinding, NotChecked
from gaugeblock.validate.learned.c2st import spread_out
from gaugeblock.validate.learned.expected import STAGES
from gaugeblock.validate.learned.informed.data import feature_names
from gaugeblock.validate.learned.learned import LEAST_TRIALS, learned_from
from gaugeblock.validate.local.regions import LEAST, Regions, as_in_a_twentieth, quantile_regions
from gaugeblock.validate.marginal.coverage import steadied_error
from gaugeblock.validate.p_values import by_replicates
from gaugeblock.validate.prepared import Prepared

REFERENCE = (
    "Linhart, Gramfort & Rodrigues 2023, arXiv:2306.03580; ranks of the score within regions of the data"
)
LEVELS = (0.2, 0.5, 0.8)
MOST_FEATURES = 8
# Replicates of the null, fewer for very many trials: uniform numbers in all, and at a time.
REPLICATES = 999
LEAST_REPLICATES = 199
WORK = 1 << 25
CHUNK = 1 << 22


def lc2st(prepared: Prepared) -> list[Finding | NotChecked]:
    """Coverage gaps of the learned score within regions of the data's features, ranked."""
    if prepared.features is None:
        why = "needs the data of each trial (make_trials takes them as x), to say where in data space"
        return [NotChecked("lc2st.local", why)]
    n = len(prepared.trial)
    # The first stage only teaches; the others must make at least two regions.
    least = max(LEAST_TRIALS, 2 * LEAST * STAGES // (STAGES - 1))
    if n < least:
        why = f"{n} trial(s) with finite draws; regions of the data need at least {least}"
        return [NotChecked("lc2st.local", why)]
    ranks = prepared.once(learned_from)
    called = prepared.once(feature_names)
    regions = [
        replace(found, name=called[found.name]) for found in feature_regions(prepared.features, ranks.row)
    ]
    if not regions:
        return [NotChecked("lc2st.local", "no feature of the data differs enough between trials for regions")]
    finding = local_finding(
        ranks.pit, regions, row=ranks.row, n=n, order=np.argsort(prepared.trial[ranks.row]),
        seed=prepared.seed, caveats=prepared.caveats,
    )  # fmt: skip
    return [finding]


def feature_regions(features: TrialFeatures, row: NDArray[np.int64]) -> list[Regions]:
    """Regions of the data's features among the trials `row`: user's own and total first, then components."""
    known = [name for name in features.names if np.isfinite(features.column(name)).all()]
    first = sorted(known, key=lambda name: name.startswith("component "))[:MOST_FEATURES]
    cut = (quantile_regions(name, features.column(name)[row]) for name in first)
    return [regions for regions in cut if len(regions) > 1]


def local_finding(
    pit: ArrayLike,
    regions: list[Regions],
    *,
    row: NDArray[np.int64] | None = None,
    n: int | None = None,
    order: ArrayLike | None = None,
    seed: int,
    caveats: tuple[str, ...] = (),
) -> Finding:
    """Coverage minus level of a learned score in each region, from its PIT ``(scored,)``.

    `row` says which of `n` trials were scored. The one p-value is of the largest |gap| in standard errors,
    against uniform ranks with these very regions: exact. `order` sorts the trials, so that it does not depend
    on how they are stored.
    """
    u = np.asarray(pit, dtype=float)
    scored = len(u)
    where = np.arange(scored) if row is None else row
    total = scored if n is None else n
    member = np.concatenate([part.members for part in regions])
    count = member.sum(axis=1)[:, None]
    inside = u <= np.array(LEVELS)[:, None]
    hits = member.astype(float) @ inside.T.astype(float)
    gap, error = hits / count - LEVELS, steadied_error(hits, count)
    influence = (inside - (hits / count)[..., None]) * (member * (scored / count))[:, None, :]
    scale = as_in_a_twentieth(count / scored)
    names = [part.describe(region) for part in regions for region in range(len(part))]
    kept = np.arange(scored) if order is None else np.asarray(order)
    p_value, z = largest_gap(u[kept], member[:, kept], seed=seed)
    worst = np.argsort(-np.abs(z).max(axis=1), kind="stable")
    details = xr.Dataset(
        {
            "region": ("rank", np.array(names)[worst]),
            "gap": (("rank", "level"), gap[worst]),
            "z": (("rank", "level"), z[worst]),
            "n": ("rank", count[worst, 0]),
            "scale": ("component", np.repeat(scale[:, 0], len(LEVELS))),
        },
        coords={"level": list(LEVELS)},
    )
    return MeanFinding(
        id="lc2st.local",
        quantity="local",
        claim="coverage minus level of a learned score within regions of the data; below 0: truths and draws "
        "differ there; as in a twentieth of the trials",
        null="ranks of the truth's score uniform in every region of the data, for an exact posterior",
        reference=REFERENCE,
        n_trials=total,
        components=tuple(f"learned score in {name} @ {level:g}" for name in names for level in LEVELS),
        estimate=(gap * scale).ravel(),
        standard_error=(error * scale).ravel(),
        influence=spread_out((influence * scale[..., None]).reshape(-1, scored), where, total),
        p_value=p_value,
        details=details,
        caveats=caveats,
    )


def largest_gap(
    pit: ArrayLike, member: ArrayLike, *, seed: int, replicates: int | None = None
) -> tuple[float, Array]:
    """p-value of the largest gap over regions and levels, and each gap in its null standard error.

    `member` is ``(region, trial)``, the z-values ``(region, level)``.

    >>> halves = np.arange(400) < [[200], [400]]
    >>> largest_gap(np.random.default_rng(0).random(400) ** 2, halves, seed=1)[0]
    0.001
    """
    u, inside = np.asarray(pit, dtype=float), np.asarray(member, dtype=np.float32)
    if replicates is None:
        replicates = int(np.clip(WORK // max(len(u), 1), LEAST_REPLICATES, REPLICATES))
    level = np.array(LEVELS)
    scale = np.sqrt(inside.sum(axis=1)[:, None] * level * (1 - level))
    centre = inside.sum(axis=1)[:, None] * level
    z = ((u <= level[:, None]).astype(np.float32) @ inside.T).T
    observed = (z - centre) / scale
    rng = generator(seed, "largest gap", *inside.shape)

    def as_large(number: int) -> NDArray[np.bool_]:
        uniform = rng.random((number, 1, len(u)), dtype=np.float32)
        counts = np.swapaxes((uniform <= level[:, None]).astype(np.float32) @ inside.T, 1, 2)
        largest = np.abs((counts - centre) / scale).max(axis=(1, 2))
        return np.asarray(largest >= np.abs(observed).max())

    return by_replicates(as_large, replicates, at_once=max(1, CHUNK // len(u))), observed
