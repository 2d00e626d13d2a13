"""What a stranger says of itself: checked for its form, believed in nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from gaugeblock.core.errors import InputError
from gaugeblock.stranger.wire import plain

CAN = ("sample", "log_prob", "embed")
MOST = 1000
WORD = 100


@dataclass(frozen=True, kw_only=True)
class Claims:
    """A stranger's library and versions, the names of its parameters if it has any, and what it can do.

    `autocorrelated`: its draws of one trial are a Markov chain; they are thinned, which costs precision only.
    """

    library: str
    versions: dict[str, str]
    parameters: tuple[str, ...] | None
    can: tuple[str, ...]
    autocorrelated: bool = False

    @classmethod
    def of(cls, header: Mapping[str, Any]) -> Claims:
        """Out of the header of its answer to ``describe``.

        >>> Claims.of({"can": ["sample"], "parameters": ["a", "b"]}).parameters
        ('a', 'b')

        Raises
        ------
        InputError
            If it cannot sample, or a part is not what the protocol says.
        """
        names, versions, can = (header.get(key) for key in ("parameters", "versions", "can"))
        if not isinstance(can, list) or "sample" not in can:
            raise InputError(f"the stranger does not say that it can sample: can = {plain(can, 80)}")
        if names is not None and not (isinstance(names, list) and 0 < len(names) <= MOST):
            raise InputError(f"the stranger's parameters are no list of names: {plain(names, 80)}")
        if versions is not None and not (isinstance(versions, dict) and len(versions) <= MOST):
            raise InputError(f"the stranger's versions are no table: {plain(versions, 80)}")
        return cls(
            library=plain(header.get("library") or "", WORD),
            versions={plain(key, WORD): plain(value, WORD) for key, value in (versions or {}).items()},
            parameters=None if names is None else tuple(plain(name, WORD) for name in names),
            can=tuple(name for name in CAN if name in can),
            autocorrelated=header.get("autocorrelated") is True,
        )

    def describe(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)
