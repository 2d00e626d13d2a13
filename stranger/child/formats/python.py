"""A Python file: its functions `sample(x, n, seed)`, `log_prob(theta, x)` ..., or its `build(options)`."""

import os


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
    from stranger_files import module

    if os.path.isdir(path):
        path = os.path.join(path, options.get("file", "model.py"))
    own = module(path, "stranger_model")
    model = own.build(options) if callable(getattr(own, "build", None)) else Functions(own)
    if not callable(getattr(model, "sample", None)):
        raise TypeError("no function sample(x, n, seed)")
    return model
