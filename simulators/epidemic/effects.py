"""How named effects change an epidemic: what drives it, or what is reported of it.

| effect | parameters | what it does |
|---|---|---|
| `reporting_step` | share, week | from this week on, this share of the cases goes unreported |
| `reporting_delay` | share | this share of each week's cases is reported a week later |
| `missed_week` | share, week | this share of one week's cases goes unreported |
| `imported_cases` | rate (cases a week) | reported cases infected elsewhere, the same number each week |
| `contact_change` | factor, week | the contact rate is multiplied by this from this week on |
| `waning` | rate (per day) | the removed become susceptible again |
| `mixing` | exponent | infection falls faster than the susceptible share: s^(1 + exponent) |

Weeks are counted from 0 at the start of the data and need not be whole numbers: a change in mid-week counts
for its part of it. A share below 0 means that more cases are reported.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from gaugeblock.core.errors import InputError
from gaugeblock.simulators.effects import Effect, check_parameters
from gaugeblock.simulators.epidemic.course import Drive, ramp
from gaugeblock.simulators.marginals import namespace

Values = Mapping[str, Any]
"""Values of an effect's parameters by name, each an array over the batch or a number."""


@dataclass(frozen=True)
class EpidemicEffect:
    """What an effect means: the range of each parameter, and the change to drive or to reports, or to both.

    `drive` maps what drives the epidemic to what drives it now; `report` maps the mean reported cases
    ``(..., week)`` to those reported now, given the values of the parameters, of shape ``(...)``. Both must
    keep to operations that NumPy and JAX arrays share, and to analytic ones (see `course.ramp`).
    """

    parameters: Mapping[str, tuple[float, float]]
    drive: Callable[[Drive, Values], Drive] | None = None
    report: Callable[[Any, Values], Any] | None = None


def effect_kind(effect: Effect) -> EpidemicEffect:
    """What an effect means: its own `kind`, or what its name means here.

    Raises
    ------
    InputError
        If it is not known, lacks a parameter, has one too many or out of range.
    """
    kind = effect.kind if effect.kind is not None else EFFECTS.get(effect.name)
    if not isinstance(kind, EpidemicEffect):
        raise InputError(
            f"effect {effect.name!r}: not known to the epidemic; there are {', '.join(EFFECTS)}, "
            "or give an EpidemicEffect as its kind"
        )
    check_parameters(effect, kind.parameters)
    return kind


def _weeks(cases: Any) -> Any:
    """Number of each week, 0 first."""
    return namespace(cases).arange(cases.shape[-1], dtype=cases.real.dtype)


def _last(value: Any) -> Any:
    """A value over the batch with an axis for the week behind it."""
    return value[..., None] if hasattr(value, "ndim") else value


def _reporting_step(cases: Any, values: Values) -> Any:
    after = ramp(_weeks(cases) + 1.0 - _last(values["week"]))
    return cases * (1.0 - _last(values["share"]) * after)


def _reporting_delay(cases: Any, values: Values) -> Any:
    late = cases * _last(values["share"])
    from_before = namespace(cases).concatenate([0.0 * late[..., :1], late[..., :-1]], axis=-1)
    return cases - late + from_before


def _missed_week(cases: Any, values: Values) -> Any:
    since = _weeks(cases) + 1.0 - _last(values["week"])
    return cases * (1.0 - _last(values["share"]) * (ramp(since) - ramp(since - 1.0)))


def _imported_cases(cases: Any, values: Values) -> Any:
    return cases + _last(values["rate"])


def _contact_change(drive: Drive, values: Values) -> Drive:
    return replace(drive, changes=(*drive.changes, (values["week"], values["factor"])))


def _waning(drive: Drive, values: Values) -> Drive:
    return replace(drive, waning=values["rate"] if drive.waning is None else drive.waning + values["rate"])


def _mixing(drive: Drive, values: Values) -> Drive:
    more = values["exponent"]
    return replace(drive, mixing=more if drive.mixing is None else drive.mixing + more)


_WEEK = (0.0, math.inf)
_LOST = (-5.0, 0.95)

EFFECTS: Mapping[str, EpidemicEffect] = {
    "reporting_step": EpidemicEffect({"share": _LOST, "week": _WEEK}, report=_reporting_step),
    "reporting_delay": EpidemicEffect({"share": (0.0, 0.95)}, report=_reporting_delay),
    "missed_week": EpidemicEffect({"share": _LOST, "week": _WEEK}, report=_missed_week),
    "imported_cases": EpidemicEffect({"rate": (0.0, math.inf)}, report=_imported_cases),
    "contact_change": EpidemicEffect({"factor": (0.0, 4.0), "week": _WEEK}, drive=_contact_change),
    "waning": EpidemicEffect({"rate": (0.0, 1.0)}, drive=_waning),
    "mixing": EpidemicEffect({"exponent": (-0.3, 10.0)}, drive=_mixing),
}
