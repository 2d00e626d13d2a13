"""Blocks of a catalogue's sources: each answers for itself, here or in another process."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Protocol, TypeVar

import numpy as np

from gaugeblock.core.executors import threads
from gaugeblock.discovery.sources import Sources

T = TypeVar("T")

BLOCK = 128
"""Most sources of a block. Batches round by their size, so blocks are part of what decides the bits."""

Answer = Mapping[str, Any]
"""Arrays by name."""


class Each(Protocol):
    """Asks every block the same; who answers, and when, decides nothing."""

    def __call__(self, ask: Callable[..., Answer], *columns: Sequence[Any]) -> Iterator[Answer]:
        """``ask(*row)`` for each row of the columns, one entry a block, in their order."""


def here(ask: Callable[..., Answer], *columns: Sequence[Any]) -> Iterator[Answer]:
    """Answers of this process, one after the other."""
    for row in zip(*columns, strict=True):
        with threads(1):
            answer = settled(ask(*row))
        yield answer


def settled(answer: Answer) -> Answer:
    """Arrays as they come back from a file: sums go the way that they lie in memory."""
    return {name: np.asarray(values, order="C") for name, values in answer.items()}


def blocks_of(groups: Sequence[Sources]) -> list[Sources]:
    """The sources of each response in blocks of one size, or of one more."""
    return [
        group.select(rows)
        for group in groups
        for rows in np.array_split(np.arange(len(group)), -(-len(group) // BLOCK))
    ]


def by_response(blocks: Sequence[Sources], make: Callable[[Any], T]) -> list[T]:
    """What is made of each block's simulator, once for all blocks that share it."""
    made: dict[int, T] = {}
    for block in blocks:
        if id(block.simulator) not in made:
            made[id(block.simulator)] = make(block.simulator)
    return [made[id(block.simulator)] for block in blocks]
