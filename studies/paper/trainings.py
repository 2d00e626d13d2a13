"""What another training adds to an error: scatter between trained networks, pooled over claims of a kind.

A published number is of one training, and ours is a mean over n: their difference has the error
``s sqrt(1 + 1/n)``, with s between trainings, and our number alone ``s / sqrt(n)``. Few trainings tell s
badly, so that claims of a kind lend each other what they know (`moderated`). A claim of which there is no
second training has what its kind lends, which decides nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from gaugeblock.core.arrays import Array
from studies.paper.claim import SINGLE, Claim, Counted, Kind
from studies.paper.experiment import committed
from studies.paper.moderated import Prior, prior_of
from studies.paper.numbers import by_claim

STOPPED = ("tab2.reseed101", "tab2.reseed202", "tab2.reseed303", "tab2.uncapped")
"""Bright trainings beside the published one, each another network."""

AUC, POSTERIOR = "AUC", "posterior"
"""Kinds of claims: an area under a ROC curve, and what posteriors of one level are like."""

AREAS = ("grid.", "tab1.", "tab3.", "tab4.", "det.D", "det.B3", "det.B4", "det.nicer.B1", "is.khat.B")
AREAS += ("is.sweep.", "is.null.", "sub.", "cal.spot.")


@dataclass(frozen=True, kw_only=True)
class Scatter:
    """Standard deviation between trainings, its degrees of freedom, and how many of these are its own.

    `own` are of so many `trainings`; none where the kind lends all.
    """

    sd: float
    df: float
    own: float = 0.0
    trainings: int = 1

    def error(self, trainings: int, *, published: bool = True) -> float:
        """What training adds to the error of a mean of so many of ours, against one other training or not."""
        return float(self.sd * np.sqrt(published + 1.0 / trainings))

    def freedom(self, trainings: int) -> float:
        """Degrees of freedom when there are so many: its own grow with them."""
        each = self.own / (self.trainings - 1.0) if self.own else 1.0
        return self.df + each * (trainings - self.trainings)


NONE = Scatter(sd=0.0, df=np.inf)
"""Of what no training decides."""


def kind_of(claim: Claim) -> str:
    """Of which kind a claim's variance between trainings is."""
    return AUC if claim.id.startswith(AREAS) else POSTERIOR


def scatter(claim: Claim, part: str, less: str = "", *, error: float = np.nan) -> Scatter:
    """Scatter between trainings of a part of a claim, or of what it exceeds another by.

    `error` is that of spectra, in whose units the kind lends where no second training is kept.
    """
    if claim.kind is not Kind.FLOW:
        return NONE
    prior = _priors().get(kind_of(claim))
    # A row of table 2 is one network's, of a seed of its own: its others are the other rows.
    rows = _of_deviations() if claim.id.startswith("tab2.") and part == "dev" else _row(claim, part, less)
    if prior is None:
        return Scatter(sd=np.nan, df=np.nan)
    if rows is None:
        return Scatter(sd=error * np.sqrt(prior.scale), df=min(prior.df, prior.most))
    values, unit = rows
    trainings = values.shape[1]
    own = len(values) * (trainings - 1.0)
    variance = prior.squeezed(float(values.var(axis=1, ddof=1).mean()) / unit**2, own)
    total = min(prior.df + own, max(prior.most, own))
    return Scatter(sd=float(unit * np.sqrt(variance)), df=total, own=own, trainings=trainings)


@cache
def _priors() -> Mapping[str, Prior]:
    """What is known of the variances of every kind: of judged claims, in units of each one's own error.

    Of those with as many trainings as any has.
    """
    from studies.paper.registry import claims

    found: dict[str, list[Array]] = {}
    for claim in claims().values():
        if claim.counted is not Counted.JUDGED or claim.kind is not Kind.FLOW:
            continue
        margins = {(m.part, m.less) for rule in claim.rules for m in rule.margins(claim.parts)}
        for part, less in sorted(margins):
            if (row := _row(claim, part, less)) is not None:
                found.setdefault(kind_of(claim), []).append(row[0][0] / row[1])
    most = max(len(row) for rows in found.values() for row in rows)
    return {
        kind: prior_of(np.stack([row for row in rows if len(row) == most])) for kind, rows in found.items()
    }


def _row(claim: Claim, part: str, less: str) -> tuple[Array, float] | None:
    """What every training gives ``(1, training)``, and the error of spectra that is its unit.

    None where no second training is kept, or all gave the same: that is of no training then.
    """
    values, errors = (parts.get(claim.id, {}) for parts in _trained(claim.by))
    names = (part, less) if less else (part,)
    if any(name not in values or not errors[name] > 0 for name in names):
        return None
    row = values[part] - (values[less] if less else 0.0)
    unit = np.sqrt(sum(errors[name] ** 2 for name in names))
    if claim.id.startswith("grid."):
        unit = claim.error[SINGLE[0]]
    return (row[None], float(unit)) if np.ptp(row) > 0 else None


@cache
def _trained(experiment: str) -> tuple[dict[str, dict[str, Array]], dict[str, dict[str, float]]]:
    """What every kept training gives, ``(training,)`` by claim and part, and errors of spectra.

    Nothing where there is but one.
    """
    table = committed(experiment)
    if table is None or "trained" not in table:
        return {}, {}
    found: dict[str, dict[str, Array]] = {}
    errors: dict[str, dict[str, float]] = {}
    columns = (table["claim"].values, table["part"].values, table["trained"].values.T)
    for claim, part, values, error in zip(*columns, table["standard_error"].values, strict=True):
        found.setdefault(str(claim), {})[str(part)] = values
        errors.setdefault(str(claim), {})[str(part)] = float(error)
    return found, errors


def by_training(claim: Claim, part: str = SINGLE[0]) -> Array | None:
    """What every kept training gives ``(training,)`` for a part of a claim; None where there is but one."""
    return _trained(claim.by)[0].get(claim.id, {}).get(part)


@cache
def _of_deviations() -> tuple[Array, float]:
    """Coverage deviations ``(ours or the study's, training)`` of the bright trainings, and our error."""
    from studies.paper.registry import claims

    ours: dict[str, dict[str, float]] = {}
    errors: dict[str, dict[str, float]] = {}
    for table in map(committed, ("calibration_published", "calibration_retrained")):
        assert table is not None
        ours |= by_claim(table)
        errors |= by_claim(table, "standard_error")
    rows = [[ours[name]["dev"] for name in STOPPED], [claims()[name].parts["dev"] for name in STOPPED]]
    return np.array(rows), float(np.sqrt(np.mean([errors[name]["dev"] ** 2 for name in STOPPED])))
