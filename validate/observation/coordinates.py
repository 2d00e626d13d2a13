"""Coordinates of data of any rank: neighbouring numbers summed until there are few, and their names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.validate.features import group_starts

MOST = 400
WORDS = {1: ("channel",), 2: ("row", "column")}


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Where along each axis of a data set a coordinate begins, and what the axes and places are called.

    `labels` of the last axis take the place of numbers: names, or positions such as times and energies.
    """

    shape: tuple[int, ...]
    starts: tuple[NDArray[np.int64], ...]
    axes: tuple[str, ...]
    labels: tuple[Any, ...] = ()

    @classmethod
    def of(
        cls,
        shape: Sequence[int],
        *,
        axes: Sequence[str] = (),
        labels: ArrayLike | None = None,
        most: int = MOST,
    ) -> Coordinates:
        """At most about `most` coordinates of data of this shape; the longest axis is halved first.

        Raises
        ------
        InputError
            If there are not as many names as axes, or labels as places along the last one.
        """
        shape = tuple(shape)
        counts = list(shape)
        while int(np.prod(counts, dtype=int)) > most:
            longest = int(np.argmax(counts))
            counts[longest] = -(-counts[longest] // 2)
        words = tuple(axes) or WORDS.get(len(shape), tuple(f"axis {i + 1}" for i in range(len(shape))))
        if len(words) != len(shape):
            raise InputError(f"axes: {len(words)} names for data with {len(shape)} axes; give one for each")
        known = () if labels is None else tuple(np.asarray(labels).tolist())
        if labels is not None and (not shape or len(known) != shape[-1]):
            raise InputError(
                f"coordinates: {len(known)} labels for data of shape {shape}; give one for each place along "
                "the last axis"
            )
        starts = tuple(group_starts(n, m) for n, m in zip(shape, counts, strict=True))
        return cls(shape, starts, words, known)

    @property
    def grid(self) -> tuple[int, ...]:
        """How many coordinates there are along each axis."""
        return tuple(len(begin) for begin in self.starts)

    def __len__(self) -> int:
        return int(np.prod(self.grid, dtype=int))

    def __call__(self, x: NDArray[Any]) -> Array:
        """Summed values ``(n, coordinate)`` of data ``(n, *data_shape)``."""
        made = np.asarray(x, dtype=float)
        for axis, begin in enumerate(self.starts, 1):
            if len(begin) < made.shape[axis]:
                made = np.add.reduceat(made, begin, axis=axis)
        return made.reshape(len(made), -1)

    def members(self, coordinate: int) -> tuple[slice, ...]:
        """The part of a data set that a coordinate sums."""
        place = np.unravel_index(coordinate, self.grid) if self.grid else ()
        ends = (np.append(b, n) for b, n in zip(self.starts, self.shape, strict=True))
        return tuple(slice(int(e[i]), int(e[i + 1])) for e, i in zip(ends, place, strict=True))

    def name(self, *coordinates: int) -> str:
        """What a person calls a coordinate, or the box that holds several.

        >>> Coordinates.of((3, 4)).name(5), Coordinates.of((1000,), axes=["time"]).name(1, 2)
        ('row 1, column 1', 'time 4 to 11')
        """
        boxes = [self.members(at) for at in coordinates]
        said = []
        for axis, word in enumerate(self.axes):
            known = self.labels if axis == len(self.axes) - 1 else ()
            first = min(box[axis].start for box in boxes)
            last = max(box[axis].stop for box in boxes) - 1
            ends = " to ".join(dict.fromkeys(_label(known, end) for end in (first, last)))
            said.append(ends if known and isinstance(known[0], str) else f"{word} {ends}")
        return ", ".join(said) or "the number"


def _label(known: tuple[Any, ...], place: int) -> str:
    if not known:
        return str(place)
    return f"{known[place]:.4g}" if isinstance(known[place], float) else str(known[place])
