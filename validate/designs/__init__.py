"""Comparing two arms, and what data can say at all: paired tests, confounds, Fisher information, shrink."""

from gaugeblock.validate.designs.count_ratio import count_ratio_regression
from gaugeblock.validate.designs.count_trend import count_controlled_residual
from gaugeblock.validate.designs.fisher import (
    effect_information,
    predicted_sd,
    predicted_shrink,
)
from gaugeblock.validate.designs.paired import PairedTest, paired_permutation, stratified_permutation
from gaugeblock.validate.designs.shifted_counts import finite_shift
from gaugeblock.validate.designs.shrinkage import capture, effective_dimension, shrink
from gaugeblock.validate.designs.signed_rank import wilcoxon_signed_rank

__all__ = [
    "PairedTest",
    "capture",
    "count_controlled_residual",
    "count_ratio_regression",
    "effect_information",
    "effective_dimension",
    "finite_shift",
    "paired_permutation",
    "predicted_sd",
    "predicted_shrink",
    "shrink",
    "stratified_permutation",
    "wilcoxon_signed_rank",
]
