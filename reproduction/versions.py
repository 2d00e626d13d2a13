"""Versions of what a result was made with."""

from __future__ import annotations

import platform
from importlib import metadata

PACKAGES = ("gaugeblock", "numpy", "scipy", "jax", "jaxspec", "torch", "sbi", "ultranest", "numpyro")


def versions() -> dict[str, str]:
    """Version of Python and of every package that is installed, by name."""
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found
