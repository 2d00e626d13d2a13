"""Tests that need no trials, each with data for which its null hypothesis is true."""

from __future__ import annotations

from collections.abc import Callable, Mapping

# Name -> p-value from a seed. A new test of arrays gets a line here.
ALONE: Mapping[str, Callable[[int], float]] = {}
