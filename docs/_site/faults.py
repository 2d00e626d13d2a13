"""What ranks, coverage, TARP and C2ST look like for each fault: the pictures and the table of docs/faults.md.

``python docs/_site/faults.py`` audits estimators that are wrong in known ways and writes both again, and the
picture of docs/diagnosis.md: the same faults mended.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

import gaugeblock as gb
from gaugeblock.estimators.broken import WithTruth
from gaugeblock.estimators.registry import build_estimator
from gaugeblock.reports.mended import mended
from gaugeblock.reports.svg import drawing, tag
from gaugeblock.simulators import build_simulator
from gaugeblock.validate.joint.tarp import tarp
from gaugeblock.validate.learned.learned import learned_from
from gaugeblock.validate.policy import Levels
from gaugeblock.validate.prepared import Prepared, pit

DOCS = Path(__file__).resolve().parents[1]
# Columns alike, so that the posterior's parameters are correlated by -0.87.
MODEL = build_simulator("linear_gaussian", parameters=2, data=3, matrix=[[1.0, 0.8], [0.6, 1.0], [1.0, 1.0]])
EXACT = build_estimator("exact", MODEL)
PANELS = ("ranks", "coverage", "TARP", "C2ST")
# A panel's place and size, bins of a histogram, how far the axes of gaps reach.
WIDTH, HEIGHT, STEP, TOP, BINS, REACH = 150.0, 92.0, 172.0, 24.0, 16, 0.3
# Columns of the table: by what a gate's id begins with.
CHECKS = (
    *("sbc.bias", "sbc.log_width", "coverage.central", "tails.outliers", "joint.tarp", "joint.projections"),
    *("local.coverage", "c2st.rank", "lc2st.local", "informed.rank"),
)

# Shown as they are and mended.
MENDED = ("narrow", "wide", "shifted")

Sample = Callable[[NDArray[Any], int, Any], NDArray[Any]]


def _skewed(x: NDArray[Any], n: int, rng: Any) -> NDArray[Any]:
    draws = EXACT.sample(x, n, rng)
    middle, sd = draws.mean(axis=1, keepdims=True), draws.std(axis=1, keepdims=True)
    # Of a lognormal with this shape: mean and standard deviation as they were.
    lopsided = np.exp(0.6 * (draws - middle) / sd)
    return middle + sd * (lopsided - np.exp(0.18)) / np.sqrt(np.expm1(0.36) * np.exp(0.36))


def _ignored(x: NDArray[Any], n: int, rng: Any) -> NDArray[Any]:
    draws = EXACT.sample(x, n, rng)
    draws[..., 0] = MODEL.prior.sample(len(x) * n, rng)[:, 0].reshape(len(x), n)
    return draws


def _stray(x: NDArray[Any], n: int, rng: Any) -> NDArray[Any]:
    draws = EXACT.sample(x, n, rng)
    return draws + 12.0 * draws.std(axis=1, keepdims=True) * (rng.random((len(x), n, 1)) < 0.01)


def _broken(fault: str, size: float | None = None) -> Mapping[str, Any]:
    return {"name": "broken", "fault": fault} | ({} if size is None else {"size": size})


FAULTS: Mapping[str, tuple[Any, Any]] = {
    "exact": (EXACT, MODEL),
    "narrow": (_broken("narrow", 0.7), MODEL),
    "wide": (_broken("wide", 1.4), MODEL),
    "shifted": (_broken("shifted", 0.4), MODEL),
    "skewed": (_skewed, MODEL),
    "stray": (_stray, MODEL),
    "ignored": (_ignored, MODEL),
    "prior": (_broken("prior"), MODEL),
    "uncorrelated": (_broken("uncorrelated"), MODEL),
    "mode_dropped": (_broken("mode_dropped"), MODEL),
    "wrong_when_bright": (_broken("wrong_when_bright", 0.7), MODEL),
    "leaking": (_broken("leaking", 0.5), WithTruth(MODEL)),
}


def audited(name: str, *, trials: int = 4000, draws: int = 100) -> gb.Audit:
    """An audit of the estimator with this fault, by what draws and data tell."""
    estimator, simulator = FAULTS[name]
    chosen = ["draws", "sbc", "coverage", "tails", "joint", "local", "c2st", "lc2st", "informed"]
    number = {"number": trials, "draws": draws, "importance_number": 0, "joint_number": 0}
    return gb.audit(estimator, simulator, trials=number, validators=chosen, progress=False)


def row(result: gb.Audit) -> dict[str, str]:
    """The worst verdict that each check comes to."""
    worst = {}
    for check in CHECKS:
        found = {str(gate.outcome) for key, gate in result.gates.items() if key.partition("[")[0] == check}
        worst[check] = next((said for said in ("FAIL", "INCONCLUSIVE", "PASS") if said in found), "")
    return worst


def picture(name: str, result: gb.Audit) -> str:
    """Four panels: ranks of the first parameter, its central coverage, TARP's, ranks in a learned score."""
    prepared = Prepared(result.trials, 1, Levels())
    first = prepared.per_trial(pit)[:, 0]
    values = (first, abs(2 * first - 1), prepared.per_trial(tarp)[:, 0], learned_from(prepared).pit)
    marks: list[str] = [tag("rect", width="100%", height="100%", fill="white")]
    for number, (title, one) in enumerate(zip(PANELS, values, strict=True)):
        draw = _histogram if title in ("ranks", "C2ST") else _gaps
        marks.append(tag("text", title, x=10 + STEP * number, y=15, font_size=12, fill="#333"))
        marks += [
            tag("g", *draw(one), transform=f"translate({10 + STEP * number:g} {TOP:g})"),
        ]
    title, said = f"{name}: {', '.join(PANELS)}", "Grey is what an exact posterior shows."
    width, height = 10 + STEP * len(PANELS), HEIGHT + TOP + 10
    return _alone(
        drawing(marks, width=width, height=height, key=name, title=title, description=said, class_="fault")
    )


def mended_picture(results: Mapping[str, gb.Audit]) -> str:
    """A column for each fault: ranks of the first parameter as they are, and with the diagnosis' repair."""
    marks: list[str] = [tag("rect", width="100%", height="100%", fill="white")]
    for number, (name, result) in enumerate(results.items()):
        said = result.diagnose()
        both = mended(replace(result.verdict, diagnosis=said.to_json()), result.trials)
        if both is None:
            raise SystemExit(f"{name}: {said.text}")
        for line, (one, word) in enumerate(zip(both, (name, f"mended: {said.named}"), strict=True)):
            x, y = 10 + STEP * number, TOP + line * (HEIGHT + TOP)
            marks.append(tag("text", word, x=x, y=y - 9, font_size=12, fill="#333"))
            drawn = _histogram(one.ranks(one.theta)[:, 0])
            marks.append(tag("g", *drawn, transform=f"translate({x:g} {y:g})"))
    title, said_of = "Ranks before and after the repair", "Grey is what an exact posterior shows."
    width, height = 10 + STEP * len(results), 2 * (HEIGHT + TOP) + 10
    return _alone(
        drawing(
            marks, width=width, height=height, key="mended", title=title, description=said_of, class_="fault"
        )
    )


def _alone(svg: Markup) -> str:
    """A drawing as a file of its own."""
    with_font = '<svg xmlns="http://www.w3.org/2000/svg" font-family="sans-serif" '
    return str(svg).replace("<svg ", with_font, 1) + "\n"


def _box() -> Markup:
    return tag("rect", width=WIDTH, height=HEIGHT, fill="none", stroke="#999")


def _histogram(values: NDArray[Any]) -> list[str]:
    """Shares of trials per bin, 1 is uniform, with what 99% of exact posteriors stay within."""
    share = np.histogram(values, BINS, (0.0, 1.0))[0] * BINS / len(values)
    scale = HEIGHT / max(2.0, 1.05 * share.max())
    noise = 2.58 * np.sqrt((BINS - 1) / len(values))
    bars = [
        tag(
            "rect", x=f"{k * WIDTH / BINS:.1f}", y=f"{HEIGHT - scale * each:.1f}",
            width=f"{WIDTH / BINS - 1:.1f}", height=f"{scale * each:.1f}", fill="#2a7f8e",
        )
        for k, each in enumerate(share)
    ]  # fmt: skip
    band = tag(
        "rect", y=f"{HEIGHT - scale * (1 + noise):.1f}", width=WIDTH, height=f"{2 * scale * noise:.1f}",
        fill="#999", fill_opacity=0.45,
    )  # fmt: skip
    return [*bars, band, _box()]


def _gaps(values: NDArray[Any]) -> list[str]:
    """Coverage less level, by level; values are levels from which on the truth is inside."""
    level = np.linspace(0.0, 1.0, 51)
    gap = (values[:, None] <= level).mean(axis=0) - level
    noise = 2.58 * np.sqrt(level * (1 - level) / len(values))

    def path(height: NDArray[Any], back: NDArray[Any] | None = None) -> str:
        points = list(zip(level, height, strict=True))
        points += [] if back is None else list(zip(level, back, strict=True))[::-1]
        at = (f"{WIDTH * a:.1f} {HEIGHT / 2 * (1 - np.clip(b / REACH, -1, 1)):.1f}" for a, b in points)
        return "M" + "L".join(at)

    return [
        tag("path", d=path(noise, -noise) + "Z", fill="#999", fill_opacity=0.45),
        tag("path", d=path(gap), fill="none", stroke="#2a7f8e", stroke_width=2),
        _box(),
    ]


def table(rows: Mapping[str, Mapping[str, str]]) -> str:
    """Markdown: a line for each fault, a column for each check."""
    signs = {"FAIL": "**FAIL**", "PASS": "pass", "INCONCLUSIVE": "?", "": ""}
    lines = [" | ".join(["", "", *(f"`{check}`" for check in CHECKS), ""]).strip()]
    lines.append("|---" * (len(CHECKS) + 1) + "|")
    for name, one in rows.items():
        lines.append(" | ".join([f"| {name.replace('_', ' ')}", *(signs[one[c]] for c in CHECKS)]) + " |")
    return "\n".join(lines)


def main() -> None:
    """Write the pictures, and the table between its marks."""
    rows, shown = {}, {}
    for name in FAULTS:
        result = audited(name)
        shown |= {name: result} if name in MENDED else {}
        rows[name] = row(result)
        (DOCS / "figures" / f"fault-{name}.svg").write_text(picture(name, result), encoding="utf-8")
        sys.stderr.write(f"{name}: {result.outcome}\n")
    (DOCS / "figures" / "diagnosis-mended.svg").write_text(mended_picture(shown), encoding="utf-8")
    page = DOCS / "faults.md"
    marks = re.compile(r"(<!-- what sees what -->\n).*?(<!-- /what sees what -->)", re.DOTALL)
    page.write_text(
        marks.sub(lambda m: f"{m[1]}{table(rows)}\n{m[2]}", page.read_text(encoding="utf-8")),
        encoding="utf-8",
    )


if __name__ == "__main__":
    main()
