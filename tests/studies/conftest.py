"""The study is no part of the installed package: its folder is made importable, and nothing beside it."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[2] / "studies"

if "studies" not in sys.modules:
    _spec = importlib.util.spec_from_file_location(
        "studies", FOLDER / "__init__.py", submodule_search_locations=[str(FOLDER)]
    )
    assert _spec is not None
    assert _spec.loader is not None
    sys.modules["studies"] = importlib.util.module_from_spec(_spec)
    _spec.loader.exec_module(sys.modules["studies"])
