"""A stranger's side of the protocol, `child/serve.py`, as a plain process: what it takes, answers, leaves."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import textwrap
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gaugeblock.stranger import stranger as module
from gaugeblock.stranger.limits import Limits
from gaugeblock.stranger.process import Child, Launch
from gaugeblock.stranger.wire import pack, read_array, read_header

SERVER = Path(module.__file__).resolve().parent / "child" / "serve.py"
Served = tuple[Callable[..., Any], subprocess.CompletedProcess[bytes]]


@pytest.fixture
def served(tmp_path: Path) -> Callable[..., Served]:
    """What reads the answers of a file's server to requests, one after the other, and how it ended."""

    def run(text: str, *requests: tuple[Mapping[str, Any], Mapping[str, Any]], **setting: Any) -> Served:
        path = tmp_path / "theirs.py"
        path.write_text(textwrap.dedent(text))
        said = json.dumps({"format": "python", "path": str(path), **setting})
        sent = b"".join(part for header, arrays in requests for part in pack(header, arrays))
        words = [sys.executable, "-I", "-B", str(SERVER), said]
        done = subprocess.run(words, input=sent, capture_output=True, check=False, timeout=60)
        source = io.BytesIO(done.stdout)

        def read(*shapes: tuple[int | None, ...]) -> Any:
            header = read_header(lambda size, what: source.read(size))
            names = header.get("arrays", [])
            assert len(names) == len(shapes)
            return header, [
                read_array(lambda n, what: source.read(n), *of) for of in zip(names, shapes, strict=True)
            ]

        return read, done

    return run


def test_each_request_is_answered_by_its_function(served: Any) -> None:
    x, theta = np.arange(400_000.0).reshape(2, -1), np.arange(12.0).reshape(2, 3, 2)
    read, done = served(
        """
        import numpy as np
        def sample(x, n, seed):
            return np.stack([np.full((n, 2), seed), np.broadcast_to(x[:, -1:], (2, 2)).repeat(2, 0)[:n]])
        def log_prob(theta, x):
            return (100 * theta.sum(-1) + x[:, :1]).T.copy().T
        def embed(x):
            return x[:, ::100_000].astype("i4")
        def describe():
            return {"library": 7, "parameters": ("a", 1), "versions": {"own": 3}, "autocorrelated": 1}
        """,
        ({"request": "describe"}, {}),
        ({"request": "sample", "n": 4, "seed": 9}, {"x": x}),
        ({"request": "log_prob"}, {"theta": theta, "x": x}),
        ({"request": "embed"}, {"x": x}),
        ({"request": "dance"}, {}),
        ({"request": "stop"}, {}),
        ({"request": "describe"}, {}),
    )
    versions = {"python": sys.version.split()[0], "numpy": np.__version__, "own": "3"}
    described = {"parameters": ["a", "1"], "can": ["sample", "log_prob", "embed"], "library": "7"}
    assert read() == (
        {"answer": "describe", **described, "versions": versions, "autocorrelated": True},
        [],
    )
    header, (draws,) = read((2, 4, 2))
    assert header == {"answer": "sample", "arrays": ["draws"]}
    assert draws.tolist() == [[[9.0] * 2] * 4, [[199_999.0] * 2] * 2 + [[399_999.0] * 2] * 2]
    header, (density,) = read((2, 3))
    assert header == {"answer": "log_prob", "arrays": ["log_prob"]}
    np.testing.assert_array_equal(density, 100 * theta.sum(axis=-1) + x[:, :1])
    header, (features,) = read((2, 2))
    assert header == {"answer": "embed", "arrays": ["features"]}
    np.testing.assert_array_equal(features, x[:, ::100_000])
    assert read() == ({"error": "unknown request 'dance'"}, [])
    # After `stop` nothing more is answered.
    assert (done.stdout[-30:].count(b"dance"), done.returncode, done.stderr) == (1, 0, b"")


def test_an_answer_is_there_before_the_next_request(tmp_path: Path) -> None:
    (tmp_path / "theirs.py").write_text("def sample(x, n, seed): return x[:, None].repeat(n, 1)")
    said = json.dumps({"format": "python", "path": str(tmp_path / "theirs.py")})
    one = Child(Launch([sys.executable, "-I", "-B", str(SERVER), said], {}, "/", sandboxed=False), Limits())
    try:
        for n in (1, 2):
            request = {"request": "sample", "n": n, "seed": 1}
            _, arrays = one.ask(request, {"x": np.eye(2)}, expect={"draws": (2, n, 2)}, seconds=20)
            assert arrays["draws"].tolist() == [[[1.0, 0.0]] * n, [[0.0, 1.0]] * n]
    finally:
        one.close()


def test_a_file_that_says_nothing_is_described_all_the_same(served: Any) -> None:
    read, done = served("def sample(x, n, seed): pass", ({"request": "describe"}, {}))
    header, _ = read()
    assert set(header.pop("versions")) == {"python", "numpy"}
    said = {"answer": "describe", "parameters": None, "can": ["sample"], "library": ""}
    assert header == {**said, "autocorrelated": False}
    # The other side is gone: no reason to complain.
    assert (done.returncode, done.stderr) == (0, b"")


def test_an_error_is_one_line_its_traceback_on_stderr_and_the_next_request_is_answered(served: Any) -> None:
    read, done = served(
        """
        import os, sys
        def sample(x, n, seed):
            print("a word")
            os.write(1, b"another")
            raise ValueError("two\\nlines " + "x" * 400)
        def log_prob(theta, x):
            null = [os.path.realpath(f"/proc/self/fd/{k}") for k in range(10)].count("/dev/null")
            raise OSError(f"{sys.stdin.read()!r} {null}")
        """,
        ({"request": "sample", "n": 1, "seed": 1}, {"x": np.zeros((1, 1))}),
        ({"request": "log_prob"}, {"theta": np.zeros((1, 1, 1)), "x": np.zeros((1, 1))}),
        ({"request": "sample"}, {"x": np.zeros((1, 1))}),
    )
    error = read()[0]["error"]
    assert error.startswith("ValueError: two lines xxx")
    assert len(error) == 300
    # What it reads is nothing, and nothing else of that kind is left open.
    assert read()[0] == {"error": "OSError: '' 1"}
    assert read()[0] == {"error": "KeyError: 'n'"}
    assert done.stderr.count(b"Traceback") == 3
    assert b"two\nlines" in done.stderr
    assert b"another" in done.stderr
    assert b"a word" in done.stderr
    assert done.returncode == 0


@pytest.mark.parametrize(
    ("text", "setting", "says"),
    [
        ("raise RuntimeError('no')", {}, "RuntimeError: no"),
        ("x = 1", {}, "TypeError: no function sample(x, n, seed)"),
        ("def build(options): return options['width']", {"options": None}, "KeyError: 'width'"),
        ("def sample(): pass", {"path": "/nowhere.py"}, "ValueError: there is no file /nowhere.py"),
    ],
)
def test_what_cannot_be_loaded_says_why_and_ends(
    served: Any, text: str, setting: dict[str, Any], says: str
) -> None:
    read, done = served(text, ({"request": "describe"}, {}), **setting)
    assert read()[0] == {"error": f"cannot be loaded: {says}"}
    assert done.returncode == 1
    assert b"Traceback" in done.stderr


def test_a_build_is_given_the_options_and_formats_hide_no_library(served: Any) -> None:
    read, _ = served(
        """
        import sys
        class Model:
            sample = print
            def __init__(self, options): self.options = options
            def describe(self): return {"library": f"{self.options} {any('formats' in p for p in sys.path)}"}
        build = Model
        """,
        ({"request": "describe"}, {}),
        options={"width": 3},
    )
    assert read()[0]["library"] == "{'width': 3} False"
