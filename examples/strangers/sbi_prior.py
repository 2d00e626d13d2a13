"""The prior that sbi_npe.py trained with, for an estimator that was saved without it."""

import torch
from torch.distributions import MultivariateNormal


def prior(options):
    """Independent standard normals, two unless options say otherwise."""
    size = options.get("size", 2)
    return MultivariateNormal(torch.zeros(size), torch.eye(size))
