"""Simulation-based calibration: bias, width and rank uniformity of every parameter.

``sbc.bias[p]`` and ``sbc.log_width[p]``, of the bulk of posteriors of any shape (`half_widths`), are in units
that a tolerance can be stated in; ``sbc.uniform[p]`` and ``sbc.smooth[p]`` are p-values, reported and never
judged: with enough trials every estimator fails a rank test, and a p-value above 0.05 is never a PASS.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.finding import Finding, NotChecked, PValueFinding
from gaugeblock.validate.marginal.half_widths import bias_finding, half_widths, log_width_finding
from gaugeblock.validate.marginal.smooth import smooth_finding
from gaugeblock.validate.marginal.uniformity import ecdf_test
from gaugeblock.validate.prepared import Prepared

REFERENCE = "Talts et al. 2018, arXiv:1804.06788; Modrak et al. 2023, arXiv:2211.02383"
BAND_REFERENCE = "Säilynoja, Bürkner & Vehtari 2022, arXiv:2103.10522"
LEAST_TRIALS = 2


def sbc(prepared: Prepared) -> list[Finding | NotChecked]:
    """Bias, log width and rank uniformity per parameter, from the unaffected trials."""
    n = len(prepared.trial)
    if n < LEAST_TRIALS:
        why = f"{n} trial(s) with finite draws; at least {LEAST_TRIALS} are needed"
        return [NotChecked(f"sbc.{what}", why) for what in ("bias", "log_width", "uniform", "smooth")]
    findings: list[Finding | NotChecked] = []
    for column, name in enumerate(prepared.parameters):
        scores, pit = prepared.per_trial(half_widths)[:, column], prepared.pit[:, column]
        findings += [
            bias_finding(name, scores, pit, caveats=prepared.caveats),
            log_width_finding(name, scores, pit, draws=prepared.effective_draws, caveats=prepared.caveats),
            uniform_finding(name, pit, trial=prepared.trial, caveats=prepared.caveats),
            smooth_finding(name, pit, caveats=prepared.caveats),
        ]
    return findings


def uniform_finding(
    name: str, pit: Array, *, trial: NDArray[np.int64] | None = None, caveats: tuple[str, ...] = ()
) -> Finding:
    """Uniformity of one parameter's randomised PIT ``(trial,)``: simultaneous ECDF band and its p-value."""
    test = ecdf_test(pit)
    details = {
        "pit": ("trial", pit),
        "ecdf_difference": ("evaluation_point", test.difference),
        "band_low": ("evaluation_point", test.low),
        "band_high": ("evaluation_point", test.high),
    }
    return PValueFinding(
        id=f"sbc.uniform[{name}]",
        quantity="",
        claim=f"largest distance of the rank ECDF of {name} from uniform",
        null="randomised ranks uniform, exactly, for an exact posterior",
        reference=BAND_REFERENCE + "; " + REFERENCE,
        n_trials=len(pit),
        components=(name,),
        estimate=np.array([np.abs(test.difference).max()]),
        standard_error=np.array([np.nan]),
        p_value=test.p_value,
        details=_details(details, trial).assign_coords(evaluation_point=test.point),
        caveats=caveats,
    )


def _details(variables: dict[str, tuple[str, Array]], trial: NDArray[np.int64] | None) -> xr.Dataset:
    return xr.Dataset(variables, coords={} if trial is None else {"trial": trial})
