"""The result of locate, name, extend, confirm: what discovery.json and discovery.nc hold."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from html import escape
from typing import Any

import xarray as xr

from gaugeblock.simulators.library import LibraryEffect
from gaugeblock.validate.finding import NotChecked

HALF_OF_90 = 1.645
"""Standard deviations to either side of a 90% interval."""


@dataclass(frozen=True)
class Region:
    """Channels (or coordinates of the data) ``start:stop`` that hold more or less than chance allows.

    `lo` and `hi` in `unit`; `excess` counts observed minus expected, where counts are what is measured.
    """

    start: int
    stop: int
    lo: float
    hi: float
    unit: str
    z: float
    p_global: float
    excess: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Plain data; energies in keV have keys of their own besides."""
        energies = {"energy_lo_kev": self.lo, "energy_hi_kev": self.hi} if self.unit == "keV" else {}
        return energies | _fields(self)


@dataclass(frozen=True)
class Disagreement:
    """Where simulation and data disagree, and how surely.

    `p_global` of any disagreement, `p_effects` of the strongest effect of the library, `p_windows`,
    `p_quantiles` and `p_moments` of looks that know nothing of it (None where not taken), `p_left` of any
    disagreement that the added effects leave; none is below ``1 / (replicates + 1)``.
    """

    p_global: float
    p_effects: float
    p_left: float
    replicates: int
    regions: tuple[Region, ...]
    p_windows: float | None = None
    p_quantiles: float | None = None
    p_moments: float | None = None


@dataclass(frozen=True)
class CandidateSaid:
    """What is said of one effect of the library.

    `z`, `p_global`, `information_kept`, `smallest_detectable` of its score; `gain` of its fit, where it was
    fitted; `held_out` with its error of the model `held_out_model`, where that was scored.
    """

    effect: str
    parameters: Mapping[str, float]
    z: float
    p_global: float
    information_kept: float
    smallest_detectable: float | None
    gain: float | None
    amplitude: str
    unit: str
    cause: str
    held_out: float | None
    held_out_error: float | None
    held_out_model: str | None
    in_set: bool


@dataclass(frozen=True)
class Estimate:
    """A value, its 90% interval, None where there is none, and whether its prior's end stopped it."""

    value: float
    low: float | None = None
    high: float | None = None
    at_limit: bool = False


@dataclass(frozen=True)
class Identification:
    """A known line or edge at an energy at rest, and the chance that one of the list is as near by chance.

    `shift_ev` is by how much what was recorded lies above where it would be, gain neutral and nothing moving;
    `frame` where it is at rest: ``"source"``, ``"interstellar"`` matter or the ``"detector"``.
    """

    name: str
    energy_kev: float
    chance: float
    shift_ev: float = 0.0
    frame: str = "source"


@dataclass(frozen=True)
class FollowerSaid:
    """What comes with a line, at `energy_kev` as recorded: its `ratio` to the line's amplitude (of an edge
    its depth) with the standard error; `expected` where that is known, which would stand out by `power`
    standard errors. `seen` is null where these data cannot tell.
    """

    name: str
    energy_kev: float
    ratio: float
    error: float
    expected: float | None
    power: float | None
    seen: bool | None


@dataclass(frozen=True)
class FamilySaid:
    """What comes with a `line`, if it is that: `stages` are the ionisations that fit, the lowest first, of
    which the `followers` are. Where one of a known ratio is seen, `chance` is that of seeing as much at some
    other place.
    """

    line: str
    stages: tuple[str, ...]
    followers: tuple[FollowerSaid, ...]
    chance: float | None = None


@dataclass(frozen=True)
class Shifted:
    """Lines that are known ones, off by one `factor`, with its 90% interval and the chance of coincidence of
    all of them: by a ``"gain"``, a ``"motion"``, or either, in `causes`.
    """

    lines: tuple[Identification, ...]
    factor: float
    low: float
    high: float
    chance: float
    causes: tuple[str, ...]


@dataclass(frozen=True)
class Statement:
    """One thing that is claimed: an effect, or ``"unnamed"``, and those that data cannot tell from it.

    `certain` says that the excess is there, whatever its name; `probability` that one of `indistinguishable`
    is right; `evidence` what it wins in nats. `parameters` with 90% intervals: the amplitude from one
    half of the counts (all of them chose the name), an effect's energies and widths from all, as recorded; of
    what has no name `excess_counts`, from a half that did not choose where. `energy_lo_kev` and
    `energy_hi_kev` are where it acts. `within_gain` are known lines or edges at a distance that an error of
    the gain would bridge, where none is identified. `family` is what comes with the line that it may be,
    `shifted` the known lines that it and other certain statements are together.
    """

    effect: str
    indistinguishable: tuple[str, ...]
    certain: bool
    probability: float
    evidence: float
    identification: tuple[Identification, ...]
    parameters: Mapping[str, Estimate]
    energy_lo_kev: float | None
    energy_hi_kev: float | None
    text: str
    within_gain: tuple[Identification, ...] = ()
    family: FamilySaid | None = None
    shifted: Shifted | None = None


@dataclass(frozen=True)
class Beside:
    """An amplitude once nuisances that all sources share have taken their part."""

    value: float
    interval: tuple[float, float]
    nuisances: tuple[str, ...]


@dataclass(frozen=True)
class Amplitude:
    """An amplitude with its interval; `held_out` says whether from one half of the counts.

    `others` are the effect's other parameters in the same fit.
    """

    effect: str
    parameter: str
    value: float
    interval: tuple[float, float]
    level: float
    unit: str
    neutral: float
    held_out: bool
    standard_error: float | None = None
    beside_nuisances: Beside | None = None
    others: Mapping[str, Estimate] = field(default_factory=dict)

    @classmethod
    def of(
        cls, effect: str, entry: LibraryEffect, value: float, interval: tuple[float, float], *,
        level: float = 0.9, held_out: bool = False, error: float | None = None, beside: Beside | None = None,
        others: Mapping[str, Estimate] | None = None,
    ) -> Amplitude:  # fmt: skip
        """Of an effect of the library, with its names and unit."""
        name, unit = entry.amplitude, entry.units.get(entry.amplitude, "")
        return cls(
            effect, name, value, interval, level, unit, entry.neutral, held_out, error, beside, others or {}
        )


@dataclass(frozen=True)
class Sides:
    """A gap before and after the named effects are in the model; None where not taken."""

    before: float | None
    after: float | None
    before_error: float | None = None
    after_error: float | None = None


@dataclass(frozen=True)
class UnderPrior:
    """Delta log evidence under a prior of the amplitude that is `prior` times as wide."""

    prior: float
    value: float
    lower_bound: bool


@dataclass(frozen=True)
class EvidenceSaid:
    """Log evidence with the first named effect minus the one without; None where not taken."""

    value: float | None = None
    error: float | None = None
    sensitivity: tuple[UnderPrior, ...] = ()


@dataclass(frozen=True)
class Gap:
    """How far model and data are apart: `measure` says what is compared."""

    measure: str
    in_sample: Sides
    held_out: Sides
    delta_log_evidence: EvidenceSaid = EvidenceSaid()


@dataclass(frozen=True)
class Decoy:
    """A model that was not named, on held-out data: a rival, a smooth correction, a random shape."""

    name: str
    kind: str
    held_out: float
    held_out_error: float
    deviance: float


@dataclass(frozen=True)
class Withdrawn:
    """A name that was found and did not hold."""

    effect: str
    why: str


@dataclass(frozen=True)
class PriorSaid:
    """What is known of an effect beforehand: its `odds`, those of the commonest being 1; `range` of every
    parameter's prior; `usual` ranges, of parameters or sizes derived from them, beyond which it falls as the
    cube; `limits` at which a value is stopped.
    """

    odds: float
    range: Mapping[str, tuple[float, float]]
    usual: Mapping[str, tuple[float, float]]
    limits: Mapping[str, tuple[float, ...]]

    @classmethod
    def of(cls, entry: LibraryEffect) -> PriorSaid:
        """Of an effect of the library."""
        spans = {name: one.support for name, one in entry.parameters.items()}
        return cls(entry.odds, spans, dict(entry.usual), entry.limits)


@dataclass(frozen=True)
class EffectSaid:
    """What the library says of an effect."""

    cause: str
    typical: str
    origin: str
    units: Mapping[str, str]
    prior: PriorSaid


@dataclass(frozen=True)
class DataSaid:
    """What was searched; `counts` where it was counts."""

    name: str
    n_sources: int
    n_channels: int
    counts: int | None = None


@dataclass(frozen=True)
class FitState:
    """A fit: `parameters` by name with 90% intervals (of many sources or data sets their median, 16 and 84%);
    `statistic` the deviance over all `bins`, which is Cash's where counts are Poisson; None where not taken.
    `w_statistic` is XSPEC's W over the `w_bins` of the source there, where a background was measured: for
    comparison, nothing is decided by it.
    """

    parameters: Mapping[str, Estimate]
    statistic: float | None = None
    bins: int | None = None
    w_statistic: float | None = None
    w_bins: int | None = None


@dataclass(frozen=True)
class FitSaid:
    """The fit before and after the named effects are in the model."""

    before: FitState
    after: FitState | None


def spread(names: Sequence[str], rows: Any) -> dict[str, Estimate]:
    """Median, low and high ``(3, parameter)`` over sources or data sets, by name."""
    columns = zip(names, *rows, strict=True)
    return {name: Estimate(float(value), float(low), float(high)) for name, value, low, high in columns}


@dataclass(frozen=True)
class Catalogue:
    """What many sources say together: of the first effect, and of the frame in which residuals lie still."""

    n: int
    fixed_to: str | None = None
    statement: str | None = None
    z: float | None = None
    z_beside_nuisances: float | None = None
    floor: float | None = None
    sandwich_error: float | None = None
    effective_sources: float | None = None


@dataclass(frozen=True)
class EValueSaid:
    """Split likelihood ratio, natural logs: `log_own` of the named effects, `log` with the choice among all
    `paths` paid for.
    """

    log: float
    p: float
    log_own: float
    paths: float


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Discovery:
    """What was found, what it was told apart from, and what it did to the gap.

    Attributes
    ----------
    statements : tuple of Statement
        What is claimed, in order; what remains comes last.
    named : str or None
        The first certain name; ``"unnamed"`` if an excess is certain but no name; the likeliest name where
        nothing is certain; or None.
    named_all : tuple of str
        The effects in the order they were added.
    indistinguishable : tuple of str
        The effects that the data cannot tell from `named`, itself first.
    tree : xarray.DataTree
        Arrays behind it, as in discovery.nc.
    """

    statements: tuple[Statement, ...]
    named: str | None
    named_all: tuple[str, ...]
    indistinguishable: tuple[str, ...]
    withdrawn: Withdrawn | None
    model_before: str
    model_after: str
    disagreement: Disagreement
    candidates: tuple[CandidateSaid, ...]
    gap: Gap
    decoys: tuple[Decoy, ...]
    amplitude: tuple[Amplitude, ...]
    fit: FitSaid
    catalogue: Catalogue | None
    e_value: EValueSaid | None
    remarks: tuple[str, ...]
    not_checked: tuple[NotChecked, ...]
    effects: Mapping[str, EffectSaid]
    data: DataSaid
    provenance: Mapping[str, Any] = field(default_factory=dict)
    tree: xr.DataTree = field(default_factory=xr.DataTree)

    @property
    def p_global(self) -> float:
        """Global p of the disagreement."""
        return self.disagreement.p_global

    def candidate(self, effect: str) -> CandidateSaid:
        """What is said of one candidate.

        Raises
        ------
        KeyError
            If it was not a candidate.
        """
        for one in self.candidates:
            if one.effect == effect:
                return one
        raise KeyError(effect)

    def with_provenance(self, provenance: Mapping[str, Any]) -> Discovery:
        """The same with what tells where it came from: seeds, versions, digests."""
        return replace(self, provenance=provenance)

    def to_json(self) -> dict[str, Any]:
        """Plain data, as in discovery.json: the same keys whatever was searched; no NaN, null instead."""
        return {key: value for key, value in _fields(self).items() if key != "tree"}

    def __repr__(self) -> str:
        rows = "\n".join(f"  {name}: {value}" for name, value in self._rows())
        return f"Discovery of {_named(self.data.name)}: {self._word}\n{rows}"[:1990]

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th style='text-align:left'>{escape(name)}</th>"
            f"<td style='text-align:left'>{escape(value)}</td></tr>"
            for name, value in self._rows()
        )
        title = f"<strong style='font-size:1.4em'>{escape(self._word)}</strong>"
        return f"<div>{title} in {escape(_named(self.data.name))}<table>{rows}</table></div>"

    @property
    def _word(self) -> str:
        if self.named is None:
            return "no disagreement" if self.withdrawn is None else "no name holds"
        alike = [name.replace("_", " ") for name in self.indistinguishable]
        return " or ".join(alike) if len(alike) > 1 else " + ".join(self.named_all or (self.named,))

    def _rows(self) -> list[tuple[str, str]]:
        """Name and value of what a reader asks first."""
        found = self.disagreement
        rows = [("model", _named(self.model_before)), ("because", self.remarks[0] if self.remarks else "")]
        rows.append(("global p of a disagreement", f"{found.p_global:.3g}"))
        for one in found.regions[:1]:
            span = f"{one.lo:.4g} to {one.hi:.4g} {one.unit}, z = {one.z:+.1f}"
            rows.append(("most at", span.replace(" ,", ",")))
        for side, gap in (("held-out", self.gap.held_out), ("in-sample", self.gap.in_sample)):
            if gap.before is not None:
                after = "" if gap.after is None else f" before, {gap.after:.4g} after"
                rows.append((f"{side} gap ({self.gap.measure})", f"{gap.before:.4g}{after}"))
        for amplitude in self.amplitude[:4]:
            low, high = amplitude.interval
            interval = f"{100 * amplitude.level:.0f}% {low:.4g} to {high:.4g}"
            value = f"{amplitude.value:.4g} {amplitude.unit}".rstrip()
            rows.append((f"{amplitude.effect}: {amplitude.parameter}", f"{value} ({interval})"))
        best = [f"{_named(one.effect)} (z = {one.z:.1f})" for one in self.candidates[:4]]
        rows.append(("candidates", ", ".join(best)))
        return rows


def _named(text: str) -> str:
    return text if len(text) < 90 else f"{text[:87]}..."


def _fields(one: Any) -> dict[str, Any]:
    return {field.name: _plain(getattr(one, field.name)) for field in fields(one) if field.name != "tree"}


def _plain(value: Any) -> Any:
    """JSON's own types all the way down."""
    if isinstance(value, Region):
        return value.to_json()
    if is_dataclass(value):
        return _fields(value)
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(one) for one in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value
