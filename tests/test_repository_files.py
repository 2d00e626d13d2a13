"""The files themselves: nothing about the machine they were written on, metadata that agree."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def files(tree):
    paths = [ROOT / name for name in tree]
    return [path for path in paths if path.is_file() and not path.is_symlink()]


@pytest.fixture(scope="module")
def project():
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def text(path):
    """Content of a text file; empty for any other."""
    content = path.read_bytes()
    return "" if b"\0" in content[:8192] else content.decode(errors="replace")


def test_nothing_mentions_the_machine_it_was_written_on(files):
    # Put together here, so that this file does not mention them either.
    places = re.compile(r"(?<![\w.}])/(?:wo" + r"rk|ro" + r"ot)\b|\.\./sha" + r"red")
    found = [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()[:100]}"
        for path in files
        for number, line in enumerate(text(path).splitlines(), 1)
        if places.search(line)
    ]
    assert not found, "\n".join(found)


def test_data_that_lie_elsewhere_are_found_by_one_fixture_only(files):
    name = "GAUGEBLOCK_SH" + "ARED"
    readers = [path.relative_to(ROOT) for path in files if path.suffix == ".py" and name in text(path)]
    assert readers == [Path("conftest.py")], "use the fixture shared_file"


def test_every_direct_dependency_is_pinned(project):
    def name(requirement):
        return re.split(r"[<>=!~\[; ]", requirement)[0].lower()

    wanted = {name(r) for r in project["project"]["dependencies"]}
    for extra in project["project"]["optional-dependencies"].values():
        wanted |= {name(r) for r in extra}
    for group in project["dependency-groups"].values():
        wanted |= {name(r) for r in group}
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pinned = {line.split("==")[0].lower() for line in lines if "==" in line and not line.startswith("#")}
    assert wanted - pinned == {"gaugeblock"}


def test_version_and_licence_are_the_same_everywhere(project):
    version, licence = project["project"]["version"], project["project"]["license"]
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"\nversion: {version}\n" in citation
    assert f"\nlicense: {licence}\n" in citation
    released = re.findall(r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert released[:2] in ([version], ["Unreleased"], ["Unreleased", version])
