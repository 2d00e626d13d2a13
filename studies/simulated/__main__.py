"""How much of the exact information discovery by simulations holds, what it names, how intervals hold."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import xarray as xr

import gaugeblock.discovery
import gaugeblock.simulators.epidemic
import studies.simulated
from gaugeblock.core.progress import Bars
from studies.kit.command import carried_out, given, parser
from studies.kit.results import record, write
from studies.kit.resume import Arrays, Pieces, code_of, joined, stream
from studies.simulated.cases import HIDDEN, MOST, UNLISTED, plain, searched, told, with_effect
from studies.simulated.document import blocks, document, tables_in
from studies.simulated.information import shares
from studies.simulated.series import HEIGHT, KINDS, found_in

NAME = "studies simulated"
NOTHING = "nothing"

Make = Callable[[int, np.random.Generator], Arrays]


def _hidden(name: str, ranges: Any, simulations: int, *, alone: bool = False) -> Make:
    def make(_: int, rng: np.random.Generator) -> Arrays:
        x, truth = with_effect(name, ranges, rng)
        return searched(x, rng, simulations=simulations, truth=truth, only=(name,) if alone else ())

    return make


def _other(draw: Callable[[np.random.Generator], Any], simulations: int) -> Make:
    return lambda _, rng: searched(draw(rng), rng, simulations=simulations)


def _series(kind: str, seed: int, simulations: int) -> Make:
    def make(number: int, _: np.random.Generator) -> Arrays:
        # Both kinds see the same series.
        rng = np.random.default_rng(stream(seed, "series", number))
        return told(lambda: found_in(kind, number, rng, simulations=simulations), HEIGHT)

    return make


def table_of(parts: dict[str, list[Arrays]], axis: str) -> xr.Dataset:
    """Pieces of several kinds, equally many of each, as one table ``(kind, axis)``."""
    names = next(iter(parts.values()))[0]
    return xr.Dataset(
        {name: (("kind", axis), np.stack([joined(each, name) for each in parts.values()])) for name in names},
        coords={"kind": list(parts)},
    )


def main(arguments: Sequence[str]) -> int:
    """Run what is not there yet, keep the tables, write the page."""
    options = parser(NAME, __doc__)
    for name, value in (
        ("information", 3),
        ("names", 6),
        ("nothing", 20),
        ("intervals", 120),
        ("series", 30),
        ("simulations", 6000),
    ):
        options.add_argument(f"--{name}", type=int, default=value)
    options.add_argument("--name", default="simulated", help="in OUT; parts may have others: document.py")
    options.add_argument("--report", action="store_true", help="text from OUT; nothing is run")
    chosen = options.parse_args(arguments)
    if chosen.report:
        return carried_out(lambda: document(tables_in(chosen.out), chosen.docs))
    return carried_out(lambda: _run(chosen, given(NAME, arguments)))


def _run(chosen: Any, command: str) -> None:
    size = chosen.simulations
    code = code_of(gaugeblock.discovery, gaugeblock.simulators.epidemic, studies.simulated)
    key = {"seed": chosen.seed, "simulations": size, "code": code}
    with Bars() as bars:
        pieces = Pieces(
            chosen.work or chosen.out / "checkpoints", key, "simulated", bars.show, chosen.workers
        )

        def made(part: str, makes: dict[str, Make], number: int) -> xr.Dataset:
            found = {
                name: pieces.each(f"{part} {name}", number, make, chosen.seed) for name, make in makes.items()
            }
            return table_of(found, "catalogue").assign_attrs(record(command, chosen.seed, simulations=size))

        often = {name: _hidden(name, ranges, size, alone=True) for name, ranges in MOST.items()}
        parts: dict[str, tuple[str, dict[str, Make], int]] = {
            "intervals": ("interval", often, chosen.intervals),
            "names": (
                "name", {name: _hidden(name, ends, size) for name, ends in HIDDEN.items()}, chosen.names
            ),
            "unlisted": (
                "unlisted", {name: _other(draw, size) for name, draw in UNLISTED.items()}, chosen.names
            ),
            "nothing": ("none", {NOTHING: _other(plain, size)}, chosen.nothing),
            "series": ("series", {kind: _series(kind, chosen.seed, size) for kind in KINDS}, chosen.series),
        }  # fmt: skip
        tables = {name: made(*part) for name, part in parts.items() if part[-1]}
        found = pieces.each(
            "information", chosen.information, lambda _, rng: shares(rng, simulations=size), chosen.seed
        )
    if found:
        first = found[0]
        tables["information"] = xr.Dataset(
            {
                **{name: ("score", first[name]) for name in ("effect", "week")},
                **{
                    name: (("catalogue", "score"), np.stack([one[name] for one in found]))
                    for name in ("share", "ceiling", "rare", "moved")
                },
            },
            attrs=record(command, chosen.seed, simulations=size),
        )
    write(
        {"": xr.Dataset(attrs=record(command, chosen.seed, simulations=size)), **tables},
        chosen.out / f"{chosen.name}.nc",
    )
    for block in blocks(tables).values():
        sys.stdout.write(block + "\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
