"""gaugeblock: statistical validation of simulator-based estimators.

The rooms of the house, lowest first: `gaugeblock.simulators`, then `gaugeblock.estimators` and
`gaugeblock.validate`, `gaugeblock.reports`, and `gaugeblock.auditing.audit`, where they meet.

Trials of one's own, for ``gaugeblock audit --trials``: `make_trials`, `write_trials`, `read_trials`, and
`trials_from_sbi`, `trials_from_bayesflow`, `trials_from_numpyro`, `trials_from_arviz`.
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gaugeblock.auditing.trials_from import (
        trials_from_arviz,
        trials_from_bayesflow,
        trials_from_numpyro,
        trials_from_sbi,
    )
    from gaugeblock.validate import make_trials, read_trials, write_trials

__version__ = version("gaugeblock")

__all__ = [
    "__version__",
    "make_trials",
    "read_trials",
    "trials_from_arviz",
    "trials_from_bayesflow",
    "trials_from_numpyro",
    "trials_from_sbi",
    "write_trials",
]


def __getattr__(name: str) -> Any:
    # Imported when asked for: `gaugeblock --help` must not wait for xarray.
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    room = "auditing.trials_from" if name.startswith("trials_from") else "validate"
    return getattr(import_module(f"{__name__}.{room}"), name)
