"""Does measured data look like simulated data? For arrays of both; discovery builds on these."""

from gaugeblock.validate.detectors.embeddings import embedding_distance
from gaugeblock.validate.detectors.kernels import mmd
from gaugeblock.validate.detectors.populations import population_c2st
from gaugeblock.validate.detectors.predictive import predictive_check
from gaugeblock.validate.detectors.roc import auc, best_of_cells, bootstrap_auc, null_of_best, permutation_p

__all__ = [
    "auc",
    "best_of_cells",
    "bootstrap_auc",
    "embedding_distance",
    "mmd",
    "null_of_best",
    "permutation_p",
    "population_c2st",
    "predictive_check",
]
