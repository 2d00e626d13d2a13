"""The wall behind the mounts, and what is left where there is none."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from gaugeblock.stranger import sandbox as module
from gaugeblock.stranger.limits import Limits
from gaugeblock.stranger.sandbox import LANDLOCK, Sandbox, working_sandbox
from gaugeblock.stranger.system_calls import filtered

# What a child without a wall answers, in a folder of the machine's that somebody let in by mistake.
TRY = """
cd /outside
cat secret
echo more >> secret
echo new > new
mkdir folder
rm gone
mv /tmp/mine theirs
ls
./run
"""


@pytest.fixture(scope="session")
def walled(sandbox: Any) -> Sandbox:
    """A sandbox with the second wall; its tests skip where the kernel has none."""
    python = shutil.which("python3", path=module.STANDARD_PATH)
    # create_ruleset, asked for its version.
    ask = "import ctypes, sys; sys.exit(ctypes.CDLL(None).syscall(444, 0, 0, 1) < 2)"
    if python is None or subprocess.run([python, "-c", ask], check=False, capture_output=True).returncode:
        pytest.skip("no Landlock in this kernel, or no Python in /usr")
    assert sandbox.python == python
    return sandbox  # type: ignore[no-any-return]


def ran(
    sandbox: Sandbox, script: str, outside: Path | None = None, show: Mapping[str, Path] | None = None
) -> subprocess.CompletedProcess[str]:
    """A shell in the sandbox, with a folder of the machine's mounted where it can write to it."""
    words = sandbox.words(["/bin/sh", "-c", script], limits=Limits(), environment={}, show=show or {})
    if outside is not None:
        place = words.index("--chdir")
        words[place:place] = ["--bind", str(outside), "/outside"]
    with filtered(words) as (command, handles):
        return subprocess.run(
            command, capture_output=True, text=True, check=False, pass_fds=handles, timeout=60, env={}
        )


@pytest.mark.parametrize("wall", [True, False])
def test_what_the_mounts_let_through_is_refused(walled: Sandbox, tmp_path: Path, wall: bool) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    outside.chmod(0o777)
    for name, text in {"secret": "theta\n", "gone": "", "run": "#!/bin/sh\necho ran\n"}.items():
        (outside / name).write_text(text)
        (outside / name).chmod(0o777)
    sandbox = walled if wall else dataclasses.replace(walled, python=None)
    done = ran(sandbox, "echo mine > /tmp/mine" + TRY, outside)
    found = {path.name for path in outside.iterdir()}
    if wall:
        assert done.stdout == ""
        assert done.stderr.lower().count("permission denied") == 8, done.stderr
        assert found == {"secret", "gone", "run"}
        assert (outside / "secret").read_text() == "theta\n"
    else:  # so it is the wall that held
        assert done.stdout.split() == ["theta", "folder", "new", "run", "secret", "theirs", "ran"]
        assert found == {"secret", "new", "folder", "theirs", "run"}
        assert (outside / "secret").read_text() == "theta\nmore\n"


def test_what_the_sandbox_gives_is_left(walled: Sandbox) -> None:
    script = f"""
    set -e
    {walled.python} -c 'import pty; pty.openpty()'
    mkdir /tmp/a /tmp/b
    echo '#!/bin/sh' > /tmp/a/run
    echo 'echo ran >&2' >> /tmp/a/run
    chmod +x /tmp/a/run
    ln /tmp/a/run /tmp/b/run
    /tmp/b/run 2> /dev/shm/said
    cat /dev/shm/said
    echo lost > /dev/null
    head -c 4 /dev/urandom | wc -c
    grep Seccomp: /proc/self/status
    ls /usr | grep -x bin
    sleep 60 & kill $!
    """
    done = ran(walled, script)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["ran", "4", "Seccomp:", "2", "bin"]


def test_signals_end_a_program_as_they_would_without(walled: Sandbox) -> None:
    for number in (signal.SIGPIPE, signal.SIGXFSZ):
        assert ran(walled, f"kill -{number.value} $$; echo alive").stdout == ""


@pytest.mark.parametrize("version", range(1, 8))
def test_older_kernels_know_fewer_rights(walled: Sandbox, tmp_path: Path, version: int) -> None:
    """This kernel's wall with what an older one would know: from the third on, no file is cut off either."""
    secret = tmp_path / "secret"
    secret.write_text("theta")
    program = f"""
import importlib.util, json, os, sys
spec = importlib.util.spec_from_file_location("landlock", {str(LANDLOCK)!r})
landlock = importlib.util.module_from_spec(spec)
spec.loader.exec_module(landlock)
ask = landlock.called
# As `setpriv` does in the sandbox.
landlock.ctypes.CDLL(None).prctl(38, 1, 0, 0, 0)
landlock.called = lambda *words: {version} if words == (444, 0, 0, 1) else ask(*words)
landlock.restrict({{"read": [{str(tmp_path)!r}]}})
assert open({str(secret)!r}).read() == "theta"
for act in (lambda: open({str(secret)!r}, "a"), lambda: os.truncate({str(secret)!r}, 0),
            lambda: os.kill({{parent}}, 0)):
    try:
        act()
    except PermissionError:
        print("refused")
    else:
        print("done")
"""
    done = subprocess.run(
        [sys.executable, "-c", program.replace("{parent}", str(os.getpid()))],
        capture_output=True,
        text=True,
        check=False,
    )
    if version == 1:
        assert "Landlock knows no files that move between folders" in done.stderr
        return
    refused = ["refused", "refused" if version >= 3 else "done", "refused" if version >= 6 else "done"]
    assert done.stdout.split() == refused, done.stderr


def test_a_program_runs_behind_the_wall_or_not_at_all(walled: Sandbox, tmp_path: Path) -> None:
    def launched(rights: str, *program: str) -> subprocess.CompletedProcess[str]:
        words = ["setpriv", "--no-new-privs", str(walled.python), "-I", "-S", str(LANDLOCK), rights, *program]
        return subprocess.run(words, capture_output=True, text=True, check=False)

    done = launched(json.dumps({"read": [str(tmp_path / "gone")]}), "/bin/echo", "alive")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("landlock: ")
    done = launched(json.dumps({"run": ["/usr"]}), "/usr/bin/nothing")
    assert (done.returncode, done.stderr) == (127, "/usr/bin/nothing: No such file or directory\n")


@pytest.mark.parametrize("python", [None, "/bin/false"])
def test_without_landlock_the_mounts_hold_alone_and_the_record_says_so(
    sandbox: Sandbox, python: str | None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    which = shutil.which
    monkeypatch.setattr(
        module.shutil, "which", lambda name, **words: python if name == "python3" else which(name, **words)
    )
    found = working_sandbox()
    assert found.python is None
    assert found.describe()["landlock"] == "not in force here"
    assert ran(found, "echo alive").stdout == "alive\n"
    # What everybody may write to is read-only all the same, and so is what was made for the sandbox.
    model = tmp_path / "model"
    model.mkdir()
    model.chmod(0o777)
    places = ("/srv/model", "", "/dev", "/etc", "/usr")
    done = ran(found, "".join(f"mkdir {place}/mine\n" for place in places), show={"/srv/model": model})
    assert done.stderr.count("Read-only file system") == len(places), done.stderr
    assert not list(model.iterdir())


def test_the_record_says_that_it_is_in_force(walled: Sandbox) -> None:
    assert walled.describe()["landlock"] == "in force"


def test_the_wall_leaves_no_file_open(walled: Sandbox, tmp_path: Path) -> None:
    program = f"""
import importlib.util, os
spec = importlib.util.spec_from_file_location("landlock", {str(LANDLOCK)!r})
landlock = importlib.util.module_from_spec(spec)
spec.loader.exec_module(landlock)
landlock.ctypes.CDLL(None).prctl(38, 1, 0, 0, 0)
before = sorted(os.listdir("/proc/self/fd"))
landlock.restrict({{"read": [{str(tmp_path)!r}, "/proc"]}})
print(before == sorted(os.listdir("/proc/self/fd")), len(before) > 2)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.stdout.split() == ["True", "True"], done.stderr
