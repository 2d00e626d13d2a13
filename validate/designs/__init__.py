"""Comparing two arms, and what data can say at all: paired tests, confounds, Fisher information, shrink."""

from gaugeblock.validate.designs.count_ratio import count_ratio_regression
from gaugeblock.validate.designs.count_trend import count_controlled_residual
from gaugeblock.validate.designs.finite_shift import finite_shift, linearisation_error
from gaugeblock.validate.designs.fisher import (
    effect_information,
    fisher_information,
    fisher_screen,
    predicted_sd,
    predicted_shrink,
)
from gaugeblock.validate.designs.paired import PairedTest, paired_permutation, stratified_permutation
from gaugeblock.validate.designs.shrink import capture, effective_dimension, shrink
from gaugeblock.validate.designs.signed_rank import wilcoxon_signed_rank

__all__ = [
    "PairedTest",
    "capture",
    "count_controlled_residual",
    "count_ratio_regression",
    "effect_information",
    "effective_dimension",
    "finite_shift",
    "fisher_information",
    "fisher_screen",
    "linearisation_error",
    "paired_permutation",
    "predicted_sd",
    "predicted_shrink",
    "shrink",
    "stratified_permutation",
    "wilcoxon_signed_rank",
]
