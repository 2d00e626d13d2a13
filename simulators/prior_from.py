"""Whatever somebody has for a prior, as one of ours."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from gaugeblock.core.arrays import Array
from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.simulators.blocks import drawn
from gaugeblock.simulators.foreign import ACCEPTED, distributions
from gaugeblock.simulators.prior import Prior, named


def as_prior(prior: Any, names: Sequence[str] | None = None) -> Prior:
    """Any prior as a `Prior` that can do what the original could.

    A `Prior` or a class that makes one; a distribution of scipy.stats (frozen), torch, sbi or numpyro; a dict
    of these by name, or by a tuple of names for one of several parameters; a list of them; samples
    ``(n, parameter)``, drawn from with replacement, or ``(samples, log_prob)``; a function ``(n, rng)`` that
    returns ``(n, parameter)``. Other people's distributions that are one of ours become that one, with its
    quantile function and bijections. Parameters without names are ``theta_1``, ``theta_2``, ...

    >>> as_prior({"a": {"distribution": "normal", "mean": 0.0, "sd": 1.0}}).names
    ('a',)
    >>> as_prior(lambda n, rng: rng.gamma(2.0, size=(n, 2)), names=["shape", "rate"]).names
    ('shape', 'rate')

    Raises
    ------
    InputError
        If it is none of these, gives draws that are NaN, infinite or of the wrong shape, or the names are not
        as many as the parameters.
    """
    made = _unnamed(prior)
    return made if names is None else made.renamed(tuple(map(str, names)))


def _unnamed(given: Any) -> Prior:
    if isinstance(given, Prior):
        return given
    if inspect.isclass(given):
        try:
            return _unnamed(given())
        except TypeError:
            raise InputError(
                f"prior: {given.__name__} is a class; give an instance of it, {given.__name__}(...)"
            ) from None
    if isinstance(given, Mapping):
        described = given and all(isinstance(entry, Mapping) for entry in given.values())
        return Prior.from_description(given) if described else Prior(given)
    if isinstance(given, tuple) and len(given) == 2 and _is_array(given[0]) and callable(given[1]):
        return _of_samples(given[0], given[1])
    if _is_array(given):
        return _of_samples(given, None)
    if isinstance(given, list | tuple) and given:
        return named([each for one in given for each in distributions(one)])
    if given is None or isinstance(given, list | tuple | str | int | float):
        raise InputError(f"prior: {given!r} cannot be drawn from; give {ACCEPTED}")
    own = _own_names(given)
    made = named(distributions(given))
    return made if own is None else made.renamed(own)


def _own_names(given: Any) -> tuple[str, ...] | None:
    """Names that somebody's prior gives its parameters itself."""
    found = getattr(given, "names", None)
    if not isinstance(found, list | tuple) or not all(isinstance(name, str) for name in found):
        return None
    return tuple(found) or None


def _is_array(given: Any) -> bool:
    if isinstance(given, list | tuple):
        return len(given) > 0 and isinstance(given[0], list | tuple | int | float | np.ndarray | np.number)
    return hasattr(given, "__array__") and hasattr(given, "shape")


def _of_samples(given: Any, density: Any) -> Prior:
    try:
        samples = np.asarray(given.detach().cpu() if hasattr(given, "detach") else given, dtype=float)
    except (TypeError, ValueError):
        raise InputError("prior: samples must be numbers, (n, parameter)") from None
    samples = samples[:, None] if samples.ndim == 1 else samples
    if samples.ndim != 2 or len(samples) < 2 or not samples.shape[1] or not np.isfinite(samples).all():
        raise InputError(
            f"prior: samples must be finite numbers (n, parameter), at least two rows, got {samples.shape}"
        )
    description: dict[str, Any] = {
        "distribution": "samples",
        "rows": len(samples),
        "sha256": hashlib.sha256(np.ascontiguousarray(samples).tobytes()).hexdigest(),
    }
    if density is not None:
        description["state_sha256"] = None
    made = named([drawn(partial(_resampled, samples), description, density)])
    columns = getattr(given, "columns", None)
    return made if columns is None else made.renamed(tuple(map(str, columns)))


def _resampled(samples: Array, n: int, rng: Rng) -> Array:
    """Rows of samples ``(row, parameter)``, drawn with replacement."""
    return np.asarray(samples[rng.integers(0, len(samples), n)])
