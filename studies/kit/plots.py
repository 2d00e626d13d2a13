"""Figures as files, the same bytes for the same numbers; needs matplotlib."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from gaugeblock.core.atomic import made_folder
from gaugeblock.core.errors import require

BLUE, ORANGE, GREY = "#2a6f97", "#c8553d", "#8a8a8a"
STYLE = {"svg.hashsalt": "gaugeblock", "font.size": 8, "axes.spines.top": False, "axes.spines.right": False}


def pyplot() -> Any:
    """Where figures are made."""
    return require("matplotlib.pyplot", "report")


def draw(figures: Mapping[str, Callable[[], Any]], folder: Path, *, prefix: str = "") -> list[Path]:
    """Write every figure to ``folder/PREFIX-NAME.svg``."""
    plot, written = pyplot(), []
    made_folder(folder)
    for name, make in figures.items():
        path = folder / f"{prefix}{name}.svg"
        with plot.rc_context(STYLE):
            figure = make()
            figure.savefig(path, metadata={"Date": None})
            plot.close(figure)
        written.append(path)
    return written
