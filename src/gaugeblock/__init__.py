"""gaugeblock: statistical validation of simulator-based estimators.

The rooms of the house, lowest first: `gaugeblock.simulators`, then `gaugeblock.estimators` and
`gaugeblock.validate`, `gaugeblock.reports`, and `gaugeblock.audit`, where they meet.
"""

from importlib.metadata import version

__version__ = version("gaugeblock")
