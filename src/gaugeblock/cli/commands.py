"""The command line: parses, calls, prints. What it calls is imported only when a command runs."""

from __future__ import annotations

import io
import json
import signal
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gaugeblock.cli.attest import EXIT_CODES as ATTEST_EXIT_CODES
from gaugeblock.cli.attest import attest
from gaugeblock.cli.check import EXIT_CODES as CHECK_EXIT_CODES
from gaugeblock.cli.check import check
from gaugeblock.cli.diagnose import EXIT_CODES as DIAGNOSE_EXIT_CODES
from gaugeblock.cli.diagnose import diagnose
from gaugeblock.cli.discover import EXIT_CODES as DISCOVER_EXIT_CODES
from gaugeblock.cli.discover import discover
from gaugeblock.cli.init import init
from gaugeblock.cli.options import (
    AllowMixed,
    AllowModule,
    Baseline,
    Commit,
    CommitText,
    Ledger,
    Out,
    Part,
    PolicyName,
    Release,
    Scheduler,
    Seed,
    Settings,
    SimulatorName,
    StrangerBuilder,
    StrangerCommand,
    StrangerFormat,
    StrangerPath,
    StrangerPython,
    Trust,
    Workers,
    command,
    stranger_settings,
)
from gaugeblock.cli.report import EXIT_CODES as REPORT_EXIT_CODES
from gaugeblock.cli.report import compare, report
from gaugeblock.cli.reproduce import FORWARDED, reproduce
from gaugeblock.cli.schema import schema
from gaugeblock.cli.verify import EXIT_CODES as VERIFY_EXIT_CODES
from gaugeblock.cli.verify import verify
from gaugeblock.cli.voice import Commands, detail, hand_over, loud, refused, say, tell
from gaugeblock.core.errors import GaugeblockError, one_line, printable
from gaugeblock.core.interrupts import Interrupted, interrupt

if TYPE_CHECKING:
    from gaugeblock.auditing.result import Audit

EXIT_CODES = "Exit codes: 0 PASS, 1 FAIL, 3 INCONCLUSIVE, 2 bad input or an internal error."

app = Commands(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _version(wanted: bool) -> None:
    if wanted:
        from gaugeblock import __version__

        typer.echo(f"gaugeblock {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Statistical validation of simulator-based estimators: PASS, FAIL or INCONCLUSIVE."""


data_app = Commands(no_args_is_help=True, help="Real responses, spectra and tables.")
app.add_typer(data_app, name="data")
app.command(epilog=CHECK_EXIT_CODES)(check)
app.command(epilog=DIAGNOSE_EXIT_CODES)(diagnose)
app.command(epilog=DISCOVER_EXIT_CODES)(discover)
app.command(epilog=VERIFY_EXIT_CODES)(verify)
app.command(epilog=ATTEST_EXIT_CODES)(attest)
app.command(epilog=REPORT_EXIT_CODES)(report)
app.command(epilog=REPORT_EXIT_CODES)(compare)
app.command()(init)
app.command()(schema)
app.command(context_settings=FORWARDED, hidden=True)(reproduce)


@app.command(epilog=EXIT_CODES)
def audit(
    config: Annotated[
        Path | None,
        typer.Argument(metavar="[CONFIG.toml]", help="What to audit; default: the shipped flow."),
    ] = None,
    trials: Annotated[
        Path | None,
        typer.Option("--trials", metavar="FILE", help="Audit draws from disk; nothing is sampled."),
    ] = None,
    estimator: StrangerPath = None,
    simulator: SimulatorName = None,
    estimator_command: StrangerCommand = None,
    estimator_python: StrangerPython = None,
    estimator_format: StrangerFormat = None,
    estimator_builder: StrangerBuilder = None,
    trust: Trust = False,
    allow_module: AllowModule = None,
    out: Out = Path("gaugeblock-audit"),
    policy: PolicyName = None,
    seed: Seed = None,
    settings: Settings = None,
    validator: Annotated[
        list[str] | None, typer.Option("--validator", metavar="NAME", help="Run this one; repeatable.")
    ] = None,
    anytime: Annotated[
        bool, typer.Option("--anytime", help="Stop as soon as it is certain; valid at any trial.")
    ] = False,
    baseline: Baseline = None,
    ledger: Ledger = None,
    release: Release = False,
    commit: Commit = None,
    commit_text: CommitText = None,
    workers: Workers = 1,
    scheduler: Scheduler = None,
    part: Part = None,
    allow_mixed: AllowMixed = False,
) -> None:
    """Audit an estimator: simulate, estimate, validate, judge, report.

    Without a configuration it audits the flow that ships for XMM EPIC-pn spectra at medium counts. With
    --estimator it audits a file that nobody vouches for: that runs in a sandbox, and sees data only.
    An interrupted audit goes on where it stopped when the same command runs again. With --commit alone it
    writes down what is to be audited, and stops; with --commit-text too the seed is made of both files.
    """
    from gaugeblock.auditing.audit import audit_configured, audit_part
    from gaugeblock.auditing.audit import commit as write_commitment
    from gaugeblock.auditing.audit_draws import audit_draws
    from gaugeblock.auditing.config import read_config
    from gaugeblock.core.executors import opened, parse_part
    from gaugeblock.core.settings import parse_settings
    from gaugeblock.core.trust import only_named

    if trials is not None and (ledger is not None or release):
        raise GaugeblockError(
            "a ledger counts audits of estimators, and draws from disk say neither whose they are nor how "
            "often truths were drawn for them: leave out --ledger and --release (the folder of --out counts "
            "looks at draws that grow), or --trials"
        )
    changes = stranger_settings(
        path=estimator,
        command=estimator_command,
        python=estimator_python,
        format=estimator_format,
        builder=estimator_builder,
        trust=trust,
    )
    if trials is not None and (workers > 1 or scheduler or part or allow_mixed):
        raise GaugeblockError(
            "draws from disk leave nothing to fill: leave out --workers, --scheduler, --part and "
            "--allow-mixed, or --trials"
        )
    wanted = None if part is None else parse_part(part)
    if changes and config is None and simulator is None:
        raise GaugeblockError("say what the estimator is for: --simulator NAME, or a configuration")
    if simulator is not None:
        changes["simulator.name"] = simulator
    changes |= parse_settings(settings or [])
    if seed is not None and trials is None:
        changes["trials.seed"] = seed
    if anytime:
        changes["trials.anytime"] = True
    if validator:
        changes["validators"] = validator
    chosen = read_config(
        config, settings=changes, draws_given=trials is not None, allow_modules=allow_module or ()
    )
    if commit is None and commit_text is not None:
        raise GaugeblockError("--commit-text goes with --commit FILE, what it was committed to")
    if commit is not None:
        if trials is not None or part is not None:
            raise GaugeblockError("a commitment is to a whole audit: leave out --trials and --part")
        if commit_text is None:
            write_commitment(chosen, commit, policy=policy)
            say(f"committed: {commit}; publish it, and audit with a text that comes later: --commit-text")
            hand_over({"commitment": str(commit)})
            return
    said: dict[str, Any] = {
        "out": out,
        "policy": chosen.read_policy() if policy is None else policy,
        "baseline": baseline,
        "command": command(),
        "progress": loud(),
    }
    if trials is not None:
        with only_named(chosen.modules):
            said |= {"validators": chosen.validators, "summaries": chosen.summaries}
            _finish(audit_draws(trials, seed=seed or 0, **said), out)
    with opened(workers=workers, scheduler=scheduler) as (executor, line):
        if line:
            tell(line)
        said |= {"ledger": ledger, "release": release, "executor": executor, "allow_mixed": allow_mixed}
        if commit is not None and commit_text is not None:
            said["commitment"] = (commit, commit_text)
        if wanted is None:
            result = audit_configured(chosen, **said)
        else:
            del said["baseline"], said["command"]
            number = audit_part(chosen, part=wanted, **said)
    if wanted is not None:
        say(f"part {part}: {number} blocks are filled; the same command without --part finishes")
        hand_over({"part": part, "blocks": number})
        return
    _finish(result, out)


@app.command(epilog=EXIT_CODES)
def gate(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a finished audit.")],
    policy: PolicyName = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Folder for the files; default: DIR itself.")
    ] = None,
    seed: Seed = None,
) -> None:
    """Judge the findings of an earlier audit again, under another policy; nothing is sampled."""
    from gaugeblock.auditing.judging import judge

    result = judge(folder, policy or "default", out=out or folder, seed=seed, command=command())
    _finish(result, out or folder)


@app.command()
def plan(
    width_error: Annotated[
        float | None, typer.Option("--width-error", help="Tolerated error of the width, as a fraction: 0.1.")
    ] = None,
    bias: Annotated[float | None, typer.Option(help="Tolerated bias in half-widths (68%).")] = None,
    coverage: Annotated[float | None, typer.Option(help="Tolerated gap of central coverage.")] = None,
    power: Annotated[float | None, typer.Option(help="Probability of the right verdict.")] = None,
    params: Annotated[int | None, typer.Option(help="Number of parameters; default: 5, or LIKE's.")] = None,
    trials: Annotated[
        int | None, typer.Option(help="So many trials: what can they show? Default: how many does it take?")
    ] = None,
    draws: Annotated[
        int | None, typer.Option(help="Draws per trial; default: enough to hide little.")
    ] = None,
    like: Annotated[
        Path | None,
        typer.Option(
            "--like",
            metavar="PATH",
            help="Draws, or an audit, that show the posteriors' shape.",
        ),
    ] = None,
    policy: PolicyName = None,
    seed: Seed = None,
) -> None:
    """Plan an audit: trials and draws for a power, or the smallest fault that a number of trials detects.

    What is not given is as in the policy. Nothing is simulated.
    """
    from gaugeblock.auditing import planned

    made = planned.plan(
        bias=bias,
        width_error=width_error,
        coverage=coverage,
        power=power,
        params=params,
        trials=trials,
        draws=draws,
        like=like,
        policy=policy or "default",
        seed=seed or 0,
    )
    hand_over(json.loads(planned.as_json(made)))
    table = io.StringIO()
    planned.print_table(made, table)
    say(table.getvalue().rstrip("\n"))


@app.command()
def train(
    config: Annotated[Path, typer.Argument(metavar="CONFIG.toml", help="Simulator, network and training.")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Model folder; default: the configuration's.")
    ] = None,
    seed: Seed = None,
    replace: Annotated[bool, typer.Option("--replace", help="Replace the model that is there.")] = False,
    settings: Settings = None,
    allow_module: AllowModule = None,
) -> None:
    """Train a neural posterior estimator; writes model.safetensors and model.json.

    An interrupted training goes on where it stopped when the same command runs again. A model that is there
    already is replaced with --replace only.
    """
    from gaugeblock.core.progress import shown
    from gaugeblock.core.settings import parse_settings
    from gaugeblock.estimators.npe import run_training

    with shown(loud()) as progress:
        folder = run_training(
            config,
            out=out,
            overrides=parse_settings(settings or []),
            allow_modules=allow_module or (),
            seed=seed,
            replace=replace,
            progress=progress,
        )
    say(f"trained: {folder}")
    hand_over({"model": str(folder)})


@data_app.command()
def fetch() -> None:
    """Put the reference case's responses, spectra and tables into the cache, each checked by sha256."""
    from gaugeblock.simulators.xray.data import fetch as run

    fetched = run(progress=tell)
    say(fetched.summary())
    hand_over(vars(fetched))


def _finish(result: Audit, out: Path) -> None:
    from gaugeblock.reports.machine import verdict_json
    from gaugeblock.reports.terminal import terminal_summary

    say(terminal_summary(result.verdict, out, findings=result.findings, resources=result.resources))
    for each in result.verdict.gates:
        detail(f"  {each.outcome.value:<12} {each.id}: {each.message}")
    hand_over(json.loads(verdict_json(result.verdict, result.findings)))
    raise typer.Exit(result.verdict.outcome.exit_code)


def main() -> None:
    """Entry point of `gaugeblock`."""
    from gaugeblock.core.compilation_cache import keep_compiled
    from gaugeblock.core.devices import tell_jax

    # Of a program that only imports us the settings are its own.
    tell_jax()
    keep_compiled()
    run(lambda: app(prog_name="gaugeblock"))


def run(commands: Callable[[], object]) -> None:
    """Run a command line: errors become one line on stderr and exit code 2."""
    signal.signal(signal.SIGINT, on_interrupt)
    try:
        commands()
    except (GaugeblockError, Interrupted) as error:
        _fail(error, str(error))
    except MemoryError as error:
        _fail(error, "memory ran short; fewer trials a block (trials.block) or fewer draws take less")
    except Exception as error:
        _fail(error, f"internal error: {type(error).__name__}: {error} (--debug shows where)")


def on_interrupt(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001
    """Handler of SIGINT: ends what is not being written."""
    interrupt()


def _fail(error: BaseException, line: str) -> None:
    if "--debug" in sys.argv:
        typer.echo(printable("".join(traceback.format_exception(error))), nl=False, err=True)
    # There may be words in it of whoever wrote what is audited.
    typer.echo(f"gaugeblock: {one_line(line)}", err=True)
    refused(one_line(line))
    sys.exit(2)
