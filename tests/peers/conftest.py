"""How a peer is imported: skipped where it is not installed, failed where it was promised."""

from __future__ import annotations

import importlib
import os
import warnings
from collections.abc import Callable
from types import ModuleType

import pytest

# Keras asks before bayesflow can.
os.environ.setdefault("KERAS_BACKEND", "torch")


@pytest.fixture(scope="session")
def peer() -> Callable[[str], ModuleType]:
    """Import a module of a peer, ``peer("sbi.diagnostics")``; what it warns of then is its own affair."""

    def load(name: str) -> ModuleType:
        package = name.partition(".")[0]
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return importlib.import_module(name)
        except ImportError as error:
            if package in os.environ.get("GAUGEBLOCK_PEERS", "").split():
                pytest.fail(f"GAUGEBLOCK_PEERS names {package}, which cannot be imported: {error}")
            pytest.skip(f"needs {package}: tox -e tests -- tests/peers, or peers-arviz for arviz_plots")

    return load
