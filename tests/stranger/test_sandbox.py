"""What is to be seen, and what can be done, inside."""

import dataclasses
import json
import os
import re
import socket
import subprocess
import sys
import uuid
import venv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.stranger import sandbox as module
from gaugeblock.stranger.limits import Limits
from gaugeblock.stranger.program import find_interpreter
from gaugeblock.stranger.sandbox import working_sandbox
from gaugeblock.stranger.stranger import Stranger
from gaugeblock.stranger.system_calls import filtered

X = np.zeros((2, 3))

LOOK = """
import json
def look():
    {what}
def sample(x, n, seed):
    raise ValueError(json.dumps(look()))
"""


@pytest.fixture
def seen(stranger: Any) -> Any:
    """What code in the sandbox returns, as far as it fits in a line."""

    def look(what: str, **options: Any) -> Any:
        with pytest.raises(InputError, match="could not answer sample: ValueError: ") as caught:
            stranger(LOOK.format(what=what), **options).sample(X, 2, np.random.default_rng(1))
        return json.loads(str(caught.value).partition("ValueError: ")[2])

    return look


def test_it_sees_no_variable_of_ours(seen: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OUR_SECRET", "theta")
    assert set(seen("return sorted(os.environ)[:9]")) <= {
        *("CUDA_VISIBLE_DEVICES", "HOME", "JAX_PLATFORMS", "LANG", "LC_CTYPE", "LOGNAME", "MKL_NUM_THREADS"),
        *("NUMEXPR_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "PATH", "PWD", "TMPDIR"),
    }
    around = "return [p for p in os.listdir('/proc') if p.isdigit() and int(p) != os.getpid()]"
    assert len(seen(around)) == 1
    first = seen(
        "try: return open('/proc/1/environ').read()\n    except OSError as error: return type(error).__name__"
    )
    assert first in ("", "PermissionError")


def test_it_sees_a_made_up_user_and_no_home(seen: Any, tmp_path: Path) -> None:
    own = "import grp, pwd\n    return [pwd.getpwuid(os.getuid()).pw_name, grp.getgrgid(os.getgid()).gr_name]"
    assert seen(own) == ["user", "user"]
    names = ["hosts", "hostname", "machine-id", "resolv.conf", "shadow", "ssl"]
    assert seen(f"return [n for n in {names} if os.path.exists('/etc/' + n)]") == ["hosts"]
    assert not seen(f"return os.path.exists({str(tmp_path / 'theirs.py')!r})")
    assert seen("return os.getuid()") not in (0, os.getuid())
    assert seen("return [l.split()[1] for l in open('/proc/self/status') if l.startswith('CapEff')]") == [
        "0000000000000000"
    ]


def test_it_has_no_network(seen: Any) -> None:
    dial = (
        "import socket\n    try: socket.create_connection(('127.0.0.1', {}), 2)\n"
        "    except OSError as error: return error.errno"
    )
    with socket.create_server(("127.0.0.1", 0)) as server:
        assert seen(dial.format(server.getsockname()[1]))
    assert seen("import socket; return [name for _, name in socket.if_nameindex()]") in ([], ["lo"])


def test_it_writes_to_a_private_folder_only(seen: Any, tmp_path: Path) -> None:
    attempt = (
        "found = []\n    for name in {}:\n        try: open(name, 'w').close(); found.append(name)\n"
        "        except OSError: pass\n    return found"
    )
    # A name that nobody else's file in the machine's /tmp has.
    name = f"x-{uuid.uuid4().hex}"
    folders = ["/tmp", "", "/usr", "/etc", "/dev", "/srv", str(tmp_path)]
    names = [*(f"{folder}/{name}" for folder in folders), "/srv/model/theirs.py"]
    assert seen(attempt.format(names)) == [f"/tmp/{name}"]
    assert not any(Path(f"{folder}/{name}").exists() for folder in folders)


def test_forks_are_held(seen: Any) -> None:
    fork = (
        "number = 0\n    try:\n        while number < 300:\n            if os.fork() == 0:\n"
        "                time.sleep(20); os._exit(0)\n            number += 1\n"
        "    except OSError: pass\n    return number"
    )
    assert 10 < seen(fork, limits={"processes": 50}) <= 50


def test_memory_nobody_counts_is_not_to_be_had(seen: Any) -> None:
    ask = "try: os.memfd_create('a')\n    except OSError as error: return error.errno"
    assert seen(ask) == 38
    new_user = "import ctypes\n    return ctypes.CDLL(None, use_errno=True).unshare(0x10000000)"
    assert seen(new_user) == -1


def test_an_environment_below_a_closed_folder_can_be_used(
    sandbox: Any, simulator: Any, file: Any, tmp_path: Path
) -> None:
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o700)
    venv.create(closed / "environment", symlinks=True)
    packages = Path(np.__file__).parent.parent
    (site,) = closed.glob("environment/lib/python*/site-packages")
    for name in ("numpy", "numpy.libs"):
        if (packages / name).exists():
            subprocess.run(["cp", "-a", packages / name, site], check=True)
    python = closed / "environment" / "bin" / "python"
    stranger = Stranger(
        file("def describe():\n    return {'library': sys.prefix}"), simulator, python=str(python)
    )
    try:
        assert stranger.describe()["claims"]["library"] == str(closed / "environment")
        assert stranger.sample(X, 5, np.random.default_rng(1)).shape == (2, 5, 2)
    finally:
        stranger.close()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be somebody else")
def test_a_caller_without_privileges_is_held_too(sandbox: Any) -> None:
    own = module.Sandbox(bwrap=sandbox.bwrap, prlimit=sandbox.prlimit, setpriv=sandbox.setpriv, user=None)
    script = "id -u; ls /; n=0; while [ $n -lt 60 ]; do sleep 5 & n=$((n+1)); done; echo all"
    words = own.words(["/bin/sh", "-c", script], limits=Limits(processes=30), environment={}, show={})
    nobody = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
    with filtered(words) as (command, handles):
        done = subprocess.run(
            [*nobody, *command], capture_output=True, text=True, check=False, pass_fds=handles, timeout=60
        )
    if "namespace" in done.stderr:
        pytest.skip(f"no namespaces of users here: {done.stderr}")
    assert done.stdout.splitlines()[0] == "65534"
    assert not {"root", "home", "work"} & set(done.stdout.split())
    assert "all" not in done.stdout
    assert "fork" in done.stderr


@pytest.mark.parametrize("missing", ["bwrap", "prlimit", "setpriv"])
def test_without_a_sandbox_it_is_refused(
    missing: str, simulator: Any, file: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = {
        name: None if name == missing else f"/usr/bin/{name}" for name in ("bwrap", "prlimit", "setpriv")
    }
    monkeypatch.setattr(module.shutil, "which", lambda name, **_: found.get(name, name))
    with pytest.raises(InputError, match=f"{missing} is not installed; install bubblewrap .*apt-get install"):
        Stranger(file(), simulator)


def test_a_sandbox_that_does_not_work_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    broken = tmp_path / "bwrap"
    broken.write_text("#!/bin/sh\necho 'bwrap: Creating new namespace failed' >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setattr(module.shutil, "which", lambda name, **_: str(broken))
    with pytest.raises(InputError, match=r"does not work here .*Creating new namespace failed.*bubblewrap"):
        working_sandbox()


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Put a script in bubblewrap's place, for a caller of this number."""

    def put(script: str, caller: int = 0) -> None:
        program = tmp_path / "bwrap"
        program.write_text(f"#!/bin/sh\n{script}\n")
        program.chmod(0o755)
        places = {"bwrap": str(program), "python3": None}
        monkeypatch.setattr(module.shutil, "which", lambda name, **_: places.get(name, f"/usr/bin/{name}"))
        monkeypatch.setattr(module.os, "geteuid", lambda: caller)

    return put


def test_a_privileged_caller_takes_a_user_that_nobody_has(fake: Any) -> None:
    fake("exit 0")
    users = [working_sandbox().user for _ in range(3)]
    assert len(set(users)) == 3
    assert all(user is not None and 1 << 30 <= user < (1 << 30) + (1 << 29) for user in users)
    fake("exit 0", caller=1000)
    assert working_sandbox().user is None


def test_without_privileges_in_a_container_there_may_be_namespaces_of_users(
    fake: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    refuse = 'case "$*" in *{word}*) echo not with {word} >&2; exit 1;; esac'
    fake(refuse.format(word="--cap-drop"))
    found = working_sandbox()
    assert found.user is None
    assert found.describe()["privileges"] == "namespace of users"
    with monkeypatch.context() as there:
        for machine, calls in (("x86_64", "filtered"), ("vax", "not filtered on this processor")):
            there.setattr("platform.machine", lambda machine=machine: machine)
            assert found.describe()["system_calls"] == calls
    fake(refuse.format(word="--unshare-user"))
    found = working_sandbox()
    assert found.user is not None
    assert found.describe()["privileges"] == "unprivileged user of its own"
    # Of two reasons the first is told; there is only one without privileges.
    both = refuse.format(word="--cap-drop") + "\n" + refuse.format(word="--unshare-user")
    fake(both)
    with pytest.raises(InputError, match=r"does not work here \(not with --cap-drop\)"):
        working_sandbox()
    fake(both, caller=1000)
    with pytest.raises(InputError, match=r"does not work here \(not with --unshare-user\)"):
        working_sandbox()


@pytest.mark.parametrize(
    ("script", "why"),
    [("exit 0", "^$"), ("exit 3", "^exit 3$"), ("echo why >&2; exit 1", "^why$"), ("sleep 9", "timed out")],
)
def test_why_a_sandbox_does_not_work_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, why: str
) -> None:
    monkeypatch.setattr(module, "TRIAL_SECONDS", 0.5)
    program = tmp_path / "bwrap"
    program.write_text(f"#!/bin/sh\nPATH=/bin:/usr/bin\n{script}\n")
    program.chmod(0o755)
    one = module.Sandbox(bwrap=str(program), prlimit="prlimit", setpriv="setpriv", user=None)
    assert re.search(why, one.works())
    nothing = module.Sandbox(bwrap="/nowhere/bwrap", prlimit="prlimit", setpriv="setpriv", user=None)
    assert "No such file" in nothing.works()


def test_places_are_made_before_what_is_put_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to("usr/bin")
    system = [str(tmp_path / name) for name in ("folder", "link", "none")]
    monkeypatch.setattr(module, "SYSTEM", system)
    monkeypatch.setattr(module, "CONFIGURATION", (system[0], system[2]))
    own = module.Sandbox(
        bwrap="bwrap", prlimit="prlimit", setpriv="setpriv", user=7, python="/usr/bin/python3"
    )
    show = {"/srv/deep/model": tmp_path / "model", "/usr/local/there": tmp_path / "there"}
    limits = Limits(file_mb=3)
    words = own.words(["run", "it"], limits=limits, environment={"A": "1", "B": "2"}, show=show)

    def after(option: str, number: int) -> list[tuple[str, ...]]:
        return [tuple(words[k + 1 : k + 1 + number]) for k, word in enumerate(words) if word == option]

    folders = [str(folder) for folder in [*reversed(tmp_path.parents)][1:]] + [str(tmp_path)]
    assert after("--dir", 1) == [(place,) for place in sorted([*folders, "/srv", "/srv/deep"])]
    landlock = ("/srv/landlock.py",)
    assert after("--ro-bind", 2) == [
        (system[0], system[0]),
        *sorted(
            [
                ("/usr", "/usr"),
                (system[0], system[0]),
                (str(module.LANDLOCK), *landlock),
                (str(tmp_path / "model"), "/srv/deep/model"),
                (str(tmp_path / "there"), "/usr/local/there"),
            ],
            key=lambda pair: pair[1],
        ),
    ]
    assert after("--symlink", 2) == [("usr/bin", system[1])]
    assert after("--tmpfs", 1) == [("/dev/shm",), ("/tmp",)]
    assert after("--size", 1) == [("3000000",)] * 2
    assert after("--setenv", 2) == [("A", "1"), ("B", "2")]
    assert after("--perms", 1) == [("1777",)] * 2 + [("0755",)] * (len(folders) + 2)
    assert words.index("--dir") < words.index("--ro-bind") < words.index("--setenv") < words.index("--")
    assert {f"--unshare-{name}" for name in ("pid", "net", "ipc", "uts", "cgroup-try")} <= set(words)
    held = words[words.index("--") + 1 :]
    assert held[:4] == ["setpriv", "--reuid=7", "--regid=7", "--clear-groups"]
    assert held[-2:] == ["run", "it"]
    rights = json.loads(held[-3])
    assert rights["write"] == ["/dev/shm", "/tmp"]
    assert set(rights["run"]) == {system[0], "/srv", *(place for _, place in after("--ro-bind", 2))}
    assert (rights["read"], rights["use"]) == (["/proc"], ["/dev"])
    alone = dataclasses.replace(own, python=None).words(["run"], limits=limits, environment={}, show={})
    assert alone[-2] == "--"
    assert "/srv/landlock.py" not in alone


def test_only_folders_of_an_interpreter_are_shown(tmp_path: Path) -> None:
    home = tmp_path / "home"
    (home / "bin").mkdir(parents=True)
    (home / "bin" / "python").symlink_to(sys.executable)
    found = find_interpreter(home / "bin" / "python")
    assert home not in found.folders
    assert all(any(folder.glob("lib*/python3*")) or folder.is_file() for folder in found.folders)
    script = home / "bin" / "shim"
    script.write_text("#!/bin/sh\nexec python\n")
    script.chmod(0o755)
    with pytest.raises(InputError, match="is a script that finds an interpreter"):
        find_interpreter(script)
    with pytest.raises(InputError, match="is no Python interpreter"):
        find_interpreter(home / "bin" / "nothing")


def test_an_installation_is_shown_under_every_name_that_leads_there(tmp_path: Path) -> None:
    installation, latest = tmp_path / "python-3.11.9", tmp_path / "python-3.11"
    (installation / "bin").mkdir(parents=True)
    (installation / "bin" / "python3").write_bytes(Path(sys.executable).resolve().read_bytes())
    (installation / "bin" / "python3").chmod(0o755)
    (installation / "lib" / "python3.11").mkdir(parents=True)
    (installation / "lib" / "python3.11" / "os.py").write_text("")
    latest.symlink_to(installation)
    environment = tmp_path / "environment"
    (environment / "bin").mkdir(parents=True)
    (environment / "pyvenv.cfg").write_text(f"home = {latest / 'bin'}\n")
    (environment / "bin" / "python").symlink_to(latest / "bin" / "python3")
    found = find_interpreter(environment / "bin" / "python")
    assert found.executable == environment / "bin" / "python"
    assert set(found.folders) == {environment, latest, installation}


def test_an_environment_of_copies_shows_the_installation_that_it_names(tmp_path: Path) -> None:
    """No link leads there (`venv --copies`): its configuration says where the library lies."""
    installation, environment = tmp_path / "python-3.11.9", tmp_path / "environment"
    (installation / "lib" / "python3.11").mkdir(parents=True)
    (installation / "lib" / "python3.11" / "os.py").write_text("")
    (environment / "bin").mkdir(parents=True)
    for python in (environment / "bin" / "python", installation / "bin" / "python"):
        python.parent.mkdir(exist_ok=True)
        python.write_bytes(Path(sys.executable).resolve().read_bytes())
        python.chmod(0o755)
    said = f"version = 3.11.9\nhome = {installation / 'bin'}\nexecutable = {tmp_path / 'other' / 'python'}\n"
    (environment / "pyvenv.cfg").write_text(said)
    found = find_interpreter(environment / "bin" / "python")
    assert found.executable == environment / "bin" / "python"
    assert set(found.folders) == {environment, environment / "bin" / "python", installation}
    (environment / "pyvenv.cfg").write_text("version = 3.11.9\n")
    assert installation not in find_interpreter(environment / "bin" / "python").folders
