"""Does the estimator use its data? Challengers learn from them what it missed, and tell truths from draws."""

from gaugeblock.validate.learned.informed.data import channels
from gaugeblock.validate.learned.informed.informed import informed
from gaugeblock.validate.learned.informed.pools import pools

__all__ = ["channels", "informed", "pools"]
