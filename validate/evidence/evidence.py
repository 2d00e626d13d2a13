"""Log evidences that come with errors: how large the errors are, and whether they hold.

Trials may carry ``log_evidence``, ``log_evidence_error`` and, where an exact value is known,
``log_evidence_true``, each ``(trial,)`` in nat. For runs of a nested sampler, `thread_bootstrap` gives the
errors and `evidence_difference` those of differences; the findings here report them.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy import special

from gaugeblock.validate.finding import Finding, MeanFinding, NotChecked
from gaugeblock.validate.p_values import SMALLEST
from gaugeblock.validate.prepared import Prepared
from gaugeblock.validate.quantiles import quantile_finding
from gaugeblock.validate.standardised import bias, log_width

REFERENCE = "Higson et al. 2018, arXiv:1704.03459"
NEEDED = ("log_evidence", "log_evidence_error")
TRUTH = "log_evidence_true"
LEAST_TRIALS = 2


def evidence(prepared: Prepared) -> list[Finding | NotChecked]:
    """Stated errors of the trials' log evidences, and their pulls against exact values."""
    main = prepared.main
    missing = [name for name in NEEDED if name not in main]
    if missing:
        why = (
            f"the trials lack {', '.join(missing)}; give the estimator's log evidence and its error per "
            "trial, for example from thread_bootstrap of a nested-sampling run"
        )
        return [NotChecked("evidence.error", why), NotChecked("evidence.pull", why)]
    value, error = (np.asarray(main[name].values[prepared.unaffected], dtype=float) for name in NEEDED)
    known = np.isfinite(value) & np.isfinite(error) & (error > 0)
    left_out = len(known) - np.count_nonzero(known)
    caveats: tuple[str, ...] = ()
    if left_out:
        caveats = (f"{left_out} of {len(known)} trials have no finite log evidence and error; left out here",)
    if np.count_nonzero(known) < LEAST_TRIALS:
        why = f"{np.count_nonzero(known)} trial(s) with a finite log evidence and error; 2 are needed"
        return [NotChecked("evidence.error", why), NotChecked("evidence.pull", why)]
    said: list[Finding | NotChecked] = [
        error_finding(error[known], trial=prepared.trial[known], caveats=caveats)
    ]
    if TRUTH not in main:
        why = f"the trials lack {TRUTH}; give the exact log evidence of each trial where it can be computed"
        return [*said, NotChecked("evidence.pull", why)]
    truth = np.asarray(main[TRUTH].values[prepared.unaffected], dtype=float)[known]
    if not np.isfinite(truth).all():
        return [*said, NotChecked("evidence.pull", f"{TRUTH} has NaN or infinite values")]
    return [
        *said,
        pull_finding(
            value[known], error[known], truth,
            trial=prepared.trial[known], population="evidence" if left_out else "trials", caveats=caveats,
        ),
    ]  # fmt: skip


def pull_finding(
    log_evidence: ArrayLike,
    error: ArrayLike,
    truth: ArrayLike,
    *,
    trial: ArrayLike | None = None,
    population: str = "trials",
    caveats: tuple[str, ...] = (),
) -> Finding:
    """Mean and width of the pulls (log evidence - truth) / error, each argument ``(trial,)``.

    The mean is in stated errors; the log width is that of the stated errors over the actual ones, negative
    where errors are understated. The p-value is of both together, by their joint normal law.
    """
    pull = (np.asarray(log_evidence, dtype=float) - np.asarray(truth)) / np.asarray(error, dtype=float)
    mean, width = bias(pull), log_width(pull)
    influence = np.stack([mean[2], width[2]])
    n = len(pull)
    spread = influence @ influence.T / n**2
    # The standard errors are steadied for few trials; the correlation is as observed.
    standard_error = np.array([mean[1], width[1]])
    scale = np.sqrt(np.diag(spread))
    correlation = spread[0, 1] / (scale[0] * scale[1]) if scale.min() > 0 else 0.0
    z = np.array([mean[0], width[0]]) / standard_error
    joint = (z @ z - 2 * correlation * z[0] * z[1]) / max(1 - correlation**2, 1e-6)
    return MeanFinding(
        id="evidence.pull",
        quantity="",
        claim="mean of (log evidence - truth) / error; log of stated over actual error (negative: too small)",
        null="pulls of mean 0 and variance 1 for an unbiased log evidence whose error is right",
        reference=REFERENCE,
        n_trials=n,
        components=("mean", "log_width"),
        estimate=np.array([mean[0], width[0]]),
        standard_error=standard_error,
        influence=influence,
        population=population,
        p_value=max(float(special.chdtrc(2, joint)), SMALLEST),
        details=xr.Dataset({"pull": ("trial", pull)}, coords=_coordinates(trial)),
        caveats=caveats,
    )


def error_finding(
    error: ArrayLike, *, trial: ArrayLike | None = None, caveats: tuple[str, ...] = ()
) -> Finding:
    """Median of the log evidences' stated errors ``(trial,)`` or ``(run,)``, in nat."""
    stated = np.atleast_1d(np.asarray(error, dtype=float))
    return quantile_finding(
        stated,
        id="evidence.error",
        quantity="",
        claim="median stated error of the log evidence (nat)",
        null="0 for an exact log evidence",
        reference=REFERENCE,
        sense="at-most",
        population="evidence",
        details=xr.Dataset({"log_evidence_error": ("trial", stated)}, coords=_coordinates(trial)),
        caveats=caveats,
    )


def _coordinates(trial: ArrayLike | None) -> dict[str, NDArray[np.int64]]:
    return {} if trial is None else {"trial": np.asarray(trial)}
