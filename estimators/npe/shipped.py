"""The trained flows that come with the package."""

from __future__ import annotations

from pathlib import Path

from gaugeblock.core.errors import InputError

_MODELS = Path(__file__).resolve().parent.parent / "models"


def reference_model_path(name: str = "epic-pn-medium") -> Path:
    """Model folder of a shipped flow.

    >>> reference_model_path().name
    'epic-pn-medium'

    Raises
    ------
    InputError
        If there is none of that name.
    """
    path = _MODELS / name
    if not (path / "model.json").is_file():
        known = ", ".join(sorted(p.parent.name for p in _MODELS.glob("*/model.json"))) or "none"
        raise InputError(f"no shipped flow {name!r}; there are {known}")
    return path
