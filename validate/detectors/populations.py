"""Detector D3: can a classifier tell measured data sets from simulated ones, as populations?"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from gaugeblock.validate.finding import Finding
from gaugeblock.validate.learned.two_sample import (
    FOLDS,
    Fit,
    classifier_two_sample,
    network_fit,
    two_sample_finding,
)


def population_c2st(
    observed: ArrayLike,
    simulated: ArrayLike,
    *,
    rng: np.random.Generator,
    folds: int = FOLDS,
    fit: Fit = network_fit,
) -> Finding:
    """C2ST of features or embeddings of observed ``(m, d)`` against simulated ``(n, d)`` data sets.

    Null: the observed data sets are draws of the simulator, with its prior. A failure means that they, or
    their parameters, are distributed otherwise: a population of bright sources differs from the prior's
    without any fault of the simulator. Simulate from the posteriors of the observed data to leave
    parameters out.

    Raises
    ------
    InputError
        For arrays of different width, NaN, or too few data sets; see `classifier_two_sample`.
    """
    result = classifier_two_sample(simulated, observed, rng=rng, folds=folds, fit=fit)
    finding = two_sample_finding(
        result,
        identifier="population_c2st.accuracy",
        n=len(np.asarray(observed)) + len(np.asarray(simulated)),
    )
    return dataclasses.replace(
        finding,
        claim=finding.claim.replace("two samples", "measured and simulated data sets"),
        null=finding.null.replace(
            "both are samples of one distribution", "measured data are draws of the simulator and its prior"
        ),
    )
