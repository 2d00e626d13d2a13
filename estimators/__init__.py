"""What turns data into posterior draws. `protocol.py` says what an estimator is; one member a file."""

from gaugeblock.estimators.protocol import Estimator

__all__ = ["Estimator"]
