"""What is built is what is in the tree: nothing missing, nothing more, no top-level name but `gaugeblock`."""

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
ROOMS = ("validate", "estimators", "simulators", "reports", "discover", "stranger")


def packaged(tree):
    """Where each file of the tree belongs in a wheel."""
    places = {}
    for name in tree:
        room, _, rest = name.partition("/")
        if name.startswith("src/gaugeblock/") and not (ROOT / name).is_symlink():
            places[name.removeprefix("src/")] = name
        elif room in ROOMS and rest and not name.endswith(".md"):
            places[f"gaugeblock/{name}"] = name
    return places


@pytest.fixture(scope="module")
def clean_tree(tree, tmp_path_factory):
    """A copy without leftovers of earlier builds, as a fresh clone is."""
    folder = tmp_path_factory.mktemp("tree")
    for name in tree:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)
    return folder


def build(kind, tree, out):
    """Let setuptools build, in a process of its own, and return the file."""
    code = f"from setuptools import build_meta; print(build_meta.build_{kind}({str(out)!r}))"
    done = subprocess.run([sys.executable, "-c", code], cwd=tree, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return out / done.stdout.split()[-1]


def content(wheel):
    with zipfile.ZipFile(wheel) as archive:
        return sorted(n for n in archive.namelist() if ".dist-info/" not in n and not n.endswith("/"))


def test_the_wheel_holds_the_tree(tree, clean_tree, tmp_path):
    assert content(build("wheel", clean_tree, tmp_path)) == sorted(packaged(tree))


def test_the_wheel_made_from_the_sdist_holds_the_tree_too(tree, clean_tree, tmp_path):
    with tarfile.open(build("sdist", clean_tree, tmp_path)) as archive:
        archive.extractall(tmp_path, filter="data")
    unpacked = next(path for path in tmp_path.iterdir() if path.is_dir())
    assert content(build("wheel", unpacked, tmp_path)) == sorted(packaged(tree))


def test_an_editable_install_shows_every_room_and_nothing_beside(clean_tree, tmp_path):
    site = tmp_path / "site"
    with zipfile.ZipFile(build("editable", clean_tree, tmp_path)) as archive:
        archive.extractall(site)
    rooms = [room for room in ROOMS if (ROOT / room / "__init__.py").exists()]
    code = "\n".join(
        [
            "import importlib.util, site, sys",
            f"site.addsitedir({str(site)!r})",
            f"for room in {rooms!r}:",
            "    spec = importlib.util.find_spec('gaugeblock.' + room)",
            f"    assert spec.origin.startswith({str(clean_tree)!r}), spec",
            "    try: found = importlib.util.find_spec(room)",
            "    except ValueError: found = None",
            f"    assert found is None or not found.origin.startswith({str(clean_tree)!r}), found",
        ]
    )
    done = subprocess.run(
        # -S: no installed gaugeblock may answer in place of this one.
        [sys.executable, "-S", "-c", code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
