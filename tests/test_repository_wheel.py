"""What is built is what is in the tree: nothing missing, nothing more, no top-level name but `gaugeblock`."""

import runpy
import shutil
import subprocess
import sys
import tarfile
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

# Looked for, not imported: importing it would replace distutils under everything else that is tested here.
if not any(metadata.distributions(name="setuptools")):
    pytest.skip("setuptools is not installed", allow_module_level=True)

ROOT = Path(__file__).resolve().parent.parent
ROOMS = {
    **{room: room for room in ("validate", "estimators", "simulators", "reports", "stranger")},
    "discover": "discovery",
    "diagnose": "diagnosis",
}
"""Folders at the root, and the names that they are installed under."""


def packaged(tree):
    """Where each file of the tree belongs in a wheel."""
    places = {}
    for name in tree:
        room, _, rest = name.partition("/")
        if name.startswith("src/gaugeblock/") and not (ROOT / name).is_symlink():
            places[name.removeprefix("src/")] = name
        elif room in ROOMS and rest and not name.endswith(".md"):
            places[f"gaugeblock/{ROOMS[room]}/{rest}"] = name
    return places


@pytest.fixture(scope="module")
def clean_tree(tree, tmp_path_factory):
    """A copy without leftovers of earlier builds, as a fresh clone is."""
    folder = tmp_path_factory.mktemp("tree")
    for name in tree:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)
    return folder


def asked(kind, tree, out):
    """Ask setuptools to build, in a process of its own."""
    code = f"from setuptools import build_meta; print(build_meta.build_{kind}({str(out)!r}))"
    return subprocess.run([sys.executable, "-c", code], cwd=tree, capture_output=True, text=True, check=False)


def build(kind, tree, out):
    """What was built."""
    done = asked(kind, tree, out)
    assert done.returncode == 0, done.stdout + done.stderr
    return out / done.stdout.split()[-1]


def content(wheel):
    with zipfile.ZipFile(wheel) as archive:
        return sorted(n for n in archive.namelist() if ".dist-info/" not in n and not n.endswith("/"))


def test_the_wheel_holds_the_tree_and_is_as_large_as_that(tree, clean_tree, tmp_path):
    wheel = build("wheel", clean_tree, tmp_path)
    assert content(wheel) == sorted(packaged(tree))
    with zipfile.ZipFile(wheel) as archive:
        weights = [
            file.compress_size for file in archive.infolist() if file.filename.endswith(".safetensors")
        ]
    # A megabyte a flow, and one of everything else; without the rooms there would be a tenth of one.
    assert len(weights) == len(list(Path(clean_tree, "estimators", "models").glob("*/model.json")))
    assert max(weights) < 1.2e6
    assert 1e6 < wheel.stat().st_size - sum(weights) < 1.6e6


@pytest.mark.parametrize("kind", ["wheel", "sdist", "editable"])
def test_links_that_came_out_as_text_files_stop_the_build(clean_tree, tmp_path, kind):
    """As git checks them out with core.symlinks=false, and on Windows without leave to make them."""
    damaged = tmp_path / "tree"
    shutil.copytree(clean_tree, damaged, symlinks=True, ignore=shutil.ignore_patterns("build", "*.egg-info"))
    links = [path for path in (damaged / "src" / "gaugeblock").iterdir() if path.is_symlink()]
    assert len(links) == len(ROOMS)
    for path in links:
        target = str(path.readlink())
        path.unlink()
        path.write_text(target)
    done = asked(kind, damaged, tmp_path)
    assert done.returncode != 0
    (line,) = done.stderr.splitlines()
    assert "text file where a symbolic link belongs" in line
    assert line.endswith("git config core.symlinks true && git checkout -- src/gaugeblock")
    assert not list(tmp_path.glob("gaugeblock*"))


def test_the_wheel_made_from_the_sdist_holds_the_tree_too(tree, clean_tree, tmp_path):
    with tarfile.open(build("sdist", clean_tree, tmp_path)) as archive:
        archive.extractall(tmp_path, filter="data")
    unpacked = next(path for path in tmp_path.iterdir() if path.is_dir())
    assert content(build("wheel", unpacked, tmp_path)) == sorted(packaged(tree))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["wheel", "sdist"])
def test_what_is_built_works_in_an_empty_environment(clean_tree, tmp_path, kind):
    """The core alone, installed as a newcomer would, audits draws and verifies what it wrote."""
    used = runpy.run_path(str(ROOT / "tests" / "installed.py"))["used"]
    used(build(kind, clean_tree, tmp_path), tmp_path)


def test_an_editable_install_shows_every_room_and_nothing_beside(clean_tree, tmp_path):
    site = tmp_path / "site"
    with zipfile.ZipFile(build("editable", clean_tree, tmp_path)) as archive:
        archive.extractall(site)
    rooms = list(ROOMS.items())
    code = "\n".join(
        [
            "import importlib.util, site, sys",
            f"site.addsitedir({str(site)!r})",
            f"for room, installed in {rooms!r}:",
            "    spec = importlib.util.find_spec('gaugeblock.' + installed)",
            f"    assert spec.origin.startswith({str(clean_tree)!r}), spec",
            "    try: found = importlib.util.find_spec(room)",
            "    except ValueError: found = None",
            f"    assert found is None or not found.origin.startswith({str(clean_tree)!r}), found",
        ]
    )
    done = subprocess.run(
        # No gaugeblock that is installed or on the path may answer in place of this one.
        [sys.executable, "-I", "-S", "-c", code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
