"""Discovery without a likelihood: scores learned from simulations, for a simulator that can only simulate.

`features` turns data into numbers, `population` and `model` say what is simulated, `scores` learns how the
features answer to everything that may change, `fit` fits population and effects by that, `search` tests every
effect, `extend` adds one, `held_out` judges it on other data sets, `close_in` finds where theta lies.
"""

from gaugeblock.discovery.simulated.workflow import discover_simulated

__all__ = ["discover_simulated"]
