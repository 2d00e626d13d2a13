"""What several formats need: the function that builds a model, and one clear line for a pickle that fails.

Imports nothing but the standard library.
"""

import importlib.util
import os
import re
import sys


def module(path, name):
    """Run a Python file as a module of this name; its own folder is searched for what it imports."""
    if not os.path.isfile(path):
        raise ValueError(f"there is no file {path}")
    sys.path.insert(0, os.path.dirname(os.path.abspath(path)))
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None:
        raise ValueError(f"{path} is no Python file")
    made = importlib.util.module_from_spec(spec)
    # Under its name before it runs, as an import would: dataclasses and pickles look there.
    sys.modules[name] = made
    spec.loader.exec_module(made)
    return made


def build(options, what):
    """What the reviewer's builder makes: options["builder"] is "FILE.py:function", called with the options.

    `what` says what it should make, for the error where there is none.
    """
    given = options.get("builder")
    if not given:
        raise ValueError(f"a builder is needed that makes {what}: FILE.py:function")
    path, _, name = given.rpartition(":")
    function = getattr(module(path, "stranger_builder"), name, None) if path else None
    if not callable(function):
        raise ValueError(f"builder {given!r} is not FILE.py:function with a function of that file")
    return function(options)


def lend(source):
    """Let pickles find the classes of a script that was the main program when they were written.

    The script runs under another name, so that what stands below `if __name__ == "__main__"` does not.
    """
    main = sys.modules["__main__"]
    # Under its own name too, for classes of a module that is not installed here.
    own = module(source, os.path.splitext(os.path.basename(source))[0])
    for name, value in vars(own).items():
        if not name.startswith("_") and not hasattr(main, name):
            setattr(main, name, value)


def explained(error):
    """An error of unpickling as one line that says what is missing and how to give it."""
    own = re.search(r"attribute '(\w+)'.*__main__", str(error))
    if own:
        return ValueError(
            f"the pickle needs {own[1]} of the script that wrote it; give that script as options.source"
        )
    if isinstance(error, ModuleNotFoundError):
        return ValueError(
            f"the pickle needs the module {error.name}, which this Python lacks: name the interpreter of the "
            "environment it was made in, or the file that holds it as options.source"
        )
    if isinstance(error, AttributeError):
        return ValueError(f"the pickle was written with other versions than are installed here: {error}")
    return error
