"""Small inline SVG pictures: scales, axes and marks. Colours are CSS variables of the page around them.

Everything returns `Markup`; text handed in is escaped. Coordinates have one decimal, so that the same numbers
give the same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup, escape
from numpy.typing import ArrayLike, NDArray

from gaugeblock.reports.words import MINUS


def tag(name: str, *children: str, **attributes: object) -> Markup:
    """One element; text children and attribute values are escaped, `Markup` children are not.

    >>> str(tag("text", "<b>", class_="tick", text_anchor="end"))
    '<text class="tick" text-anchor="end">&lt;b&gt;</text>'
    """
    pairs = Markup("").join(
        Markup(' {}="{}"').format(key.rstrip("_").replace("_", "-"), value)
        for key, value in attributes.items()
        if value is not None
    )
    inside = Markup("").join(escape(child) for child in children)
    return Markup("<{0}{1}>{2}</{0}>").format(Markup(name), pairs, inside)


def drawing(
    marks: Iterable[str], *, width: float, height: float, key: str, title: str, description: str, class_: str
) -> Markup:
    """A whole picture, with the title and description that a screen reader reads out."""
    return tag(
        "svg",
        tag("title", title, id=f"{key}-title"),
        tag("desc", description, id=f"{key}-desc"),
        *marks,
        class_=class_,
        viewBox=f"0 0 {width:g} {height:g}",
        width=f"{width:g}",
        height=f"{height:g}",
        role="img",
        aria_labelledby=f"{key}-title {key}-desc",
    )


def round_ticks(low: float, high: float, about: int = 5) -> list[float]:
    """Round numbers inside [low, high], about as many as asked for.

    >>> round_ticks(0.0, 1.0), round_ticks(-0.03, 0.03, 3)
    ([0.0, 0.2, 0.4, 0.6, 0.8, 1.0], [-0.02, 0.0, 0.02])
    """
    span = high - low
    if not (math.isfinite(span) and span > 0):
        return [low]
    rough = span / about
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(m * power for m in (1, 2, 2.5, 5, 10) if m * power >= rough * 0.999)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    # The division by the inverse keeps 0.6 from being written 0.6000000000000001.
    return [float(f"{index * step:.12g}") for index in range(first, last + 1)]


def tick_label(value: float) -> str:
    """A tick's text, with a true minus sign.

    >>> tick_label(-0.02), tick_label(20000.0)
    ('−0.02', '20,000')
    """
    text = f"{value:,.0f}" if abs(value) >= 1000 and value == int(value) else f"{value:.6g}"
    return text.replace("-", MINUS)


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A rectangle with linear scales; `x` and `y` are the ranges it shows."""

    x: tuple[float, float]
    y: tuple[float, float]
    width: float = 320.0
    height: float = 210.0
    left: float = 64.0
    right: float = 12.0
    top: float = 8.0
    bottom: float = 38.0

    def across(self, values: ArrayLike) -> NDArray[np.float64]:
        """Horizontal position of data values, clipped to the frame."""
        share = (np.asarray(values, dtype=float) - self.x[0]) / (self.x[1] - self.x[0])
        return np.asarray(self.left + np.clip(share, 0, 1) * (self.width - self.left - self.right))

    def down(self, values: ArrayLike) -> NDArray[np.float64]:
        """Vertical position of data values, clipped to the frame."""
        share = (np.asarray(values, dtype=float) - self.y[0]) / (self.y[1] - self.y[0])
        return np.asarray(
            self.height - self.bottom - np.clip(share, 0, 1) * (self.height - self.top - self.bottom)
        )

    def drawing(
        self, marks: Iterable[str], *, key: str, title: str, description: str, class_: str = "chart"
    ) -> Markup:
        """A whole picture of the frame's size."""
        return drawing(
            marks, width=self.width, height=self.height, key=key, title=title, description=description,
            class_=class_,
        )  # fmt: skip

    def axes(
        self,
        x_label: str,
        y_label: str,
        *,
        x_ticks: Mapping[float, str] | None = None,
        y_ticks: Mapping[float, str] | None = None,
    ) -> Markup:
        """Grid lines, ticks and labels; `x_ticks` and `y_ticks` give texts for positions of your choice."""
        floor, end = self.height - self.bottom, self.width - self.right
        marks = []
        if y_ticks is None:
            y_ticks = {t: tick_label(t) for t in round_ticks(*self.y, about=4)}
        for value, label in y_ticks.items():
            at = float(self.down(value))
            marks.append(tag("path", d=f"M{self.left:g} {at:.1f}H{end:g}", class_="grid"))
            marks.append(tag("text", label, x=f"{self.left - 6:g}", y=f"{at + 3.5:.1f}", text_anchor="end"))
        if x_ticks is None:
            x_ticks = {t: tick_label(t) for t in round_ticks(*self.x)}
        for value, label in x_ticks.items():
            at = float(self.across(value))
            marks.append(tag("path", d=f"M{at:.1f} {floor:g}v4", class_="axis"))
            # Labels at the very ends lean inwards, or they would be cut off.
            edge = "end" if at > end - 8 else "middle"
            shift = at + 8 if edge == "end" else at
            marks.append(tag("text", label, x=f"{shift:.1f}", y=f"{floor + 16:g}", text_anchor=edge))
        # A label longer than its axis has the whole picture's width.
        middle = (self.left + end) / 2 if 6.5 * len(x_label) < end - self.left else self.width / 2
        marks.append(tag("path", d=f"M{self.left:g} {floor:g}H{end:g}", class_="axis"))
        place = {"x": f"{middle:g}", "y": f"{self.height - 5:g}"}
        marks.append(tag("text", x_label, **place, text_anchor="middle", class_="label"))
        turned = f"translate(10 {(self.top + floor) / 2:g}) rotate(-90)"
        marks.append(tag("text", y_label, class_="label", text_anchor="middle", transform=turned))
        return tag("g", *marks, class_="axes")

    def line(self, x: ArrayLike, y: ArrayLike, class_: str = "line", *, steps: bool = False) -> Markup:
        """A line through the points (a staircase with `steps`)."""
        return tag("path", d=_path(self.across(x), self.down(y), steps=steps), class_=class_)

    def band(self, x: ArrayLike, low: ArrayLike, high: ArrayLike, class_: str = "band") -> Markup:
        """The area between two curves."""
        across = self.across(x)
        there = _path(across, self.down(high))
        back = _path(across[::-1], self.down(low)[::-1])
        return tag("path", d=f"{there}L{back[1:]}Z", class_=class_)

    def whiskers(self, x: ArrayLike, low: ArrayLike, high: ArrayLike, class_: str = "whiskers") -> Markup:
        """Upright error bars, as one path."""
        lines = zip(self.across(x), self.down(low), self.down(high), strict=True)
        return tag("path", d="".join(f"M{a:.1f} {b:.1f}V{t:.1f}" for a, b, t in lines), class_=class_)

    def dots(self, x: ArrayLike, y: ArrayLike, class_: str = "dots") -> Markup:
        """Points, as one path of zero-length strokes with round ends: small, and quick to draw."""
        spots = zip(self.across(x), self.down(y), strict=True)
        return tag("path", d="".join(f"M{a:.1f} {b:.1f}h0" for a, b in spots), class_=class_)

    def bars(self, edges: ArrayLike, heights: ArrayLike, class_: str = "bar") -> Markup:
        """A histogram's bars, from zero up, a hair apart."""
        sides, tops, floor = self.across(edges), self.down(heights), self.height - self.bottom
        shapes = zip(sides[:-1], sides[1:], tops, strict=True)
        return tag(
            "path",
            d="".join(f"M{a + 0.5:.1f} {floor:g}V{t:.1f}H{b - 0.5:.1f}V{floor:g}Z" for a, b, t in shapes),
            class_=class_,
        )

    def hovered(self, x: ArrayLike, y: ArrayLike, texts: Sequence[str]) -> Markup:
        """A strip over each place `x`, rising, that shows its text, and a mark at `y`, under a pointer."""
        across, down = self.across(x), self.down(y)
        sides = np.r_[self.left, (across[1:] + across[:-1]) / 2, self.width - self.right]
        floor = self.height - self.bottom
        places = zip(sides[:-1], sides[1:], across, down, texts, strict=True)
        return _tips(
            (
                (f"M{a:.1f} {self.top:g}H{b:.1f}V{floor:g}H{a:.1f}Z", f"M{at:.1f} {y:.1f}h0", text)
                for a, b, at, y, text in places
            ),
            f"{self.left + 6:g}",
        )

    def rows_hovered(self, y: ArrayLike, texts: Sequence[str]) -> Markup:
        """A strip over each row at `y`, of height 1, that shows its text under a pointer."""
        ends = (self.left, self.width - self.right)
        edges = [(float(self.down(at + 0.5)), float(self.down(at - 0.5))) for at in np.asarray(y)]
        # A text longer than its axis has the whole picture's width.
        fits = 6.5 * max(map(len, texts), default=0) < ends[1] - ends[0] - 6
        return _tips(
            (
                (f"M{ends[0]:g} {a:.1f}H{ends[1]:g}V{b:.1f}H{ends[0]:g}Z", "", text)
                for (a, b), text in zip(edges, texts, strict=True)
            ),
            f"{self.left + 6 if fits else 6:g}",
        )

    def upright(self, x: float, text: str, class_: str = "mark", *, row: int = 0) -> Markup:
        """A vertical mark with a label at its top, on whichever side has room."""
        at = float(self.across(x))
        roomy = at < (self.left + self.width - self.right) * 0.55
        line = tag("path", d=f"M{at:.1f} {self.top:g}V{self.height - self.bottom:g}", class_=class_)
        if not text:
            return line
        return line + tag(
            "text",
            text,
            x=f"{at + (5 if roomy else -5):.1f}",
            y=f"{self.top + 10 + 13 * row:g}",
            text_anchor="start" if roomy else "end",
            class_="note",
        )


def _tips(places: Iterable[tuple[str, str, str]], at: str) -> Markup:
    """Shapes that a pointer is over, each with a spot and a text that show then: the page has no scripts."""
    return tag(
        "g",
        *(
            tag(
                "g",
                tag("path", d=shape),
                tag("path", d=spot, class_="spot") if spot else "",
                tag("text", text, x=at, y="19", class_="tip"),
            )
            for shape, spot, text in places
        ),
        class_="tips",
    )


def _path(across: NDArray[np.float64], down: NDArray[np.float64], *, steps: bool = False) -> str:
    points = [f"{a:.1f} {d:.1f}" for a, d in zip(across, down, strict=True)]
    if not steps:
        return "M" + "L".join(points)
    corners = "".join(f"H{a:.1f}V{d:.1f}" for a, d in zip(across[1:], down[1:], strict=True))
    return f"M{points[0]}{corners}"
