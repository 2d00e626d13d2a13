"""A small table drawn as a picture: one coloured cell per row and column, its number written in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from markupsafe import Markup
from numpy.typing import ArrayLike

from gaugeblock.reports.svg import drawing, tag

ROW, LEFT, TOP, WIDTH = 26.0, 118.0, 6.0, 420.0
# A name longer than this is cut in the picture; the tooltip has all of it.
LETTERS = 17


def cells(
    values: ArrayLike,
    texts: Sequence[Sequence[str]],
    notes: Sequence[Sequence[str]],
    *,
    rows: Sequence[str],
    columns: Sequence[str],
    limit: float,
    key: str,
    name: str,
    description: str,
    x_label: str,
) -> Markup:
    """Cells of `values` ``(row, column)``, the deeper in colour the nearer to `limit` or beyond it.

    Positive values take the accent's colour, negative ones that of a FAIL; `notes` are the cells' tooltips.
    """
    table = np.asarray(values, dtype=float)
    step = (WIDTH - LEFT - 4) / max(table.shape[1], 1)
    marks = []
    for i, row in enumerate(rows):
        down = TOP + i * ROW
        shown = row if len(row) <= LETTERS else row[: LETTERS - 1] + "\N{HORIZONTAL ELLIPSIS}"
        marks.append(_text(shown, LEFT - 8, down + 17, tag("title", row), anchor="end"))
        for j in range(table.shape[1]):
            depth = min(abs(float(table[i, j])) / limit, 1.0) if np.isfinite(table[i, j]) else 0.0
            across = LEFT + j * step
            box = tag(
                "rect",
                x=f"{across:.1f}",
                y=f"{down:g}",
                width=f"{step - 2:.1f}",
                height=f"{ROW - 2:g}",
                class_="cell high" if table[i, j] > 0 else "cell low",
                fill_opacity=f"{0.75 * depth:.2f}",
            )
            written = _text(texts[i][j], across + step / 2 - 1, down + 17, class_="note")
            marks.append(tag("g", tag("title", notes[i][j]), box, written))
    floor = TOP + len(rows) * ROW
    marks += [_text(column, LEFT + (j + 0.5) * step, floor + 13) for j, column in enumerate(columns)]
    marks.append(_text(x_label, LEFT + table.shape[1] * step / 2, floor + 30, class_="label"))
    return drawing(
        marks, width=WIDTH, height=floor + 36, key=key, title=name, description=description, class_="chart"
    )


def _text(
    words: str, x: float, y: float, *children: Markup, anchor: str = "middle", class_: str | None = None
) -> Markup:
    return tag("text", *children, words, x=f"{x:.1f}", y=f"{y:g}", text_anchor=anchor, class_=class_)
