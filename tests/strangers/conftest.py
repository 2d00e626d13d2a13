"""Where the environments of strangers are."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def environment() -> Callable[[str], Path]:
    """Folder of the environment of this name; the test skips, or fails where it was promised, without one.

    sbi may be installed beside gaugeblock; all others lie in $GAUGEBLOCK_STRANGERS (`tox -e strangers`).
    """
    folder = os.environ.get("GAUGEBLOCK_STRANGERS")

    def find(name: str) -> Path:
        if name == "sbi" and importlib.util.find_spec("sbi") is not None:
            return Path(sys.prefix)
        if folder is None:
            pytest.skip(f"needs an environment with {name}: tox -e strangers")
        found = Path(folder) / name
        assert (found / "bin" / "python").exists(), (
            f"GAUGEBLOCK_STRANGERS is set, but {found} is no environment"
        )
        return found

    return find
