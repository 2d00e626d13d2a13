"""A stranger's side of the protocol: loads one model and answers requests until it is told to stop.

It runs in a process of its own, in the stranger's environment: it needs Python 3.9 or later and numpy, and
nothing of gaugeblock. Called with one argument, JSON: {"format": ..., "path": ..., "options": {...}}.
"""

import importlib.util
import io
import json
import os
import sys
from pathlib import Path


def exactly(source, size):
    """So many bytes; ends the process where the other side is gone."""
    parts = []
    while size:
        part = source.read(min(size, 1 << 20))
        if not part:
            sys.exit(0)
        parts.append(part)
        size -= len(part)
    return b"".join(parts)


def receive(source, np):
    """Header and arrays of the next request; np is numpy."""
    header = json.loads(exactly(source, int.from_bytes(exactly(source, 4), "big")))
    arrays = {}
    for name in header.get("arrays", []):
        content = exactly(source, int.from_bytes(exactly(source, 8), "big"))
        arrays[name] = np.load(io.BytesIO(content), allow_pickle=False).astype(np.float64)
    return header, arrays


def send(target, header, np=None, **arrays):
    """Write one answer; np is numpy."""
    content = []
    for array in arrays.values():
        buffer = io.BytesIO()
        values = np.asarray(array, dtype="<f8", order="C")
        np.lib.format.write_array(buffer, values, version=(1, 0), allow_pickle=False)
        content.append(buffer.getvalue())
    if arrays:
        header = {**header, "arrays": list(arrays)}
    text = json.dumps(header).encode()
    target.write(len(text).to_bytes(4, "big") + text)
    for part in content:
        target.write(len(part).to_bytes(8, "big"))
        target.write(part)
    target.flush()


def load(setting):
    """The model, by the file in `formats` that knows how."""
    here = Path(__file__).resolve().parent
    # For what they share. The formats' own folder comes in for none: one of them has a library's name.
    sys.path.append(str(here))
    file = here / "formats" / (setting["format"] + ".py")
    spec = importlib.util.spec_from_file_location("stranger_format", file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.load(setting["path"], setting.get("options") or {})


def described(model, np):
    """What the model says of itself and what it can do."""
    said = dict(model.describe()) if callable(getattr(model, "describe", None)) else {}
    names = said.get("parameters")
    versions = {"python": ".".join(map(str, sys.version_info[:3])), "numpy": np.__version__}
    versions.update({str(key): str(value) for key, value in dict(said.get("versions") or {}).items()})
    can = ["sample", "log_prob", "embed"]
    return {
        "answer": "describe",
        "parameters": None if names is None else [str(name) for name in names],
        "can": [name for name in can if callable(getattr(model, name, None))],
        "versions": versions,
        "library": str(said.get("library", "")),
        "autocorrelated": bool(said.get("autocorrelated", False)),
    }


def answer(model, header, arrays, target, np):
    """Answer one request."""
    request = header.get("request")
    if request == "describe":
        send(target, described(model, np))
    elif request == "sample":
        draws = model.sample(arrays["x"], int(header["n"]), int(header["seed"]))
        send(target, {"answer": request}, np, draws=draws)
    elif request == "log_prob":
        density = model.log_prob(arrays["theta"], arrays["x"])
        send(target, {"answer": request}, np, log_prob=density)
    elif request == "embed":
        send(target, {"answer": request}, np, features=model.embed(arrays["x"]))
    else:
        send(target, {"error": f"unknown request {request!r}"})


def line(error):
    """An exception in one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:300]


def main():
    """Take the pipes away from the model's code, load it, answer."""
    # What the model prints goes to stderr; what it reads from stdin is nothing.
    source, target = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    try:
        import numpy as np

        model = load(json.loads(sys.argv[1]))
    except Exception as error:
        send(target, {"error": "cannot be loaded: " + line(error)})
        raise
    while True:
        header, arrays = receive(source, np)
        if header.get("request") == "stop":
            return
        try:
            answer(model, header, arrays, target, np)
        except Exception as error:
            import traceback

            traceback.print_exc()
            send(target, {"error": line(error)})


if __name__ == "__main__":
    main()
