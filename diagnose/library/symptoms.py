"""All symptoms that the library has, by id."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.disagreement import Reference
from gaugeblock.diagnosis.library import columns, joint, marginal, noise, place, prior, structure
from gaugeblock.diagnosis.repair import Repair

Fit = Callable[[Cases, Reference], Sequence[Repair]]
"""From cases of the fitting part to repairs that may be tried: none where the symptom is not there."""


def _alone(fit: Callable[[Cases], Sequence[Repair]]) -> Fit:
    return lambda cases, _: fit(cases)


# What shows whatever the truths are: said whether or not anything is gained by mending it.
# The same random numbers everywhere may look like a chain, which they are not.
STRUCTURAL = (structure.few_distinct, structure.fixed_seed, structure.autocorrelated)

SYMPTOMS: Mapping[str, Fit] = {
    "shift": _alone(marginal.shift),
    "scale": _alone(marginal.scale),
    "skew": _alone(marginal.skew),
    "outliers": _alone(marginal.outliers),
    "clipped_tails": _alone(marginal.clipped_tails),
    "columns": _alone(columns.columns),
    "unit": _alone(columns.unit),
    "log": _alone(columns.log),
    "sign": _alone(columns.sign),
    "ignored_parameter": place.ignored_parameter,
    "correlations": _alone(joint.correlations),
    "missing_mode": _alone(joint.missing_mode),
    "mode_weights": _alone(joint.mode_weights),
    "other_prior": prior.other_prior,
    "x_noise": noise.x_noise,
    "truncated_prior": _alone(prior.truncated_prior),
    "leakage": prior.leakage,
    "region": _alone(place.region),
}
