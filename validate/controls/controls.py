"""Positive controls: the audit's own draws with faults of known size put in, through the audit's own gates.

What an audit of these trials, on these shapes, would have caught is measured and not looked up: truths are
taken from the draws (`control_trials`), so that whatever is found is the fault that was put in.

- ``controls.bias[p]`` and ``controls.width[p]``: nothing is put in. Draws that are moved by so many of
  their half-widths move ``sbc.bias`` by just that; draws that are stretched about their median move
  ``sbc.log_width`` by the log of the factor. So one control stands for faults of all sizes.
- ``controls.region[p]``: draws moved by a few sizes in an eighth of the trials, at one end of the data
  feature that says most, and ``local.coverage``.
- ``controls.loss``: data read with a few sizes of noise, and ``informed.rank``.

Nothing is judged here; `ladder` holds them against a policy.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.streams import generator
from gaugeblock.validate.controls.control_trials import blurred, control_trials, displaced
from gaugeblock.validate.finding import Finding, NotChecked, PValueFinding, QuantileFinding
from gaugeblock.validate.learned.informed.challenger import Known
from gaugeblock.validate.learned.informed.data import data_of, feature_names
from gaugeblock.validate.learned.informed.informed import WITHOUT_DATA
from gaugeblock.validate.learned.informed.learning import learn
from gaugeblock.validate.learned.informed.pools import pools_of
from gaugeblock.validate.learned.learned import LEAST_TRIALS as LEAST_TAUGHT
from gaugeblock.validate.local.declared import location
from gaugeblock.validate.local.local import regional
from gaugeblock.validate.marginal.half_widths import bias_finding, half_widths, log_width_finding
from gaugeblock.validate.prepared import Prepared, effective_draws, pit

LEAST_TRIALS, LEAST_DRAWS = 100, 20
SHARE = 8  # the region is one in so many trials
SHIFTS = (0.5, 0.8, 1.3, 2.0, 3.0)
# Noise in each parameter, in half-widths over the root of the number of parameters; the first to be tried.
NOISE, FIRST = (0.12, 0.18, 0.25, 0.35, 0.5, 0.7, 1.0, 1.4), 0.5
# About how many standard errors beyond the tolerance a fault is caught nine times in ten.
REACH = 5.5
# About what policies tolerate of a challenger's rank; it decides only which sizes are tried.
TOLERATED = 0.018
KIND = {
    "bias": "controls.bias",
    "width": "controls.width",
    "region": "controls.region",
    "loss": "controls.loss",
}
REFERENCE = "a draw in place of the truth: exchangeable for any shape"
WORDS: dict[str, Any] = {"quantity": "", "reference": REFERENCE, "p_value": math.nan}


def controls(prepared: Prepared) -> list[Finding | NotChecked]:
    """What the audit's own gates say of faults of known size in its own draws."""
    n, draws = len(prepared.trial), prepared.kept_draws
    if n < LEAST_TRIALS or draws < LEAST_DRAWS:
        why = f"{n} trial(s) of {draws} finite draws; controls need {LEAST_TRIALS} of {LEAST_DRAWS}"
        return [NotChecked("controls", why)]
    return [*_marginal(prepared), *_regional(prepared), *_loss(prepared)]


def _marginal(prepared: Prepared) -> list[Finding | NotChecked]:
    control = control_trials(prepared, "as they are")
    control.compute([pit, half_widths, effective_draws])
    said: list[Finding | NotChecked] = []
    for column, name in enumerate(prepared.parameters):
        scores, ranks = control.per_trial(half_widths)[:, column], control.pit[:, column]
        bias = bias_finding(name, scores, ranks)
        width = log_width_finding(name, scores, ranks, draws=control.effective_draws)
        assert isinstance(width, QuantileFinding)
        # Stretched about their median, draws that equal it stay.
        still = xr.Dataset({"still": ("value_trial", scores[:, 0] == 0)})
        said += [
            replace(
                bias, **WORDS, id=f"{KIND['bias']}[{name}]",
                claim=f"shift that centres draws of {name} that play the truth, in half-widths",
            ),
            replace(
                width, **WORDS, id=f"{KIND['width']}[{name}]", details=still,
                claim=f"log width of intervals of {name} for draws that play the truth",
            ),
        ]  # fmt: skip
    return said


def _regional(prepared: Prepared) -> list[Finding | NotChecked]:
    where, member = region_of(prepared)
    runs: list[list[tuple[float, float]]] = []
    for size in SHIFTS:
        control = control_trials(prepared, f"moved by {size}", displaced(size * member))
        control.compute([pit, half_widths, location])
        found = regional(control)
        if isinstance(found, str):
            return [NotChecked(KIND["region"], "calibration within regions could not be checked")]
        runs.append(worst(found[1], prepared.parameters))
        if all(estimate > 2 * REACH * error for estimate, error in runs[-1]):
            break
    return [
        _rungs(
            f"{KIND['region']}[{name}]", SHIFTS[: len(runs)], [run[column] for run in runs],
            claim=f"coverage gap of {name}, where it shows best, of draws that lie so many half-widths too "
            f"high where {where}",
            n=len(prepared.trial), where=where,
        )
        for column, name in enumerate(prepared.parameters)
    ]  # fmt: skip


def region_of(prepared: Prepared) -> tuple[str, NDArray[np.bool_]]:
    """About an eighth of the trials, at one end of the feature that says most: in words, and ``(trial,)``."""
    order = np.argsort(prepared.trial)
    place = prepared.per_trial(location)[:, 0]
    columns = [(f"the location of {prepared.parameters[0]}", place)]
    features = prepared.features
    if features is not None:
        named = [(name, features.column(name)) for name in features.names]
        usable = [(name, column) for name, column in named if np.isfinite(column).all()]
        strength = [_says(column[order], prepared.theta_true[order]) for _, column in usable]
        columns = [usable[index] for index in np.argsort(-np.array(strength), kind="stable")] + columns
    eighth = len(order) / SHARE
    for name, column in columns:
        high, low = np.quantile(column, [1 - 1 / SHARE, 1 / SHARE])
        for sign, edge, member in (("least", high, column >= high), ("most", low, column <= low)):
            if eighth / 2 <= member.sum() <= 2 * eighth:
                told = prepared.once(feature_names).get(name, name)
                return f"{told} is at {sign} {edge:.3g}", np.asarray(member)
    # Ties leave no such end: the first trials by their number.
    return f"the trial is one of the first {eighth:.0f}", np.argsort(order) < eighth


def _says(feature: Array, truths: Array) -> float:
    """The largest rank correlation with a parameter."""
    both = np.column_stack([feature, truths])
    ranks = np.argsort(np.argsort(both, axis=0, kind="stable"), axis=0)
    away = ranks - ranks.mean(axis=0)
    along = away[:, 1:].T @ away[:, 0] / (away[:, 0] ** 2).sum()
    return float(np.abs(along).max()) if np.ptp(feature) > 0 else 0.0


def worst(findings: Sequence[Finding], names: Sequence[str]) -> list[tuple[float, float]]:
    """Size and error of the component of each parameter that is farthest from 0 for certain."""
    best = dict.fromkeys(names, (-math.inf, 0.0, math.inf))
    for finding in findings:
        certain = np.abs(finding.estimate) - REACH * finding.standard_error
        for index, label in enumerate(finding.components):
            owner = max((one for one in names if label.startswith(f"{one} ")), key=len, default="")
            if owner and certain[index] > best[owner][0]:
                size, error = abs(float(finding.estimate[index])), float(finding.standard_error[index])
                best[owner] = (float(certain[index]), size, error)
    return [best[name][1:] for name in names]


def _loss(prepared: Prepared) -> list[Finding | NotChecked]:
    if prepared.features is None:
        return [NotChecked(KIND["loss"], WITHOUT_DATA, without_data=True)]
    n = len(prepared.trial)
    if n < LEAST_TAUGHT:
        why = f"{n} trial(s) with finite draws; a challenger learns from {LEAST_TAUGHT}"
        return [NotChecked(KIND["loss"], why)]
    by_number = np.argsort(prepared.trial)
    data = data_of(prepared, by_number)
    order = generator(prepared.seed, "order of the controls", n).permutation(n)
    found: dict[float, tuple[float, tuple[float, float]]] = {}
    place, step = NOISE.index(FIRST), 0
    while 0 <= place < len(NOISE):
        noise = NOISE[place]
        fault = blurred(noise / math.sqrt(len(prepared.parameters)))
        control = control_trials(prepared, f"blurred by {noise}", fault)
        pooled = pools_of(control).taken(by_number)
        wider = control.log_wider[by_number]
        wider = wider[np.isfinite(wider)]
        if not wider.any():
            return [NotChecked(KIND["loss"], "no trial's draws have a width that noise could add to")]
        told = learn(Known(pooled, data, pooled.summaries(), prepared.parameters), order=order)
        value = told.weight * (0.5 - told.pit)
        error = math.sqrt(max(float(np.mean(told.weight**2)) / 12, float(value.var())) / len(value))
        found[noise] = float(wider.mean()), (float(value.mean()), error)
        # Down from what is caught, up from what is not, until that changes.
        towards = -1 if value.mean() > TOLERATED + REACH * error else 1
        if step == -towards:
            break
        step = towards
        place += step
    sizes, gaps = zip(*(found[noise] for noise in sorted(found)), strict=True)
    return [
        _rungs(
            KIND["loss"], sizes, gaps,
            claim="rank of the truth in a challenger's score, where data are read with noise that widens "
            "posteriors so much, natural log",
            n=n,
        )
    ]  # fmt: skip


def _rungs(
    identifier: str,
    sizes: Sequence[float],
    found: Sequence[tuple[float, float]],
    *,
    claim: str,
    n: int,
    where: str = "",
) -> Finding:
    return PValueFinding(
        id=identifier, quantity="", claim=claim, null="0, exactly, for a fault of size 0",
        reference=REFERENCE, n_trials=n, components=tuple(f"{size:.3g}" for size in sizes),
        estimate=np.array([estimate for estimate, _ in found]),
        standard_error=np.array([error for _, error in found]),
        details=xr.Dataset({"size": ("component", np.array(sizes))}),
        caveats=(where,) if where else (),
    )  # fmt: skip
