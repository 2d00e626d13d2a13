"""Trials one may stop watching at any time: sequences of bounded scores, for bets on how far off they are.

Each finding keeps its scores trial by trial; what a policy makes of them is decided in `sequential`, again
and again while trials come in, without harm to the error rates. Bias and width rest on cut standardised
errors (see `winsorised`), coverage on the indicators of central intervals. `anytime.uniform` is
the evidence against exact calibration, reported and never judged: it can refute only.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from gaugeblock.core.arrays import Array
from gaugeblock.validate.anytime.anytime_informed import informed_sequence
from gaugeblock.validate.anytime.anytime_joint import STATISTICS, joint_sequences
from gaugeblock.validate.anytime.normal_process import log_evidence_against_uniform
from gaugeblock.validate.anytime.sequence import REFERENCE, gap_sequence, sequence_finding
from gaugeblock.validate.anytime.wager_units import bias_of, log_width_of
from gaugeblock.validate.finding import Finding, NotChecked, PValueFinding
from gaugeblock.validate.levels import LEVELS, component
from gaugeblock.validate.marginal.coverage import inside_central
from gaugeblock.validate.marginal.winsorised import WinsorisedScores, winsorised_scores
from gaugeblock.validate.p_values import SMALLEST
from gaugeblock.validate.prepared import Prepared, TrialBlock, effective_draws, pit


def cut_scores(block: TrialBlock) -> Array:
    """Statistic: the four cut scores ``(trial, 4, parameter)``; see `WinsorisedScores`."""
    rng = block.rng("cut scores")
    return np.stack(winsorised_scores(block.theta_true, block.draws, rng, weight=block.weight), axis=1)


def anytime(prepared: Prepared) -> list[Finding | NotChecked]:
    """Sequences of scores for every gate that may be watched, and the evidence against exact calibration.

    Of a part of the trials without the one that rests on those before.
    """
    if not len(prepared.trial):
        why = "no trial has finite draws"
        names = ("bias", "log_width", "coverage", "joint", "hpd", "informed", "uniform")
        return [NotChecked(f"anytime.{what}", why) for what in names]
    scores = WinsorisedScores(*np.moveaxis(prepared.per_trial(cut_scores), 1, 0))
    parameters, caveats = prepared.parameters, prepared.caveats
    findings: list[Finding | NotChecked] = []
    for column, name in enumerate(parameters):
        findings += [
            bias_sequence(name, scores.error[:, column], scores.expected_error[:, column], caveats=caveats),
            log_width_sequence(
                name,
                scores.square[:, column],
                scores.expected_square[:, column],
                draws=prepared.effective_draws,
                caveats=caveats,
            ),
        ]
    return [
        *findings,
        coverage_sequence(prepared.pit, parameters, levels=prepared.levels.coverage, caveats=caveats),
        *joint_sequences(prepared),
        *([] if prepared.part else [informed_sequence(prepared)]),
        uniform_evidence(prepared.pit, caveats=caveats),
    ]


def bias_sequence(
    name: str, error: ArrayLike, expected: ArrayLike, *, caveats: tuple[str, ...] = ()
) -> Finding:
    """Bias of one parameter, from cut errors and what their pools expect, each ``(trial,)``."""
    score, pool = np.asarray(error, dtype=float), np.asarray(expected, dtype=float)
    return sequence_finding(
        f"anytime.bias[{name}]",
        "bias",
        f"bias of {name} in posterior standard deviations, by errors cut at 3; positive: too high",
        "mean cut error equal to its pool's, exactly, for an exact posterior of any shape",
        score[None],
        pool[None],
        estimate=bias_of(np.array([(score - pool).mean()])),
        error=np.array([(score - pool).std()]),
        components=(name,),
        caveats=caveats,
    )


def log_width_sequence(
    name: str,
    square: ArrayLike,
    expected: ArrayLike,
    *,
    draws: float = np.inf,
    caveats: tuple[str, ...] = (),
) -> Finding:
    """Log width ratio of one parameter, from cut squares and what their pools expect, each ``(trial,)``.

    `draws` is the number of draws in each pool; what a finite number hides of a fault is allowed for, to
    first order.
    """
    score, pool = np.asarray(square, dtype=float), np.asarray(expected, dtype=float)
    ratio = score.mean() / max(pool.mean(), np.finfo(float).tiny)
    return sequence_finding(
        f"anytime.log_width[{name}]",
        "log_width",
        f"natural log of estimated over true posterior width of {name}, by squared errors cut at 9",
        "mean cut square equal to its pool's, exactly, for an exact posterior of any shape",
        score[None],
        pool[None],
        estimate=log_width_of(np.array([ratio]), draws),
        error=np.array([0.5 * score.std() / max(score.mean(), np.finfo(float).tiny)]),
        components=(name,),
        caveats=caveats,
        draws=draws,
    )


def coverage_sequence(
    pit: ArrayLike,
    parameters: Sequence[str],
    *,
    levels: Sequence[float] = LEVELS,
    caveats: tuple[str, ...] = (),
) -> Finding:
    """Coverage minus level of central intervals, from randomised PIT ``(trial, parameter)``."""
    inside = inside_central(pit, levels)
    return gap_sequence(
        "anytime.coverage",
        "coverage",
        inside.reshape(len(parameters) * len(levels), -1),
        list(levels) * len(parameters),
        [component(name, level) for name in parameters for level in levels],
        claim="coverage minus level of central intervals; negative: too narrow or displaced",
        caveats=caveats,
    )


def uniform_evidence(pit: ArrayLike, *, caveats: tuple[str, ...] = ()) -> Finding:
    """Evidence against uniform ranks after each trial, from randomised PIT ``(trial, parameter)``."""
    log_evidence = log_evidence_against_uniform(pit)
    return PValueFinding(
        id="anytime.uniform",
        quantity="",
        claim="largest log10 of the evidence against exact calibration so far; above 1.3, refuted at 5%",
        null="randomised ranks uniform, exactly, for an exact posterior",
        reference="likelihood ratios of normal scores; " + REFERENCE,
        n_trials=len(log_evidence),
        estimate=np.array([log_evidence.max() / np.log(10)]),
        standard_error=np.array([np.nan]),
        p_value=max(float(np.exp(-max(0.0, log_evidence.max()))), SMALLEST),
        details=xr.Dataset({"log_evidence": ("evidence_trial", log_evidence)}),
        caveats=("valid at any trial, under any rule of stopping", *caveats),
    )


WATCHED = (pit, effective_draws, cut_scores, *STATISTICS)
