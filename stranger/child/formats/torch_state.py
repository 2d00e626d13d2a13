"""A state dict of PyTorch and the builder that makes the module it belongs to: zuko, lampe, or one's own.

The builder returns the module as before training. It may define `sample(x, n)` -> ``(batch, n, parameter)``
and `log_prob(theta, x)` -> ``(batch, n)`` itself; otherwise calling the module with x, or its `flow` (as in
lampe's NPE), must give a distribution over parameters (a flow of zuko, a distribution of torch).

The file is read with `weights_only=True`, or as safetensors by its suffix: neither runs code of its own.
options: `builder`; `dtype` ("float32" by default); `parameters`, names in the module's order.

Imports numpy and torch, and whatever the builder imports.
"""

import sys

import numpy as np

AT_ONCE = 200_000


def load(path, options):
    """The builder's module with the weights of the file as a model."""
    import torch
    from stranger_files import build

    module = build(options, "the module as before training")
    if not isinstance(module, torch.nn.Module):
        raise ValueError(f"the builder made a {type(module).__name__}, not a torch module")
    dtype = getattr(torch, options.get("dtype", "float32"))
    module.load_state_dict(weights(path))
    return Flow(module.to(dtype).eval(), dtype, options)


def weights(path):
    """The state dict of a file."""
    import torch

    if path.endswith(".safetensors"):
        from safetensors.torch import load_file

        return load_file(path)
    found = torch.load(path, map_location="cpu", weights_only=True)
    if not isinstance(found, dict):
        raise ValueError(f"the file holds a {type(found).__name__}, not a state dict")
    return found


class Flow:
    """Draws and densities of a conditional distribution, in double precision outside."""

    def __init__(self, module, dtype, options):
        self.module, self.dtype, self.options = module, dtype, options

    def describe(self):
        """Library and versions."""
        import torch

        own = type(self.module).__module__.partition(".")[0]
        versions = {"torch": torch.__version__}
        for name in ("zuko", "lampe", "nflows", "normflows"):
            if name in sys.modules:
                versions[name] = getattr(sys.modules[name], "__version__", "unknown")
        return {"library": own, "versions": versions, "parameters": self.options.get("parameters")}

    def sample(self, x, n, seed):
        """Draws ``(batch, n, parameter)``."""
        import torch

        torch.manual_seed(seed)
        draws = []
        with torch.no_grad():
            for part in torch.split(self._tensor(x), max(1, AT_ONCE // n)):
                if hasattr(self.module, "sample"):
                    draws.append(self.module.sample(part, n))
                else:
                    draws.append(self._given(part).sample((n,)).transpose(0, 1))
        return double(torch.cat(draws))

    def log_prob(self, theta, x):
        """Log density ``(batch, n)``; theta is ``(batch, n, parameter)``."""
        import torch

        points, data = self._tensor(theta), self._tensor(x)
        rows = max(1, AT_ONCE // points.shape[1])
        parts = []
        with torch.no_grad():
            for some, their in zip(torch.split(points, rows), torch.split(data, rows)):
                if hasattr(self.module, "log_prob"):
                    parts.append(self.module.log_prob(some, their))
                else:
                    parts.append(self._given(their).log_prob(some.transpose(0, 1)).T)
        return double(torch.cat(parts))

    def _given(self, x):
        """The distribution over parameters given data."""
        found = getattr(self.module, "flow", self.module)(x)
        if not hasattr(found, "log_prob"):
            raise TypeError(
                f"the builder's module gives a {type(found).__name__} for x, not a distribution; it must "
                "define sample(x, n) and log_prob(theta, x) itself"
            )
        return found

    def _tensor(self, values):
        import torch

        return torch.as_tensor(np.asarray(values), dtype=self.dtype)


def double(values):
    """A tensor as numpy, in double precision."""
    return values.detach().cpu().numpy().astype(np.float64)
