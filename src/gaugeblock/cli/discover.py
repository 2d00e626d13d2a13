"""The command `gaugeblock discover`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gaugeblock.cli.options import Out, Scheduler, Seed, Workers, command
from gaugeblock.cli.voice import hand_over, loud, say, tell

EXIT_CODES = "Exit codes: 0 when the workflow ran to its end, whatever it found; 2 bad input."


def energies(text: str) -> tuple[float, float]:
    """A band in keV from how it is written, ``0.3-10``.

    Raises
    ------
    InputError
        If these are not two numbers.
    """
    from gaugeblock.core.errors import InputError

    try:
        low, high = map(float, text.split("-"))
    except ValueError:
        raise InputError(f"--bands {text}: give two energies in keV, such as 0.3-10") from None
    return low, high


def discover(
    pha: Annotated[
        list[Path] | None,
        typer.Argument(metavar="[PHA ...]", help="Spectra of one source; several: as many instruments."),
    ] = None,
    model: Annotated[
        str, typer.Option(help="What should explain them, as in XSPEC: 'tbabs*(powerlaw+bbodyrad)'.")
    ] = "tbabs*powerlaw",
    catalog: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Many sources of one instrument: catalog.csv (pha, redshift) or *.pha."
        ),
    ] = None,
    priors: Annotated[
        Path | None, typer.Option(metavar="FILE.toml", help="Priors; parameters left out have defaults.")
    ] = None,
    band: Annotated[
        tuple[float, float] | None, typer.Option(metavar="LOW HIGH", help="Energies in keV.")
    ] = None,
    bands: Annotated[
        list[str] | None, typer.Option(metavar="LOW-HIGH", help="Instead of --band; one a spectrum.")
    ] = None,
    rmf: Annotated[list[Path] | None, typer.Option(help="Instead of the header's; one a spectrum.")] = None,
    arf: Annotated[list[Path] | None, typer.Option(help="Instead of the header's; one a spectrum.")] = None,
    background: Annotated[
        list[str] | None, typer.Option(help="Instead of the header's; 'none' does without.")
    ] = None,
    redshift: Annotated[float, typer.Option(help="Of the source.")] = 0.0,
    regroup: Annotated[
        str,
        typer.Option(
            help="Group channels by the resolution: ungrouped (where there are none), never, always."
        ),
    ] = "ungrouped",
    sys_err: Annotated[
        bool, typer.Option("--sys-err", help="Use SYS_ERR of the file as scatter beyond Poisson's.")
    ] = False,
    effect: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Search for this effect only; repeatable.")
    ] = None,
    energy: Annotated[
        float | None,
        typer.Option(
            metavar="KEV", help="Of a line or edge, at rest, stated before the scan: one trial is paid."
        ),
    ] = None,
    own: Annotated[
        list[str] | None,
        typer.Option(metavar="MODULE:OBJECT", help="An effect of your own beside the library; repeatable."),
    ] = None,
    replicates: Annotated[int, typer.Option(help="Simulated data sets behind a global p.")] = 999,
    evidence: Annotated[
        bool,
        typer.Option("--evidence", help="Add the evidence of the named effect: nested sampling, slow."),
    ] = False,
    out: Out = Path("gaugeblock-discovery"),
    seed: Seed = None,
    workers: Workers = 1,
    scheduler: Scheduler = None,
) -> None:
    """Find where model and measured spectra disagree, name the missing effect, add it, test the name.

    Writes discovery.json, discovery.nc and report.html, and of one source its best fits for XSPEC:
    model_before.xcm and model_after.xcm. An interrupted search of a catalogue goes on where it stopped when
    the same command runs again.
    """
    from gaugeblock.auditing import discovering
    from gaugeblock.core.errors import InputError
    from gaugeblock.core.executors import opened
    from gaugeblock.reports.discovery.best_fit import fit_rows
    from gaugeblock.reports.discovery.headline import headline
    from gaugeblock.reports.discovery.priors import prior_rows

    if bool(pha) == (catalog is not None):
        raise InputError("discover: name either PHA files of one source, or --catalog with a folder of many")
    if band is not None and bands:
        raise InputError("discover: give either --band for all spectra or --bands, one a spectrum")
    if catalog is not None and not catalog.is_dir():
        raise InputError(f"discover: --catalog {catalog} is no folder")
    with opened(workers=workers, scheduler=scheduler) as (executor, line):
        if line:
            tell(line)
        found = discovering.discover(
            catalog if catalog is not None else pha,
            model=model,
            priors=priors,
            band=[energies(one) for one in bands] if bands else band,
            rmf=rmf or (),
            arf=arf or (),
            background=background or (),
            redshift=redshift,
            regroup=regroup,
            sys_err=sys_err,
            effects=own or (),
            only=effect or (),
            energy=energy,
            evidence=evidence,
            replicates=replicates,
            seed=seed or 0,
            out=out,
            progress=loud(),
            executor=executor,
            command=command(),
        )
    summary = found.to_json()
    top = headline(summary)
    for number, statement in enumerate(top.statements, 1):
        say(f"{number}. {statement}")
    say(top.paragraph)
    for name, before, after in fit_rows(summary, backgrounds=False):
        say(f"  {name}: {before}" + (f"; after: {after}" if summary["named_all"] else ""))
    for name, odds, usual, limits in prior_rows(summary):
        say(f"  prior of {name}: odds {odds}; usually {usual}; hard limits: {limits}")
    for note in summary["provenance"]["notes"]:
        say(f"note: {note}")
    say(f"report: {out / 'report.html'}")
    hand_over(summary)
