"""What a gate ends in when it does not pass, and the notes that it leaves for the summary."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from _pytest.outcomes import Failed  # what pytest.fail raises; as `pytest.fail.Exception` it is no type

if TYPE_CHECKING:
    from gaugeblock.auditing.result import Audit

Note = dict[str, Any]
INCONCLUSIVE = ("fail", "skip", "xfail")


class _Stopped(Failed):
    __module__ = "builtins"  # so that pytest names it without a path, as it does its own

    def __init__(self, message: str):
        super().__init__(message, pytrace=False)


class CalibrationError(_Stopped):
    """The gate could not be run: what it was given cannot be used. The message is one line."""

    __module__ = "builtins"


class _Judged(_Stopped):
    def __init__(self, message: str, audit: Audit):
        super().__init__(message)
        self.audit = audit


class CalibrationFailed(_Judged):
    """The verdict is FAIL: the estimator is blocked. `audit` holds everything that was found."""

    __module__ = "builtins"


class CalibrationInconclusive(_Judged):
    """The verdict is INCONCLUSIVE: these trials do not settle it, and the message says how many would."""

    __module__ = "builtins"
