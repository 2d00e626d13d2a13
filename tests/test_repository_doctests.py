"""The examples in the docstrings run, and what they print is what they say."""

import doctest
import importlib
from pathlib import Path

import pytest

from gaugeblock.core.errors import MissingExtraError

PACKAGE = Path(__file__).resolve().parent.parent / "src" / "gaugeblock"


def modules_with_examples():
    folders = [PACKAGE, *(folder for folder in sorted(PACKAGE.iterdir()) if folder.is_dir())]
    paths = [p for f in folders for p in (f.glob("*.py") if f == PACKAGE else f.rglob("*.py"))]
    for path in sorted(path for path in paths if ">>> " in path.read_text()):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        yield ".".join(("gaugeblock", *(part for part in parts if part != "__init__")))


@pytest.mark.parametrize("name", sorted(modules_with_examples()))
def test_examples_run(name):
    try:
        module = importlib.import_module(name)
        result = doctest.testmod(module, optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    except (MissingExtraError, ModuleNotFoundError) as error:
        pytest.skip(str(error))
    assert result.attempted > 0
    assert result.failed == 0
