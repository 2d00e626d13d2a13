"""An approximator of BayesFlow 2, saved as .keras by `approximator.save`.

Draws come from `approximator.sample`, densities from `approximator.log_prob`. Which of the names in its
adapter are data, and which parameters, is read off the adapter's concatenations; options say it otherwise.

options: `conditions`, a table of the adapter's data names and their lengths, in the order in which x holds
them (one name may have length 0: all the rest); `variables`, a list of its parameter names; `backend` of
Keras ("jax", "torch" or "tensorflow"; the first that is installed by default); `source`, a script that
registers classes of its own with Keras; `parameters`, names of the single parameters in order.

Imports numpy, keras and bayesflow.
"""

import importlib.util
import os

import numpy as np

# As many draws go through the network at a time.
AT_ONCE = 100_000


def load(path, options):
    """The approximator of the file as a model."""
    backend = options.get("backend") or next(
        (name for name in ("jax", "torch", "tensorflow") if importlib.util.find_spec(name)), "jax"
    )
    # Keras reads it once, when it is imported.
    os.environ["KERAS_BACKEND"] = backend
    import bayesflow  # noqa: F401
    import keras
    from stranger_files import module

    if options.get("source"):
        module(options["source"], "stranger_source")
    approximator = keras.saving.load_model(path)
    if not callable(getattr(approximator, "sample", None)):
        raise ValueError(f"the file holds a {type(approximator).__name__}, not an approximator")
    return Approximator(approximator, options)


class Approximator:
    """Draws and densities of an approximator, in double precision."""

    def __init__(self, approximator, options):
        self.approximator, self.options = approximator, options
        joined = concatenations(approximator.adapter)
        conditions = options.get("conditions") or {
            **joined.get("inference_conditions", {}),
            **joined.get("summary_variables", {}),
        }
        if not conditions:
            raise ValueError("the adapter does not say what its data are called: give options.conditions")
        self.conditions = dict(conditions)
        self.lengths = joined.get("inference_variables", {})
        self.variables = list(options.get("variables") or self.lengths)
        if not self.variables:
            raise ValueError("the adapter does not say what it infers: give options.variables")
        if not callable(getattr(approximator, "log_prob", None)):
            # What a model can do is read off what it has.
            self.log_prob = None

    def describe(self):
        """Library, versions and names."""
        import bayesflow
        import keras

        names = self.options.get("parameters")
        if names is None and all(self.lengths.get(name) for name in self.variables):
            names = [
                f"{name}_{k + 1}" if self.lengths[name] > 1 else name
                for name in self.variables
                for k in range(self.lengths[name])
            ]
        return {
            "library": "bayesflow",
            "versions": {
                "bayesflow": getattr(bayesflow, "__version__", "unknown"),
                "keras": keras.__version__,
                "backend": keras.backend.backend(),
            },
            "parameters": names,
        }

    def sample(self, x, n, seed):
        """Draws ``(batch, n, parameter)``."""
        import keras

        keras.utils.set_random_seed(seed % 2**32)
        parts = []
        for given in self._chunks(x, n):
            drawn = self.approximator.sample(num_samples=n, conditions=self._data(given))
            parts.append(np.concatenate([columns(drawn[name], 2) for name in self.variables], axis=-1))
        return np.concatenate(parts).astype(np.float64)

    def log_prob(self, theta, x):
        """Log density ``(batch, n)``; theta is ``(batch, n, parameter)``."""
        theta = np.asarray(theta)
        batch, n, size = theta.shape
        flat, data = theta.reshape(-1, size), np.repeat(np.asarray(x), n, axis=0)
        parts = []
        for start in range(0, len(flat), AT_ONCE):
            rows = slice(start, start + AT_ONCE)
            parts.append(
                np.asarray(self.approximator.log_prob({**self._theta(flat[rows]), **self._data(data[rows])}))
            )
        return np.concatenate(parts).reshape(batch, n).astype(np.float64)

    def _chunks(self, x, n):
        rows = max(1, AT_ONCE // n)
        return [x[start : start + rows] for start in range(0, len(x), rows)]

    def _data(self, x):
        """x under the adapter's names, as it was simulated."""
        if len(self.conditions) == 1:
            return {name: np.asarray(x) for name in self.conditions}
        sizes = list(self.conditions.values())
        rest = x.shape[1] - sum(sizes)
        return split(x, self.conditions, [size or rest for size in sizes])

    def _theta(self, theta):
        sizes = [self.lengths.get(name) or 1 for name in self.variables]
        return split(theta, self.variables, sizes)


def split(values, names, sizes):
    """Columns under their names."""
    ends = np.cumsum(sizes)
    if ends[-1] != values.shape[1]:
        raise ValueError(f"{', '.join(names)} have {ends[-1]} columns together; there are {values.shape[1]}")
    return {name: values[:, end - size : end] for name, size, end in zip(names, sizes, ends)}


def columns(values, leading):
    """An array with exactly one axis after the leading ones."""
    values = np.asarray(values)
    return values.reshape(*values.shape[:leading], -1)


def concatenations(adapter):
    """What the adapter joins: name of the joint variable -> {name of a part: its length, 0 if unknown}."""
    found = {}
    for transform in getattr(adapter, "transforms", []):
        keys, into = getattr(transform, "keys", None), getattr(transform, "into", None)
        if keys is None or into is None or callable(keys):
            continue
        # Where each part ends, once the adapter has seen data.
        ends = getattr(transform, "indices", None) or [0] * len(keys)
        found[into] = {key: end - start for key, start, end in zip(keys, [0, *ends], ends)}
    return found
