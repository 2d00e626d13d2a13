"""Fit again with the effect in the model.

`composition` works effects into a simulator; `refit` draws from its posterior, by the `engines` there are;
`widened` and `adaptive` make the proposals of importance sampling; `retraining` trains a flow with the
effects as nuisance.
"""

from gaugeblock.discovery.extend.composition import Addition, extended
from gaugeblock.discovery.extend.refitting import Refit, refit
from gaugeblock.discovery.extend.retraining import retrain

__all__ = ["Addition", "Refit", "extended", "refit", "retrain"]
