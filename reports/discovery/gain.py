"""The README's headline figure: checks that cannot see a gain shift beside a score test that does."""

from __future__ import annotations

import numpy as np
import xarray as xr
from markupsafe import Markup

from gaugeblock.core.errors import InputError
from gaugeblock.reports.svg import Frame, tag
from gaugeblock.reports.words import count, short

WIDTH, ROW, LEFT = 760.0, 30.0, 250.0
_NEEDED = ("value", "null_low", "null_high", "threshold")
# Stands alone in a README, on a light or a dark page, without the report's style sheet.
_STYLE = """
svg.gain{--ink:#1b2026;--muted:#59616b;--rule:#dedfd9;--seen:#24578a;--unseen:#8a9097;--null:#59616b33}
@media(prefers-color-scheme:dark){svg.gain{--ink:#e8e7e2;--muted:#a3abb4;--rule:#333a41;--seen:#82b7e8;
--unseen:#8a9097;--null:#a3abb444}}
svg.gain text{font:12px system-ui,-apple-system,"Segoe UI",Roboto,sans-serif;fill:var(--muted)}
svg.gain text.scheme{fill:var(--ink);font-size:13px}
svg.gain text.case{fill:var(--ink);font-weight:650;font-size:14px}
svg.gain .grid{stroke:var(--rule)}
svg.gain .null{fill:var(--null)}
svg.gain .limit{stroke:var(--muted);stroke-dasharray:4 3;fill:none}
svg.gain .seen{fill:var(--seen)}
svg.gain .unseen{fill:none;stroke:var(--unseen);stroke-width:2}
svg.gain text.number{fill:var(--ink);font-variant-numeric:tabular-nums}
"""


def gain_headline(table: xr.Dataset) -> Markup:
    """Draw each scheme's statistic beside what effect-free data give, one block of rows a case.

    Parameters
    ----------
    table : Dataset
        Dims ``scheme, case``, both with text coordinates; ``value`` the statistic on data with the hidden
        gain, ``null_low null_high`` the central 95% of effect-free data, ``threshold`` from which it counts
        as seen, on either side of the null's centre alike; NaN where a scheme was not run. Attributes
        ``title`` and ``x_label``. Values are drawn in units of each scheme's own null: 0 is its centre, 1 its
        threshold; the number beside the mark is the value itself.

    Raises
    ------
    InputError
        If a variable is missing, or a threshold does not lie above the null's centre.
    """
    lacking = [name for name in _NEEDED if name not in table] + [
        name for name in ("scheme", "case") if name not in table.dims
    ]
    if lacking:
        raise InputError(f"gain_headline: the table lacks {', '.join(lacking)}")
    value, low, high, threshold = (
        np.asarray(table[name].transpose("case", "scheme").values, dtype=float) for name in _NEEDED
    )
    centre = (low + high) / 2
    known = np.isfinite(value)
    if not np.all(threshold[known] > centre[known]):
        raise InputError("gain_headline: every threshold must lie above the centre of its null")
    unit = threshold - centre
    drawn = {"value": (value - centre) / unit, "low": (low - centre) / unit, "high": (high - centre) / unit}
    cases, schemes = ([str(v) for v in table[name].values] for name in ("case", "scheme"))
    last = max(1.25, 1.12 * float(np.nanmax(drawn["value"])))
    first = min(-1.1, 1.1 * float(np.nanmin([np.nanmin(drawn["low"]), np.nanmin(drawn["value"])])))
    height = 64 + sum(34 + ROW * int(known[i].sum()) for i in range(len(cases)))
    frame = Frame(
        x=(first, last), y=(0, 1), width=WIDTH, height=height, left=LEFT, right=70, top=34, bottom=40
    )
    marks = [tag("style", Markup(_STYLE)), *_axis(frame, str(table.attrs.get("x_label", "")))]
    down = frame.top
    for i, case in enumerate(cases):
        marks.append(tag("text", case, x="8", y=f"{down + 16:.1f}", class_="case"))
        down += 24
        for j in np.flatnonzero(known[i]):
            row = {name: float(values[i, j]) for name, values in drawn.items()}
            marks.append(_row(frame, schemes[j], row, float(value[i, j]), down + ROW / 2))
            down += ROW
        down += 10
    seen = [f"{schemes[j]} in {cases[i]}" for i, j in np.argwhere(known & (np.abs(drawn["value"]) >= 1))]
    description = f"Seen by: {', '.join(seen) or 'none'}. {count(int(known.sum()), 'statistic')} in all."
    title = str(table.attrs.get("title", "What sees a hidden gain shift"))
    picture = frame.drawing(marks, key="gain-headline", title=title, description=description, class_="gain")
    # As a file of its own it needs the name space that a page does not.
    return Markup(str(picture).replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1))


def _axis(frame: Frame, label: str) -> list[Markup]:
    floor = frame.height - frame.bottom
    marks = []
    limits = [(0.0, "as without the gain"), (1.0, "seen from here")]
    limits += [(-1.0, "")] if frame.x[0] < -1.3 else []
    for at, text in limits:
        across = float(frame.across(at))
        marks.append(
            tag("path", d=f"M{across:.1f} {frame.top - 6:g}V{floor:g}", class_="limit" if at else "grid")
        )
        marks.append(tag("text", text, x=f"{across:.1f}", y=f"{frame.top - 14:g}",
                         text_anchor="start" if at else "end"))  # fmt: skip
    middle = (frame.left + frame.width - frame.right) / 2
    words = label or "statistic, in units of its own threshold on effect-free data"
    marks.append(tag("text", words, x=f"{middle:g}", y=f"{frame.height - 10:g}", text_anchor="middle"))
    return marks


def _row(frame: Frame, scheme: str, drawn: dict[str, float], value: float, down: float) -> Markup:
    start, end, place = (float(frame.across(drawn[name])) for name in ("low", "high", "value"))
    seen = abs(drawn["value"]) >= 1
    shape: dict[str, object] = {"cx": f"{place:.1f}", "cy": f"{down:.1f}", "r": "6"}
    said = f"{scheme}: {short(value)}, {'seen' if seen else 'not seen'}"
    return tag(
        "g",
        tag("title", said),
        tag("text", scheme, x=f"{frame.left - 14:g}", y=f"{down + 4:.1f}", text_anchor="end",
            class_="scheme"),
        tag("rect", x=f"{start:.1f}", y=f"{down - 7:.1f}", width=f"{end - start:.1f}", height="14", rx="3",
            class_="null"),
        tag("circle", **shape, class_="seen" if seen else "unseen"),
        tag("text", short(value), x=f"{place + 12:.1f}", y=f"{down + 4:.1f}", class_="number"),
    )  # fmt: skip
