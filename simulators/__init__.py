"""What the data should look like: priors, simulators, likelihoods, effects.

`prior.py` and `marginals.py` hold the one prior object; `protocol.py` says what a simulator is;
`effects.py` how reality may differ from one; `registry.py` makes them by name. The exact toys have
a file each; `xray/` is the reference case.
"""

from gaugeblock.simulators.blocks import Dirichlet, DirichletWithoutLast, MultivariateNormal
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.marginals import (
    Beta,
    Discrete,
    Gamma,
    LogNormal,
    LogUniform,
    Marginal,
    Normal,
    TruncatedNormal,
    Uniform,
    truncated,
)
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.prior_from import as_prior
from gaugeblock.simulators.protocol import Simulator, poisson_log_likelihood
from gaugeblock.simulators.registry import SIMULATORS, build_simulator

__all__ = [
    "SIMULATORS",
    "Beta",
    "Dirichlet",
    "DirichletWithoutLast",
    "Discrete",
    "Effect",
    "Gamma",
    "LogNormal",
    "LogUniform",
    "Marginal",
    "MultivariateNormal",
    "Normal",
    "Prior",
    "Simulator",
    "TruncatedNormal",
    "Uniform",
    "as_prior",
    "build_simulator",
    "poisson_log_likelihood",
    "truncated",
]
