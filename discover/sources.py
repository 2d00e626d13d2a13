"""What was measured: counts of one source or of many, with the simulator that should explain them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.values import Value
from gaugeblock.simulators.protocol import Extensible, HasExpected
from gaugeblock.simulators.segments import Segment, segments


@dataclass(frozen=True, eq=False, repr=False)
class Sources(Value):
    """Counts of n sources that share one simulator; each has a theta of its own.

    Source i expects ``scale[i] * simulator.expected(theta_i)``.

    Attributes
    ----------
    simulator
        With ``prior``, ``expected(theta)`` ``(n, channel)``, ``with_effect`` and ``effect_library``;
        ``jacobian(theta)`` ``(n, channel, parameter)`` where it has one.
    counts : ndarray, shape (source, channel)
        Poisson counts.
    scale : ndarray, shape (source,)
        Exposure in units of the simulator's.
    redshift : ndarray, shape (source,)
    names : tuple of str

    Raises
    ------
    InputError
        If the counts are not whole and finite numbers of at least 0, all of them are 0, or shapes disagree.
    """

    simulator: Any
    counts: Array
    scale: Array
    redshift: Array
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        counts = self.counts
        if counts.ndim != 2 or len({len(counts), len(self.scale), len(self.redshift), len(self.names)}) != 1:
            raise InputError(
                f"sources: counts must be (source, channel) with one scale, redshift and name a source, got "
                f"{counts.shape}, {len(self.scale)}, {len(self.redshift)} and {len(self.names)}"
            )
        whole = np.isfinite(counts) & (counts >= 0) & (counts == np.round(counts))
        if not whole.all():
            source, channel = np.argwhere(~whole)[0]
            raise InputError(
                f"source {self.names[source]}: channel {channel} holds {counts[source, channel]}; discovery "
                "needs raw counts, whole numbers of at least 0"
            )
        empty = ~counts.any(axis=1)
        if empty.any():
            raise InputError(f"source {self.names[int(np.argmax(empty))]}: holds no counts; leave it out")
        for capability, method in ((HasExpected, "expected"), (Extensible, "with_effect")):
            if not isinstance(self.simulator, capability):
                raise InputError(
                    f"discover: {type(self.simulator).__name__} has no {method}(...), which naming needs"
                )

    @classmethod
    def of(
        cls,
        simulator: Any,
        counts: Any,
        *,
        scale: Any = None,
        redshift: Any = None,
        names: tuple[str, ...] | None = None,
    ) -> Sources:
        """Sources from counts ``(channel,)`` or ``(source, channel)``; left out: 1, 0, a number."""
        rows = np.atleast_2d(np.asarray(counts, dtype=float))
        n = len(rows)
        return cls(
            simulator,
            rows,
            np.ones(n) if scale is None else np.broadcast_to(np.asarray(scale, dtype=float), (n,)),
            np.zeros(n) if redshift is None else np.broadcast_to(np.asarray(redshift, dtype=float), (n,)),
            tuple(map(str, range(n))) if names is None else tuple(names),
        )

    def __len__(self) -> int:
        return len(self.counts)

    @property
    def segments(self) -> tuple[Segment, ...]:
        """Which channels are what."""
        return segments(self.simulator, self.counts.shape[1])

    @property
    def edges(self) -> Array:
        """Lower and upper edge of every channel, ``(channel, 2)``."""
        return np.concatenate([part.edges for part in self.segments])

    def expected(self, theta: Any, *, simulator: Any = None) -> Array:
        """Expected counts ``(source, channel)``, under another simulator of the same data if given."""
        model = self.simulator if simulator is None else simulator
        return np.asarray(model.expected(theta)) * self.scale[:, None]

    def select(self, rows: Any) -> Sources:
        """Some of the sources, by index or mask."""
        index = np.arange(len(self))[rows]
        return Sources(
            self.simulator,
            self.counts[index],
            self.scale[index],
            self.redshift[index],
            tuple(self.names[i] for i in index),
        )
