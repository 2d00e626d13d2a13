"""The object behind the fixture `calibration_gate`: an audit whose verdict decides a test."""

from __future__ import annotations

import re
import traceback
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import pytest

import gaugeblock
from gaugeblock.auditing.audit import audit
from gaugeblock.auditing.result import Audit
from gaugeblock.auditing.workplace import CHUNKS, discard
from gaugeblock.core.digest import digest
from gaugeblock.core.errors import GaugeblockError
from gaugeblock.testing.outcomes import CalibrationError, CalibrationFailed, CalibrationInconclusive, Note
from gaugeblock.testing.settings import GateSettings, Layer, decide, outer_layers
from gaugeblock.testing.text import blocked, detectable, headline, properties
from gaugeblock.validate import Outcome, Policy


class CalibrationGate:
    """Call it with an estimator and a simulator; the test goes on only if the verdict is PASS.

    `notes` take what the terminal summary shows.
    """

    def __init__(self, item: pytest.Item, temporary: pytest.TempPathFactory, notes: list[Note]):
        self._item, self._temporary, self._notes = item, temporary, notes
        self._number = 0
        with _one_line():
            self._layers = outer_layers(item)
            decide([self._call({}), *self._layers], item.config.rootpath)

    def __call__(
        self,
        estimator: Any,
        simulator: Any,
        *,
        prior: Any = None,
        names: Sequence[str] | None = None,
        trials: int | None = None,
        draws: int | None = None,
        seed: int | None = None,
        policy: str | Path | Mapping[str, Any] | Policy | None = None,
        validators: str | Iterable[str] | None = None,
        ledger: str | Path | None = None,
        out: str | Path | None = None,
    ) -> Audit:
        """Audit the estimator on the simulator and return what was found, if the verdict is PASS.

        Both, `prior` and `names` are whatever `gaugeblock.audit` takes. What else is not given here is as
        the marker says, else the command line, else the ini file.

        Raises
        ------
        CalibrationFailed
            If the verdict is FAIL.
        CalibrationInconclusive
            If it is INCONCLUSIVE (unless that was chosen to skip or xfail the test).
        CalibrationError
            If something given cannot be used, or simulator and estimator do not fit.
        """
        __tracebackhide__ = True
        model = {"prior": prior, "names": names}
        given = {"trials": trials, "draws": draws, "seed": seed, "policy": policy}
        call = self._call({**given, "validators": validators, "ledger": ledger, "out": out})
        with _one_line():
            settings = decide([call, *self._layers], self._item.config.rootpath)
            self._number += 1
            folder = self._folder(settings)
            with _warnings_stay_warnings():
                audited = self._audit(estimator, simulator, model, settings, folder)
        self._tell(audited, settings)
        if audited.verdict.outcome is Outcome.PASS:
            return audited
        text = blocked(audited, settings, folder)
        if audited.verdict.outcome is Outcome.FAIL:
            raise CalibrationFailed(text, audited)
        self._undecided(text, audited, settings.inconclusive)

    def _call(self, values: Mapping[str, Any]) -> Layer:
        return Layer("its call with {}=...", values, self._item.path.parent)

    def _folder(self, settings: GateSettings) -> Path:
        if settings.out is None:
            return self._temporary.mktemp("calibration")
        if settings.own_folder:
            return settings.out
        again = f"-{self._number}" if self._number > 1 else ""
        return settings.out / (folder_name(self._item.nodeid) + again)

    def _audit(
        self, estimator: Any, simulator: Any, model: Mapping[str, Any], settings: GateSettings, folder: Path
    ) -> Audit:
        # Never resumed: what an object holds, a retrained network for example, is not part of its identity.
        discard(folder / CHUNKS)
        return audit(
            estimator,
            simulator,
            **model,
            trials=settings.trials,
            policy=settings.policy,
            validators=settings.validators,
            ledger=settings.ledger,
            out=folder,
            progress=False,
            command=f"pytest {self._item.nodeid}",
        )

    def _tell(self, audit: Audit, settings: GateSettings) -> None:
        again = f".{self._number}" if self._number > 1 else ""
        # Not through the fixture record_property, which warns in every run that writes JUnit's newer schema.
        said = properties(audit, settings).items()
        self._item.user_properties += [(f"calibration{again}.{name}", value) for name, value in said]
        outcome = audit.verdict.outcome
        self._notes.append(
            {
                "test": self._item.nodeid,
                "verdict": outcome.value,
                "headline": headline(audit, settings),
                "lines": detectable(audit) if outcome is Outcome.PASS else [],
                "blocks": outcome is Outcome.FAIL
                or (outcome is Outcome.INCONCLUSIVE and settings.inconclusive == "fail"),
            }
        )

    def _undecided(self, text: str, audit: Audit, inconclusive: str) -> NoReturn:
        __tracebackhide__ = True
        if inconclusive == "skip":
            pytest.skip(text.splitlines()[0])
        if inconclusive == "xfail":
            pytest.xfail(text.splitlines()[0])
        raise CalibrationInconclusive(text, audit)


def folder_name(test: str) -> str:
    """Name of the folder for a test's files; two tests never have the same.

    >>> folder_name("tests/test_flow.py::test_flow")
    'tests-test_flow.py.test_flow'
    >>> folder_name("test_flow.py::test_flow[a b]")
    'test_flow.py.test_flow-a-b-b5b0a3'
    """
    name = re.sub(r"[^\w.]+", "-", test.replace("::", "."), flags=re.ASCII).strip("-.")
    if re.fullmatch(r"[\w./:]{1,100}", test, flags=re.ASCII):
        return name
    return f"{name[:80]}-{digest(test)[:6]}"


@contextmanager
def _one_line() -> Iterator[None]:
    """What was meant for people stays one line; where a user's own code raised, the lines of it follow."""
    __tracebackhide__ = True
    try:
        yield
    except GaugeblockError as error:
        line = f"calibration_gate: {' '.join(str(error).split()).removeprefix('calibration_gate: ')}"
        raise CalibrationError("\n".join([line, *_frames(error.__cause__)])) from None


def _frames(error: BaseException | None) -> list[str]:
    """Where a user's code failed; gaugeblock's own frames are of no use to them."""
    if error is None:
        return []
    ours = str(Path(gaugeblock.__file__).parent)
    frames = traceback.extract_tb(error.__traceback__)
    return [
        f"  {frame.filename}:{frame.lineno}: in {frame.name}: {frame.line or ''}".rstrip()
        for frame in frames
        if not frame.filename.startswith(ours)
    ]


@contextmanager
def _warnings_stay_warnings() -> Iterator[None]:
    """As the user filters them, except that none becomes an error: it would be an error of the verdict."""
    with warnings.catch_warnings():
        filters = list(warnings.filters)
        warnings.resetwarnings()
        for action, message, category, module, line in reversed(filters):
            warnings.filterwarnings(
                "default" if action == "error" else action,  # type: ignore[arg-type]
                message=_pattern(message),
                category=category,  # type: ignore[arg-type]
                module=_pattern(module),
                lineno=line,
            )
        yield


def _pattern(compiled: Any) -> str:
    """A filter holds a compiled pattern, plain text (Python's own ones), or nothing."""
    return str(getattr(compiled, "pattern", compiled) or "")
