"""The leaves of a flowjax distribution, or of another equinox module, and the builder that makes its tree.

Written by `equinox.tree_serialise_leaves`. The builder returns the distribution as before training:
`sample(key, sample_shape, condition)` and `log_prob(theta, condition)` as in flowjax.

options: `builder`; `x64` (false by default), whether JAX computes, and the leaves are, in double precision;
`parameters`, names in the distribution's order.

Imports numpy, jax and equinox, and whatever the builder imports.
"""

import os
import sys

import numpy as np

AT_ONCE = 200_000


def load(path, options):
    """The builder's distribution with the leaves of the file as a model."""
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    import equinox
    import jax

    jax.config.update("jax_enable_x64", bool(options.get("x64", False)))
    from stranger_files import build

    skeleton = build(options, "the distribution as before training")
    return Flow(equinox.tree_deserialise_leaves(path, skeleton), options)


class Flow:
    """Draws and densities of a conditional distribution, in double precision outside."""

    def __init__(self, flow, options):
        import equinox

        self.options = options
        self._sample = equinox.filter_jit(lambda key, n, x: flow.sample(key, (n,), condition=x))
        self._density = equinox.filter_jit(lambda theta, x: flow.log_prob(theta, condition=x))

    def describe(self):
        """Library and versions."""
        versions = {
            name: getattr(sys.modules[name], "__version__", "unknown")
            for name in ("jax", "equinox", "flowjax")
            if name in sys.modules
        }
        library = "flowjax" if "flowjax" in versions else "equinox"
        return {"library": library, "versions": versions, "parameters": self.options.get("parameters")}

    def sample(self, x, n, seed):
        """Draws ``(batch, n, parameter)``."""
        import jax

        parts = []
        for number, part in enumerate(chunks(x, AT_ONCE // n)):
            key = jax.random.fold_in(jax.random.key(seed % 2**32), number)
            parts.append(np.swapaxes(self._sample(key, n, part), 0, 1))
        return np.concatenate(parts).astype(np.float64)

    def log_prob(self, theta, x):
        """Log density ``(batch, n)``; theta is ``(batch, n, parameter)``."""
        theta = np.asarray(theta)
        rows = AT_ONCE // theta.shape[1]
        parts = [
            self._density(some, part[:, None]) for some, part in zip(chunks(theta, rows), chunks(x, rows))
        ]
        return np.concatenate(parts).astype(np.float64)


def chunks(values, rows):
    """So many rows at a time."""
    rows = max(1, rows)
    return [values[start : start + rows] for start in range(0, len(values), rows)]
