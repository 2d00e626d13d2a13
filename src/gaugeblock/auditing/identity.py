"""What identifies a run: the simulator, the estimator and the versions of everything that makes numbers."""

from __future__ import annotations

import hashlib
import inspect
import pickle
import platform
from importlib import metadata
from pathlib import Path
from typing import Any

from gaugeblock.simulators.protocol import Described

NUMERICAL = (
    *("gaugeblock", "numpy", "scipy", "xarray", "netCDF4"),
    *("jax", "jaxspec", "torch", "sbi", "zuko", "ultranest", "numpyro"),
)


def identity(thing: object) -> dict[str, Any]:
    """What identifies a simulator or an estimator: its class, its source file's hash, and its state.

    The state is what it says in `describe`; for one that says nothing, a hash of its attributes (the weights
    of a network among them), or None where they cannot be hashed: such a thing has no lasting identity.
    """
    kind = type(thing)
    record: dict[str, Any] = {"class": f"{kind.__module__}.{kind.__qualname__}"}
    if isinstance(thing, Described):
        record |= thing.describe()
        base = getattr(thing, "base", None)
        if base is not None and not isinstance(base, Described):
            record["base"] = identity(base)  # which a wrapper can only call by its class
    else:
        try:
            record["state_sha256"] = hashlib.sha256(pickle.dumps(thing)).hexdigest()
        except Exception:  # anything may happen in a stranger's attributes
            record["state_sha256"] = None
    if not kind.__module__.startswith("gaugeblock."):
        try:
            source = Path(inspect.getfile(kind)).read_bytes()
            record["source_sha256"] = hashlib.sha256(source).hexdigest()
        except (OSError, TypeError):  # defined in an interpreter session: there is no file to hash
            record["source_sha256"] = None
    return record


def lasting(record: object) -> bool:
    """Whether a record of `identity`, its prior's included, tells one state from every other."""
    if isinstance(record, dict):
        return record.get("state_sha256", "") is not None and all(map(lasting, record.values()))
    return all(map(lasting, record)) if isinstance(record, list | tuple) else True


def versions() -> dict[str, str]:
    """Versions of Python and of every installed library that can change a number."""
    found = {"python": platform.python_version()}
    for name in NUMERICAL:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found
