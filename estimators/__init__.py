"""What turns data into posterior draws.

`protocol.py` says what an estimator is, `registry.py` makes them by name; one member a file, imported only
when asked for.
"""

from gaugeblock.estimators.protocol import Estimator, sample_and_log_prob
from gaugeblock.estimators.registry import ESTIMATORS, build_estimator

__all__ = ["ESTIMATORS", "Estimator", "build_estimator", "sample_and_log_prob"]
