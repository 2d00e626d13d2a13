"""A Python file: its functions `sample(x, n, seed)`, `log_prob(theta, x)` ..., or its `build(options)`."""

import importlib.util
import os
import sys


class Functions:
    """The functions of a module, those that are there, as a model."""

    def __init__(self, module):
        for name in ("sample", "log_prob", "embed", "describe"):
            if callable(getattr(module, name, None)):
                setattr(self, name, getattr(module, name))


def load(path, options):
    """The model that `build(options)` of the file makes, or else the file's own functions.

    A folder holds the file as `model.py`, or under the name in options["file"], and may hold others beside.
    """
    if os.path.isdir(path):
        path = os.path.join(path, options.get("file", "model.py"))
    sys.path.insert(0, os.path.dirname(path))
    spec = importlib.util.spec_from_file_location("stranger_model", path)
    module = importlib.util.module_from_spec(spec)
    # Under its name before it runs, as an import would: dataclasses and pickles look there.
    sys.modules["stranger_model"] = module
    spec.loader.exec_module(module)
    model = module.build(options) if callable(getattr(module, "build", None)) else Functions(module)
    if not callable(getattr(model, "sample", None)):
        raise TypeError("no function sample(x, n, seed)")
    return model
