"""The epidemic from plain options, for the registry."""

from __future__ import annotations

from gaugeblock.simulators.epidemic.simulator import Epidemic


def build(
    *,
    weeks: int = 12,
    population: float = 2000.0,
    infected: float = 5.0,
    reported: float = 0.2,
    nodes: int = 257,
) -> Epidemic:
    """The plain epidemic; see `Epidemic` for what the options mean.

    >>> build(weeks=3).expected([[0.4, 0.1]]).shape
    (1, 3)
    """
    return Epidemic(weeks=weeks, population=population, infected=infected, reported=reported, nodes=nodes)
