"""Simulation-based calibration: bias, width and rank uniformity of every parameter.

``sbc.bias[p]`` and ``sbc.log_width[p]`` are in units that a tolerance can be stated in; ``sbc.uniform[p]``
and ``sbc.smooth[p]`` are p-values, reported and never judged: with enough trials every estimator fails a rank
test, and a p-value above 0.05 is never a PASS.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.validate.finding import Finding, MeanFinding, NotChecked, PValueFinding
from gaugeblock.validate.marginal.smooth import smooth_finding
from gaugeblock.validate.marginal.uniformity import ecdf_test
from gaugeblock.validate.p_values import two_sided
from gaugeblock.validate.prepared import Prepared
from gaugeblock.validate.standardised import bias, log_width

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
        errors, pit = prepared.errors[:, column], prepared.pit[:, column]
        findings += [
            bias_finding(name, errors, trial=prepared.trial, caveats=prepared.caveats),
            log_width_finding(name, errors, draws=prepared.effective_draws, caveats=prepared.caveats),
            uniform_finding(name, pit, trial=prepared.trial, caveats=prepared.caveats),
            smooth_finding(name, pit, caveats=prepared.caveats),
        ]
    return findings


def bias_finding(
    name: str, errors: Array, *, trial: NDArray[np.int64] | None = None, caveats: tuple[str, ...] = ()
) -> Finding:
    """Bias of one parameter in posterior sd, from standardised errors ``(trial,)``; positive: too high."""
    return _moment_finding(
        "bias",
        name,
        bias(errors),
        claim=f"bias of {name} in posterior standard deviations; positive: the estimator lies too high",
        null="mean standardised error 0, exactly, for an exact posterior of any shape",
        details=_details({"standardised_error": ("trial", errors)}, trial),
        caveats=caveats,
    )


def log_width_finding(
    name: str, errors: Array, *, draws: float = np.inf, caveats: tuple[str, ...] = ()
) -> Finding:
    """Log width ratio of one parameter, from standardised errors ``(trial,)``; negative: too narrow."""
    return _moment_finding(
        "log_width",
        name,
        log_width(errors, draws=draws),
        claim=f"natural log of estimated over true posterior width of {name}; negative: too narrow",
        null="standardised errors of variance 1, exactly, for an exact posterior of any shape",
        details=xr.Dataset(),
        caveats=caveats,
    )


def _moment_finding(
    quantity: str,
    name: str,
    moment: tuple[float, float, Array],
    *,
    claim: str,
    null: str,
    details: xr.Dataset,
    caveats: tuple[str, ...],
) -> Finding:
    """A moment of standardised errors, given as estimate, standard error and influence, as a finding."""
    estimate, standard_error, influence = moment
    return MeanFinding(
        id=f"sbc.{quantity}[{name}]",
        quantity=quantity,
        claim=claim,
        null=null,
        reference="exchangeability of the truth with its draws; " + REFERENCE,
        n_trials=len(influence),
        components=(name,),
        estimate=np.array([estimate]),
        standard_error=np.array([standard_error]),
        influence=influence[None],
        p_value=two_sided(estimate / standard_error),
        details=details,
        caveats=caveats,
    )


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
