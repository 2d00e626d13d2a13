"""What mkdocs calls: the repository's address, pages that are generated, links that lead out of the docs."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path
from typing import Any

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(Path(__file__).parent))

from notebook import as_page  # noqa: E402
from reference import command_line, configuration, python  # noqa: E402

OUTWARD = re.compile(r"\]\((?:\.\./)+([^)#\s]+)(#[^)\s]*)?\)")


def on_config(config: Any) -> Any:
    """The addresses, of which pyproject.toml is the only place."""
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]
    config.repo_url, config.repo_name = urls["Repository"], urls["Repository"].split("//")[1]
    config.site_url = urls["Documentation"]
    return config


def on_files(files: Any, config: Any) -> Any:
    """Generated pages beside those that are written."""
    made = {
        "first-verdict.md": as_page(ROOT / "examples" / "first_verdict.ipynb"),
        "reference/python.md": python(),
        "reference/command-line.md": command_line(),
        "reference/configuration.md": configuration(),
    }
    for name, content in made.items():
        files.append(File.generated(config, name, content=content))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Links to files of the repository that are no pages lead to the repository."""

    def outward(match: re.Match[str]) -> str:
        target = ROOT / match[1]
        if files.get_file_from_path(match[1]) is not None and not target.exists():
            return match[0]  # a page of the site, one folder up
        if not target.exists():
            raise PluginError(f"{page.file.src_path}: no file {match[1]}")
        return f"]({config.repo_url}/{'tree' if target.is_dir() else 'blob'}/main/{match[1]}{match[2] or ''})"

    return OUTWARD.sub(outward, markdown)
