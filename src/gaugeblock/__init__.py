"""gaugeblock: statistical validation of simulator-based estimators.

    import gaugeblock as gb

    result = gb.audit(estimator, simulator)             # PASS, FAIL or INCONCLUSIVE, with stated error rates
    result = gb.audit_draws(theta_true, draws, x=x)     # the same of draws in hand
    answer = gb.check(simulator, x)                     # could the simulator have made this observation?
    found = gb.discover(simulator, x)                   # what the simulator lacks, if data disagree

Nothing heavy is imported until it is asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

_PLACES = {
    "auditing.audit": ("audit",),
    "auditing.audit_draws": ("audit_draws",),
    "auditing.checked": ("Check",),
    "auditing.checking": ("check",),
    "auditing.discovering": ("discover",),
    "auditing.estimator_from": ("load",),
    "auditing.judging": ("judge",),
    "auditing.model_choice": ("audit_models",),
    "auditing.planned": ("plan",),
    "auditing.result": ("Audit",),
    "auditing.trials_from": (
        *("to_arviz", "trials_from_arviz", "trials_from_bayesflow", "trials_from_numpyro"),
        *("trials_from_samplers", "trials_from_sbi"),
    ),
    "core.errors": ("InputError",),
    "simulators": (
        *("Beta", "Dirichlet", "Discrete", "Effect", "Gamma", "LogNormal", "LogUniform"),
        *("MultivariateNormal", "Normal", "Prior", "TruncatedNormal", "Uniform", "as_prior", "truncated"),
    ),
    "simulators.library": ("LibraryEffect",),
    "validate.policy": ("Policy",),
    "validate.trials": ("make_trials", "read_trials", "write_trials"),
}
_NAMES = {name: module for module, names in _PLACES.items() for name in names}

if TYPE_CHECKING:
    from gaugeblock.auditing.audit import audit as audit
    from gaugeblock.auditing.audit_draws import audit_draws as audit_draws
    from gaugeblock.auditing.checked import Check as Check
    from gaugeblock.auditing.checking import check as check
    from gaugeblock.auditing.discovering import discover as discover
    from gaugeblock.auditing.estimator_from import load as load
    from gaugeblock.auditing.judging import judge as judge
    from gaugeblock.auditing.model_choice import audit_models as audit_models
    from gaugeblock.auditing.planned import plan as plan
    from gaugeblock.auditing.result import Audit as Audit
    from gaugeblock.auditing.trials_from import to_arviz as to_arviz
    from gaugeblock.auditing.trials_from import trials_from_arviz as trials_from_arviz
    from gaugeblock.auditing.trials_from import trials_from_bayesflow as trials_from_bayesflow
    from gaugeblock.auditing.trials_from import trials_from_numpyro as trials_from_numpyro
    from gaugeblock.auditing.trials_from import trials_from_samplers as trials_from_samplers
    from gaugeblock.auditing.trials_from import trials_from_sbi as trials_from_sbi
    from gaugeblock.core.errors import InputError as InputError
    from gaugeblock.simulators import Beta as Beta
    from gaugeblock.simulators import Dirichlet as Dirichlet
    from gaugeblock.simulators import Discrete as Discrete
    from gaugeblock.simulators import Effect as Effect
    from gaugeblock.simulators import Gamma as Gamma
    from gaugeblock.simulators import LogNormal as LogNormal
    from gaugeblock.simulators import LogUniform as LogUniform
    from gaugeblock.simulators import MultivariateNormal as MultivariateNormal
    from gaugeblock.simulators import Normal as Normal
    from gaugeblock.simulators import Prior as Prior
    from gaugeblock.simulators import TruncatedNormal as TruncatedNormal
    from gaugeblock.simulators import Uniform as Uniform
    from gaugeblock.simulators import as_prior as as_prior
    from gaugeblock.simulators import truncated as truncated
    from gaugeblock.simulators.library import LibraryEffect as LibraryEffect
    from gaugeblock.validate.policy import Policy as Policy
    from gaugeblock.validate.trials import make_trials as make_trials
    from gaugeblock.validate.trials import read_trials as read_trials
    from gaugeblock.validate.trials import write_trials as write_trials

__all__ = [*sorted(_NAMES), "__version__"]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        found: Any = version("gaugeblock")
    elif name in _NAMES:
        found = getattr(import_module(f"{__name__}.{_NAMES[name]}"), name)
    else:
        raise AttributeError(
            f"module {__name__!r} has no attribute {name!r}; there are {', '.join(__dir__())}"
        )
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(_NAMES)
