"""Levels of central intervals: those that are judged where a policy says nothing, and how they are named."""

from __future__ import annotations

LEVELS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.68, 0.7, 0.8, 0.9, 0.95)
OUTERMOST = (0.99, 0.997)
# The bulk ends here: beyond, a level is a matter of tails, and of whether draws resolve it.
LARGEST = 0.95
_AT = " @ "


def component(name: str, level: float) -> str:
    """Name of the component of a finding that is the interval of one parameter.

    >>> component("a", 0.997)
    'a @ 0.997'
    """
    return f"{name}{_AT}{level:g}"


def level_of(component: str) -> float:
    """The level that a component's name ends with.

    >>> level_of("tbabs_1.nh @ 0.68")
    0.68
    """
    return float(component.rpartition(_AT)[2])
