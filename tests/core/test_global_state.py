"""Global generators are those of the seed inside, and outside what they were."""

from __future__ import annotations

import importlib.util
import random
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from gaugeblock.core.global_state import SEEDS, seeded_globals


def drawn(torch: Any) -> list[float]:
    """A number of each generator, and of what NumPy keeps of a pair of normal ones."""
    found = [random.random(), np.random.random(), np.random.standard_normal()]  # noqa: NPY002
    return found if torch is None else [*found, float(torch.rand(1))]


@pytest.mark.parametrize("wanted", [False, True])
def test_generators_are_seeded_and_put_back(wanted: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    library = pytest.importorskip("torch") if wanted else None
    if not wanted:
        monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with seeded_globals(SEEDS - 1):
        before = drawn(library)  # of whatever was there
    with seeded_globals(5) as torch:
        assert torch is library
        first = drawn(torch)
        undisturbed = drawn(torch)
    with seeded_globals(5):
        assert drawn(library) == first
        # However the block ends, what goes on outside is what would have.
        with suppress(ZeroDivisionError), seeded_globals(6):
            other = drawn(library)
            raise ZeroDivisionError
        assert drawn(library) == undisturbed
    assert all(a != b for a, b in zip(first, other, strict=True))
    assert all(a != b for a, b in zip(first, before, strict=True))
