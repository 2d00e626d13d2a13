"""How CPU time and memory grow with trials, draws, parameters and sources: python -m benchmarks.growth

Each point is a command of its own, as a user runs it, on one core: `gaugeblock audit` of the exact estimator
of a linear Gaussian with everything that an audit does, or `gaugeblock discover --catalog` of spectra with a
hidden gain. Points that are in the JSON file already are not measured again. `--page` draws the figure and
fills docs/performance.md with what is there.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.kept import arguments, keep, stored
from benchmarks.processes import GAUGEBLOCK, VERDICTS, audit, cost
from studies.kit import page, plots

HERE = Path(__file__).resolve().parent
AUDIT = {"simulator.name": "linear_gaussian", "estimator.name": "exact"}


@dataclass(frozen=True)
class Axis:
    """What grows: sizes in rising order, and the commands for one of them in a folder."""

    sizes: tuple[int, ...]
    commands: Callable[[int, Path], list[list[str]]]
    beside: str


def audited(size: int, folder: Path, *, grows: str, **fixed: int) -> list[list[str]]:
    """Commands of an audit in which one number grows and the others stay."""
    numbers = {**fixed, grows: size}
    settings = {
        **AUDIT, "simulator.parameters": numbers["parameters"],
        "trials.number": numbers["trials"], "trials.draws": numbers["draws"],
    }  # fmt: skip
    return [[*audit(settings), "--out", str(folder / "out"), "--quiet"]]


def searched(size: int, folder: Path) -> list[list[str]]:
    """Commands that make a catalogue, and that search it."""
    made = folder / "catalog"
    model = ["--model", "tbabs*(powerlaw+bbodyrad)", "--band", "0.5", "8.0"]
    example = str(HERE.parent / "examples" / "hidden_catalog.py")
    return [
        [example, str(made), "--number", str(size)],
        ["discover", "--catalog", str(made), *model, "--out", str(folder / "out"), "--quiet"],
    ]


AXES: Mapping[str, Axis] = {
    "trials": Axis(
        (1000, 4000, 16_000, 64_000),
        partial(audited, grows="trials", draws=100, parameters=3),
        "100 draws, 3 parameters",
    ),
    "draws": Axis(
        (100, 400, 1600, 6400),
        partial(audited, grows="draws", trials=1000, parameters=3),
        "1,000 trials, 3 parameters",
    ),
    "parameters": Axis(
        (2, 5, 10, 20, 40),
        partial(audited, grows="parameters", trials=1000, draws=100),
        "1,000 trials, 100 draws",
    ),
    "sources": Axis((25, 50, 100, 200), searched, "bright EPIC-pn spectra, one shared effect"),
}


def measured(commands: Sequence[Sequence[str]]) -> dict[str, float]:
    """What the last command costs; those before it make its input."""
    *before, last = [[*([] if words[0].endswith(".py") else GAUGEBLOCK), *words] for words in commands]
    for words in before:
        cost(words, good=(0,))
    return cost(last, good=VERDICTS)


def grown(axes: Mapping[str, Axis], path: Path) -> dict[str, Any]:
    """Measure every point that the file lacks, one after the other, and keep each at once."""
    found = stored(path)
    for name, axis in axes.items():
        for size in axis.sizes:
            points = found.setdefault("axes", {}).setdefault(name, {})
            if str(size) in points:
                continue
            with tempfile.TemporaryDirectory() as temporary:
                points[str(size)] = measured(axis.commands(size, Path(temporary)))
            # The last step is that of the largest two, whichever were measured last.
            found["axes"][name] = dict(sorted(points.items(), key=lambda point: int(point[0])))
            keep(found, path, "python -m benchmarks.growth")
            sys.stderr.write(f"{name} {size:,}: {points[str(size)]}\n")
    return found


def exponent(points: Mapping[str, Mapping[str, float]], what: str) -> float:
    """How fast the last step grows: 1 where twice as many take twice as much.

    >>> exponent({"10": {"seconds": 1.0}, "100": {"seconds": 2.0}, "400": {"seconds": 32.0}}, "seconds")
    2.0
    """
    (one, before), (two, after) = list(points.items())[-2:]
    return round(math.log(after[what] / before[what]) / math.log(int(two) / int(one)), 2)


def shown(found: Mapping[str, Any]) -> str:
    """The table of docs/performance.md."""
    rows = []
    for name, axis in AXES.items():
        points = found["axes"].get(name)
        if points:
            sizes = ", ".join(f"{int(size):,}" for size in points)
            cells = [
                f"{', '.join(f'{point[what]:.3g}' for point in points.values())} "
                f"({exponent(points, what):.2g})"
                for what in ("seconds", "gb")
            ]
            rows.append([f"{sizes} {name} ({axis.beside})", *cells])
    header = ["", "CPU seconds (exponent of the last step)", "GB, largest process (exponent)"]
    return f"{page.table(header, rows)}\n\nOn {found['processor']}."


def figure(found: Mapping[str, Any]) -> Any:
    """CPU seconds and memory by size, a panel an axis."""
    figure, panels = plots.pyplot().subplots(1, len(AXES), figsize=(9.5, 2.5), layout="constrained")
    for panel, (name, points) in zip(panels, found["axes"].items(), strict=False):
        sizes = [int(size) for size in points]
        panel.loglog(sizes, [one["seconds"] for one in points.values()], "o-", color=plots.BLUE, ms=3)
        beside = panel.twinx()
        beside.loglog(sizes, [one["gb"] for one in points.values()], "s--", color=plots.ORANGE, ms=3)
        beside.set_ylim(0.1, 10)
        panel.set(xlabel=name, ylim=(3, 1000))
        panel.minorticks_off()
        beside.minorticks_off()
        panel.tick_params(axis="y", colors=plots.BLUE)
        beside.tick_params(axis="y", colors=plots.ORANGE)
    panels[0].set_ylabel("CPU seconds", color=plots.BLUE)
    beside.set_ylabel("GB", color=plots.ORANGE)
    return figure


def main(words: Sequence[str] | None = None) -> int:
    """Measure, or make the page."""
    chosen = arguments(__doc__, "axes", AXES, HERE / "growth.json").parse_args(words)
    if not chosen.page:
        grown({name: AXES[name] for name in chosen.axes}, chosen.out)
        return 0
    found = stored(chosen.out)
    plots.draw({"growth": lambda: figure(found)}, chosen.docs / "figures")
    page.fill(chosen.docs / "performance.md", {"growth": shown(found)})
    return 0


if __name__ == "__main__":
    sys.exit(main())
