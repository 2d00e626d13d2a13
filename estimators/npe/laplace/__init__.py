"""A flow around a Gaussian approximation of the posterior: `kind = "laplace"`, for counts.

A network that learns a posterior from counts alone has to find narrow posteriors by itself, and at many
counts it does so slowly. Here an emulator of the expected counts, a small network trained without noise,
gives likelihood and derivatives; a fit by scoring gives mode and covariance; and the flow learns only what
the Gaussian misses, in coordinates in which the posterior is of order one at any number of counts.
"""

from gaugeblock.estimators.npe.laplace.network import LaplaceNetwork
from gaugeblock.estimators.npe.laplace.training import train_laplace

__all__ = ["LaplaceNetwork", "train_laplace"]
