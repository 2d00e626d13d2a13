"""Stops a build whose rooms would be left out, and makes the README's links absolute.

Everything else is in `pyproject.toml`.
"""

import re
import sys
import tomllib
from pathlib import Path

from setuptools import setup

ROOT = Path(__file__).resolve().parent

# Where git may make no symbolic links it writes text files that hold their targets.
for entry in sorted((ROOT / "src" / "gaugeblock").iterdir()):
    if entry.is_file() and entry.stat().st_size < 100 and entry.read_bytes().startswith(b"../"):
        sys.exit(
            f"src/gaugeblock/{entry.name} is a text file where a symbolic link belongs: let git make links"
            " (Windows: Developer Mode), then git config core.symlinks true && git checkout -- src/gaugeblock"
        )

# A package index shows the README without the files that it links to.
repository = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"][
    "Repository"
]
readme = (ROOT / "README.md").read_text(encoding="utf-8")
readme = re.sub(r"(!\[[^\]]*\])\((?!https?:|#)", rf"\1({repository}/raw/main/", readme)
readme = re.sub(r"(?<=\])\((?!https?:|#)", f"({repository}/blob/main/", readme)

setup(long_description=readme, long_description_content_type="text/markdown")
