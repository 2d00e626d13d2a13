"""What describes the package elsewhere says what pyproject.toml says: codemeta, Zenodo, conda, README.

``python tests/test_repository_metadata.py`` writes codemeta.json and .zenodo.json again.
"""

from __future__ import annotations

import email
import json
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import jinja2
import pytest

ROOT = Path(__file__).resolve().parent.parent
TOML = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = TOML["project"]
DESCRIPTIONS: dict[str, dict[str, Any]] = {
    "codemeta.json": {
        "@context": "https://w3id.org/codemeta/3.0",
        "@type": "SoftwareSourceCode",
        "name": PROJECT["name"],
        "description": PROJECT["description"],
        "version": PROJECT["version"],
        "license": f"https://spdx.org/licenses/{PROJECT['license']}",
        "author": [{"@type": "Organization", "name": one["name"]} for one in PROJECT["authors"]],
        "keywords": PROJECT["keywords"],
        "programmingLanguage": "Python",
        "runtimePlatform": f"Python {PROJECT['requires-python']}",
        "codeRepository": PROJECT["urls"]["Repository"],
        "softwareHelp": PROJECT["urls"]["Documentation"],
        "issueTracker": PROJECT["urls"]["Issues"],
    },
    ".zenodo.json": {
        "title": f"{PROJECT['name']}: {PROJECT['description'].partition(':')[0].lower()}",
        "description": PROJECT["description"],
        "upload_type": "software",
        "access_right": "open",
        "license": PROJECT["license"],
        "version": PROJECT["version"],
        "creators": PROJECT["authors"],
        "keywords": PROJECT["keywords"],
    },
}


@pytest.mark.parametrize("name", DESCRIPTIONS)
def test_descriptions_are_those_of_the_project(name):
    assert json.loads((ROOT / name).read_text(encoding="utf-8")) == DESCRIPTIONS[name]


def test_the_owner_is_named_in_one_table(tree):
    """And in files that are made of it: an address moves by one edit."""
    repository = PROJECT["urls"]["Repository"]
    owner = repository.rpartition("/")[0]
    mentions = {
        name
        for name in tree
        if (ROOT / name).is_file()
        and (ROOT / name).suffix in (".md", ".toml", ".yml", ".yaml", ".json", ".py", ".cff", ".html", ".ini")
        and owner + "/" in (ROOT / name).read_text(encoding="utf-8", errors="replace")
    }
    assert mentions == {"pyproject.toml", "codemeta.json"}
    assert all(url.startswith((repository, "https://")) for url in PROJECT["urls"].values())


def test_the_recipe_builds_what_the_project_says():
    yaml = pytest.importorskip("yaml")
    text = (ROOT / "conda" / "meta.yaml").read_text(encoding="utf-8")
    rendered = jinja2.Environment(undefined=jinja2.StrictUndefined).from_string(text)
    recipe = yaml.safe_load(rendered.render(load_file_data=lambda *_, **__: TOML, environ={}))
    assert recipe["package"] == {"name": PROJECT["name"], "version": PROJECT["version"]}
    assert recipe["requirements"]["run"] == [f"python {PROJECT['requires-python']}", *PROJECT["dependencies"]]
    assert recipe["about"]["home"] == PROJECT["urls"]["Repository"]
    assert recipe["build"]["entry_points"] == ["gaugeblock = gaugeblock.cli:main"]
    command = recipe["test"]["commands"][0].split()
    assert subprocess.run([sys.executable, "-m", *command], check=False, capture_output=True).returncode == 0


def test_a_release_shows_a_readme_whose_links_lead_somewhere(tree, tmp_path):
    """As an index gets it: no relative link is left, and every file that is linked is in the tree."""
    folder = tmp_path / "tree"
    (folder / "src" / "gaugeblock").mkdir(parents=True)
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    code = f"from setuptools.build_meta import *; prepare_metadata_for_build_wheel({str(tmp_path)!r})"
    asked = [sys.executable, "-c", code]
    done = subprocess.run(asked, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (file,) = tmp_path.glob("*.dist-info/METADATA")
    metadata = email.message_from_string(file.read_text(encoding="utf-8"))
    shown = metadata.get_payload()
    targets = re.findall(r"\]\(([^)\s]+)\)", str(shown))
    repository = PROJECT["urls"]["Repository"]
    assert len(targets) > 25
    assert all(target.startswith("https://") for target in targets)
    for target in targets:
        if target.startswith(repository):
            name = re.sub(rf"^{re.escape(repository)}/(raw|blob)/main/|#.*$", "", target).rstrip("/")
            assert name in tree or any(each.startswith(f"{name}/") for each in tree), target
    assert sorted(metadata.get_all("Project-URL") or []) == sorted(
        f"{name}, {url}" for name, url in PROJECT["urls"].items()
    )


def test_docs_that_install_a_release_name_the_clone_too():
    """There is no release yet, and whoever follows a page must get this package and no other."""
    for page in [*sorted((ROOT / "docs").rglob("*.md")), ROOT / "README.md"]:
        text = page.read_text(encoding="utf-8")
        if re.search(r"pip install '?gaugeblock", text):
            assert re.search(r"pip install '?\.|installing\)|in a clone", text), page.name


if __name__ == "__main__":
    for path, content in DESCRIPTIONS.items():
        (ROOT / path).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
