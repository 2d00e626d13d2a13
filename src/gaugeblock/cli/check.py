"""The command `gaugeblock check`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from gaugeblock.cli.options import (
    Out,
    Seed,
    Settings,
    StrangerBuilder,
    StrangerCommand,
    StrangerFormat,
    StrangerPython,
    Trust,
    command,
    stranger_settings,
)
from gaugeblock.cli.voice import hand_over, loud, say
from gaugeblock.core.errors import InputError

EXIT_CODES = "Exit codes: 0 PASS, 1 FAIL, 3 INCONCLUSIVE, 2 bad input or an internal error."


def check(
    simulator: Annotated[str, typer.Option("--simulator", metavar="NAME", help="Name, or module:object.")],
    observation: Annotated[
        Path, typer.Option("--observation", metavar="x.npy", help="One data set, or several: .npy or NetCDF.")
    ],
    estimator: Annotated[
        str | None,
        typer.Option("--estimator", metavar="NAME|PATH", help="Adds what is left after fitting."),
    ] = None,
    estimator_command: StrangerCommand = None,
    estimator_python: StrangerPython = None,
    estimator_format: StrangerFormat = None,
    estimator_builder: StrangerBuilder = None,
    trust: Trust = False,
    trials: Annotated[int, typer.Option(help="Fresh simulations that are ranked.")] = 999,
    simulations: Annotated[int, typer.Option(help="Other simulations, to learn views on.")] = 4000,
    level: Annotated[float, typer.Option(help="FAIL at p-values up to this.")] = 0.05,
    sees: Annotated[
        list[str] | None,
        typer.Option("--sees", metavar="KIND=SIZE", help="What a PASS needs to have seen; repeatable."),
    ] = None,
    view: Annotated[
        list[str] | None, typer.Option("--view", metavar="NAME", help="Use this view only; repeatable.")
    ] = None,
    axis: Annotated[
        list[str] | None, typer.Option("--axis", metavar="WORD", help="What an axis of the data is called.")
    ] = None,
    settings: Settings = None,
    out: Out = Path("gaugeblock-check"),
    seed: Seed = None,
) -> None:
    """Could this simulator have made this observation?

    Ranks it among fresh simulations in several ways at once, says where it disagrees, how large a discrepancy
    would have been seen, and what it looks like. Writes check.json and report.html. Options of simulator and
    estimator: --set simulator.level=bright.
    """
    from gaugeblock.auditing import checking
    from gaugeblock.core.settings import parse_settings

    stranger = stranger_settings(
        path=Path(estimator) if estimator and Path(estimator).is_file() else None,
        command=estimator_command,
        python=estimator_python,
        format=estimator_format,
        builder=estimator_builder,
        trust=trust,
    )
    said = parse_settings(settings or [])
    chosen = {key.partition(".")[2]: value for key, value in stranger.items()}
    found = checking.check(
        with_options(simulator, said, "simulator"),
        observation,
        with_options(chosen or estimator, said, "estimator"),
        trials=trials,
        simulations=simulations,
        level=level,
        sees=parsed_sizes(sees) if sees else None,
        views=view or None,
        axes=axis or (),
        seed=seed or 0,
        out=out,
        progress=loud(),
        command=command(),
    )
    say("\n  ".join(found.lines))
    say(f"Report: {out / 'report.html'}")
    hand_over(found.to_json())
    raise typer.Exit(found.outcome.exit_code)


def with_options(choice: Any, settings: Mapping[str, Any], table: str) -> Any:
    """What was named on the command line with the options ``table.key`` that were set.

    Raises
    ------
    InputError
        If options are set of something that was not named.

    >>> with_options("xray", {"simulator.level": "bright"}, "simulator")
    {'name': 'xray', 'level': 'bright'}
    """
    unknown = [key for key in settings if key.partition(".")[0] not in ("simulator", "estimator")]
    if unknown:
        raise InputError(f"--set {unknown[0]}: a check has options of simulator and estimator only")
    own = {key.partition(".")[2]: value for key, value in settings.items() if key.startswith(f"{table}.")}
    if not own:
        return choice
    if choice is None:
        raise InputError(f"--set {table}.{next(iter(own))}: say which {table}, with --{table} NAME")
    return {**(choice if isinstance(choice, Mapping) else {"name": choice}), **own}


def parsed_sizes(said: Sequence[str]) -> dict[str, float]:
    """Kinds of discrepancy and their sizes, from ``kind=size``.

    Raises
    ------
    InputError
        If one is not that.

    >>> parsed_sizes(["noise=0.5"])
    {'noise': 0.5}
    """
    found = {}
    for one in said:
        kind, _, size = one.partition("=")
        try:
            found[kind] = float(size)
        except ValueError:
            raise InputError(f"--sees {one}: give KIND=SIZE, for instance noise=0.5") from None
    return found
