"""Whatever somebody has for a prior, as one of ours."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from typing import Any

from gaugeblock.core.errors import InputError
from gaugeblock.simulators.prior import Prior


def as_prior(prior: Any, names: Sequence[str] | None = None) -> Prior:
    """A `Prior`, a class that makes one, or a table of one-dimensional priors by name.

    Raises
    ------
    InputError
        If it is none of these, or the names are not as many as the parameters.
    """
    made = prior() if inspect.isclass(prior) else Prior(prior) if isinstance(prior, Mapping) else prior
    if not isinstance(made, Prior):
        raise InputError(f"the prior is a {type(made).__name__}: give a gaugeblock.Prior")
    if names is None:
        return made
    if len(names) != made.size:
        raise InputError(f"{len(names)} names for {made.size} parameters; give one for each")
    return Prior(dict(zip(names, made.marginals.values(), strict=True)))
