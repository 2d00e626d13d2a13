"""The pytest plugin: two fixtures, the marker `calibration`, options, a section in the summary.

pytest loads this file in every run of everybody who has gaugeblock installed, so it imports nothing heavier
than pytest; the rest comes with the first test that asks for the fixture.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import TYPE_CHECKING, Any

import pytest

from gaugeblock.testing.outcomes import (
    INCONCLUSIVE,
    CalibrationError,
    CalibrationFailed,
    CalibrationInconclusive,
    Note,
)

if TYPE_CHECKING:
    from gaugeblock.testing.gate import CalibrationGate
    from gaugeblock.validate.likelihood.same_likelihood import LikelihoodComparison

__all__ = [
    "CalibrationError",
    "CalibrationFailed",
    "CalibrationInconclusive",
    "calibration_gate",
    "same_likelihood",
]

_NOTES = pytest.StashKey[list[Note]]()

# name, type, metavar, help: each is an option --calibration-NAME and an ini option calibration_NAME.
_OPTIONS: tuple[tuple[str, Callable[[str], Any], str, str], ...] = (
    ("trials", int, "N", "simulated trials of a calibration gate (default: 4000)"),
    ("draws", int, "N", "posterior draws of each trial (default: 250)"),
    ("seed", int, "N", "seed of everything random in a calibration gate (default: fixed)"),
    ("policy", str, "P.toml", "policy of calibration gates: default, strict or a TOML file"),
    ("ledger", str, "FILE", "enter every calibration gate in a ledger, which counts the audits before it"),
    ("out", str, "DIR", "keep each gate's report, trials and verdict in a folder below DIR"),
    (
        "inconclusive",
        str,
        "|".join(INCONCLUSIVE),
        "what INCONCLUSIVE does to the test (default: fail)",
    ),
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """The options, on the command line and in the ini file."""
    group = parser.getgroup("calibration", "calibration gates (gaugeblock)")
    # Native TOML configuration wants the type, which older versions of pytest refuse.
    number: Any = "int" if pytest.version_tuple >= (8, 4) else "string"
    text: Any = "string"
    for name, kind, metavar, about in _OPTIONS:
        choices = INCONCLUSIVE if name == "inconclusive" else None
        group.addoption(f"--calibration-{name}", type=kind, metavar=metavar, choices=choices, help=about)
        parser.addini(f"calibration_{name}", about, type=number if kind is int else text, default=None)


def pytest_configure(config: pytest.Config) -> None:
    """The marker, for runs with --strict-markers."""
    config.addinivalue_line(
        "markers",
        "calibration(*, trials, draws, seed, policy, validators, inconclusive): what the test's "
        "calibration_gate runs with; every test that uses the fixture has this marker",
    )


def pytest_itemcollected(item: pytest.Item) -> None:
    """Mark every test that uses the fixture, so that -m "not calibration" leaves them out."""
    if "calibration_gate" in getattr(item, "fixturenames", ()):
        item.add_marker("calibration")


@pytest.fixture
def calibration_gate(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> CalibrationGate:
    """Audit an estimator on a simulator: ``calibration_gate(estimator, simulator)``.

    PASS returns the audit; FAIL and INCONCLUSIVE fail the test with a short table.
    """
    from gaugeblock.testing.gate import CalibrationGate

    notes = request.node.stash.setdefault(_NOTES, [])
    return CalibrationGate(request.node, tmp_path_factory, notes)


@pytest.fixture
def same_likelihood() -> Callable[..., LikelihoodComparison]:
    """Hold two likelihood codes against each other: ``same_likelihood(ours, theirs, prior, simulate)``.

    Over the whole prior, and on examples that hypothesis looks for; a difference fails the test by its name.
    """
    from gaugeblock.testing.same_likelihood import same_likelihood

    return same_likelihood


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, Any, None]:
    """Put what the gates found on the report, which is what reaches the process that prints the summary."""
    outcome = yield
    report = outcome.get_result()
    if report.when == "call" and item.stash.get(_NOTES, []):
        report.calibration = item.stash[_NOTES]


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """What the gates that did not block would have seen."""
    reports = [report for reports in terminalreporter.stats.values() for report in reports]
    notes = [note for report in reports for note in getattr(report, "calibration", ())]
    shown = sorted((note for note in notes if not note["blocks"]), key=lambda note: str(note["test"]))
    if shown:
        terminalreporter.write_sep("=", "calibration")
    for note in shown:
        terminalreporter.write_line(f"{note['verdict']} {note['test']}: {note['headline']}")
        for line in note["lines"]:
            terminalreporter.write_line(f"    {line}")
