"""Model files and folders that are not what they seem; pickles whose loading runs their author's code."""

import hashlib
import importlib.util
import json
import os
import pickle
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gaugeblock.validate import main_trials, read_trials

DRAWS = "import numpy as np\ndef sample(x, n, seed):\n    return np.zeros((len(x), n, 2)) + {}\n"
LINK = "is a link or no plain file; a stranger's folder may hold neither"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A model folder that would work."""
    made = tmp_path / "model"
    made.mkdir()
    (made / "model.py").write_text(DRAWS.format(50))
    return made


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("link", lambda path: path.symlink_to("/etc/shadow")),
        ("link-to-folder", lambda path: path.symlink_to(Path.home())),
        ("loop", lambda path: path.symlink_to(path)),
        ("broken", lambda path: path.symlink_to("/none")),
        ("pipe", os.mkfifo),
        ("\x1b[2Jclear", os.mkfifo),
    ],
)
def test_a_folder_holds_plain_files_only(
    attack: Callable[..., Any], folder: Path, name: str, make: Callable[[Path], None]
) -> None:
    make(folder / name)
    reason = attack(folder).reason
    assert LINK in reason
    assert reason.rstrip("\n").isprintable()


def test_a_device_is_no_file_of_a_folder(attack: Callable[..., Any], folder: Path) -> None:
    try:
        os.mknod(folder / "zero", 0o20666, os.makedev(1, 5))
    except PermissionError:
        pytest.skip("only root can make a device")
    assert LINK in attack(folder).reason


@pytest.mark.parametrize("words", [(), ("--estimator-format", "python")], ids=["detected", "told"])
def test_neither_pipe_nor_device_is_a_model(
    attack: Callable[..., Any], tmp_path: Path, words: tuple[str, ...]
) -> None:
    os.mkfifo(tmp_path / "pipe.py")
    assert "is no plain file" in attack(tmp_path / "pipe.py", *words).reason
    assert "is no plain file" in attack(Path("/dev/zero"), *words).reason


def test_a_hole_longer_than_the_disk_is_not_copied(attack: Callable[..., Any], folder: Path) -> None:
    with open(folder / "weights.bin", "wb") as file:
        file.truncate(1 << 43)
    assert "GB long, and" in attack(folder).reason


def test_more_files_than_a_model_has_are_not_copied(
    attack: Callable[..., Any], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gaugeblock.stranger.material.MOST_FILES", 20)
    for number in range(30):
        (folder / str(number)).touch()
    assert "holds more than 20 files" in attack(folder).reason


def test_what_was_hashed_is_what_runs(
    attack: Callable[..., Any], folder: Path, place: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The file is another as soon as it was read once: every later child, too, gets what was hashed.
    from gaugeblock.stranger import stranger as module

    file = folder / "model.py"
    before = hashlib.sha256(file.read_bytes()).hexdigest()
    take = module.Material.take

    def swapped(self: Any, source: Path, what: str) -> Path:
        copy = take(self, source, what)
        source.write_text(DRAWS.format(-50))
        return copy

    monkeypatch.setattr(module.Material, "take", swapped)
    assert attack(file).code in (1, 3)
    assert np.all(main_trials(read_trials(place.out / "trials.nc"))["draws"].values == 50)
    said = json.loads((place.out / "verdict.json").read_text())["provenance"]["estimator"]
    assert said["sha256"]["model"] == before


def test_a_model_cannot_change_itself(attack: Callable[..., Any]) -> None:
    done = attack(
        """
        try:
            open(__file__, "a").write("# changed")
        except OSError as error:
            refused = error.strerror
        def sample(x, n, seed):
            raise RuntimeError(refused)
        """
    )
    assert re.search("RuntimeError: (Read-only file system|Permission denied)", done.reason)


class Spell:
    """A pickle that runs what it names when it is loaded."""

    def __init__(self, text: str):
        self.text = text

    def __reduce__(self) -> Any:
        return exec, (self.text,)


CURSES = {
    "reads": ("print(open({canary!r}).read(), file=sys.stderr)", "FileNotFoundError"),
    "writes": ("open({canary!r}, 'w')", "FileNotFoundError"),
    "connects": ("__import__('socket').create_connection(('192.0.2.1', 80), 1)", "OSError"),
    "kills": ("__import__('os').kill({parent}, 9)", "ProcessLookupError"),
    "ends": ("__import__('os')._exit(0)", "ended by itself (exit 0)"),
    "pretends": (
        "import sys, os; os.write(1, b'\\\\0\\\\0\\\\0\\\\x0c{{\"answer\": 1}}'); sys.exit(0)",
        "ended by itself",
    ),
}


@pytest.mark.skipif(importlib.util.find_spec("torch") is None, reason="torch is not installed")
@pytest.mark.parametrize("name", ["reads", "ends"])
def test_a_pickle_does_its_harm_in_the_sandbox(
    attack: Callable[..., Any], tmp_path: Path, place: Any, name: str
) -> None:
    curse, reason = CURSES[name]
    path = tmp_path / "posterior.pkl"
    path.write_bytes(pickle.dumps(Spell(f"import sys; {curse.format(canary=str(place.canary))}")))
    limits = {"memory_gb": 2, "processes": 64}
    assert reason in attack(path, "--estimator-format", "sbi_posterior", limits=limits).reason


@pytest.mark.parametrize("name", CURSES)
def test_a_pickle_beside_a_model_does_its_harm_in_the_sandbox(
    attack: Callable[..., Any], folder: Path, place: Any, name: str
) -> None:
    curse, reason = CURSES[name]
    text = "import sys; " + curse.format(canary=str(place.canary), parent=os.getpid())
    (folder / "weights.pkl").write_bytes(pickle.dumps(Spell(text)))
    (folder / "model.py").write_text(
        "import os, pickle\n"
        "pickle.load(open(os.path.join(os.path.dirname(__file__), 'weights.pkl'), 'rb'))\n"
        "def sample(x, n, seed): return x\n"
    )
    assert reason in attack(folder).reason


def test_pickles_that_nobody_loads_are_listed_and_do_not_explode(
    attack: Callable[..., Any], folder: Path, place: Any
) -> None:
    # What the audit itself looks at: it reads opcodes, and gives up on what is too long.
    (folder / "spell.pkl").write_bytes(pickle.dumps(Spell("1 / 0")))
    (folder / "long.pkl").write_bytes(b"\x80\x04\x8d" + (1 << 62).to_bytes(8, "little"))
    (folder / "deep.pkl").write_bytes(b"\x80\x04" + b"(" * 200_000)
    (folder / "line.pkl").write_bytes(b"\x80\x02c" + b"a" * 300_000)
    (folder / "names\x1b[2J<script>alert(1).pkl").write_bytes(b"\x80\x04\x8c\x05\x1b[2J\xff\x93.")
    with zipfile.ZipFile(folder / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data.pkl", b"\x80\x04" + bytes(30_000_000))
        archive.writestr("../../escaped.pkl", b"\x80\x04N.")
    done = attack(folder, limits={"file_mb": 40})
    assert done.code in (1, 3), done
    assert not (folder.parent / "escaped.pkl").exists()
    for name in ("report.html", "verdict.json", "summary.md", "junit.xml"):
        text = (place.out / name).read_text()
        assert "\x1b" not in text
        assert name == "verdict.json" or "<script>alert" not in text
