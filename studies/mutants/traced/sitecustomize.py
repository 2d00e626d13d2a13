"""First on the path of processes that begin while tests are traced: what they reach is reached by the test.

A script for any process: it needs nothing but coverage, and does nothing where no test runs.
"""

from __future__ import annotations

import atexit
import json
import os
from typing import Any

TRACES = "MUTANTS_TRACES"
"""The variable that says where traces go, and what is traced, as JSON."""

EVERY = "*"
"""The context of what larger fixtures do: every test of a file may rest on it."""


def begun(context: str = "") -> Any:
    """Coverage of the rooms, started."""
    from coverage import Coverage

    folder, rooms = json.loads(os.environ[TRACES])
    tracer = Coverage(
        data_file=os.path.join(folder, "trace"),
        data_suffix=True,
        include=[os.path.join(room, "*") for room in rooms],
        context=context,
        config_file=False,
        messages=False,
    )
    tracer.set_option("run:disable_warnings", ["no-data-collected", "trace-changed", "no-sysmon"])
    tracer.start()
    return tracer


def ended(tracer: Any) -> None:
    """Write what was reached."""
    tracer.stop()
    tracer.save()


if TRACES in os.environ and "PYTEST_CURRENT_TEST" in os.environ:
    atexit.register(ended, begun(os.environ["PYTEST_CURRENT_TEST"].rpartition(" ")[0]))
