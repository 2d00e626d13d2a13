"""Other people's code that takes its random numbers from global generators, seeded, and all put back."""

from __future__ import annotations

import importlib.util
import random
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

SEEDS = 2**31
"""Seeds that torch, NumPy and Python all take."""


@contextmanager
def seeded_globals(seed: int) -> Iterator[Any]:
    """Seed the global generators of Python, NumPy and torch, give torch or None, and put all of them back."""
    torch = importlib.import_module("torch") if importlib.util.find_spec("torch") else None
    state, words = np.random.get_state(legacy=False), random.getstate()  # noqa: NPY002
    np.random.seed(seed)  # noqa: NPY002
    random.seed(seed)
    try:
        if torch is None:
            yield None
        else:
            with torch.random.fork_rng(devices=[]):
                torch.manual_seed(seed)
                yield torch
    finally:
        np.random.set_state(state)  # noqa: NPY002
        random.setstate(words)
