"""The sandbox that a stranger runs in: bubblewrap, with no network, no host files, no environment."""

from __future__ import annotations

import json
import os
import secrets
import shutil
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gaugeblock.core.errors import InputError
from gaugeblock.stranger.limits import Limits
from gaugeblock.stranger.system_calls import filtered, seccomp_filter

INSTALL = (
    "install bubblewrap (Debian, Ubuntu: apt-get install bubblewrap), or run the file as it is, "
    "with all that its author may have put into it, by --i-trust-this-estimator"
)
TRIAL_SECONDS = 20
# Users that no system gives to anybody: a limit on processes counts those of one user.
USERS = (1 << 30, 1 << 29)
SYSTEM = ("/bin", "/sbin", "/lib", "/lib32", "/lib64", "/libx32")
# Where to look up shared libraries; nothing that says whose machine it is.
CONFIGURATION = ("/etc/ld.so.cache", "/etc/alternatives")
# What it may write to; and what puts up a second wall around it (Landlock), shown at its place.
PRIVATE = ("/dev/shm", "/tmp")
LANDLOCK = Path(__file__).resolve().parent / "child" / "landlock.py"
# Where a stranger finds itself: names as many machines have them, none of which says what this is.
ROOT, HOST = "/srv", "localhost"
LANDLOCK_PLACE = f"{ROOT}/landlock.py"
STANDARD_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


@dataclass(frozen=True, kw_only=True)
class Sandbox:
    """How to run a program where it can do no harm; `made` by `working_sandbox`, which has tried it.

    `user` is the unprivileged user that a privileged caller becomes inside; None where an unprivileged caller
    has a namespace of users. `python` is the system's, which puts up Landlock; None where one of the two is
    missing. Never the stranger's own: that one could leave it out.
    """

    bwrap: str
    prlimit: str
    setpriv: str
    user: int | None
    python: str | None = None

    def words(
        self,
        program: Sequence[str],
        *,
        limits: Limits,
        environment: Mapping[str, str],
        show: Mapping[str, Path],
    ) -> list[str]:
        """The command line that runs `program`, which sees the system and `show`: its place -> what is there.

        All of it is read-only but a private /tmp.
        """
        configuration = {name: Path(name) for name in CONFIGURATION if Path(name).exists()}
        launcher = {} if self.python is None else {LANDLOCK_PLACE: LANDLOCK}
        bound = {"/usr": Path("/usr"), **launcher, **configuration, **show}
        words = [self.bwrap, *self._namespaces(), "--die-with-parent", "--new-session", "--clearenv"]
        words += ["--hostname", HOST, "--proc", "/proc", "--dev", "/dev"]
        for folder in PRIVATE:
            words += ["--perms", "1777", "--size", str(limits.file_bytes), "--tmpfs", folder]
        for place in _parents(bound):
            words += ["--perms", "0755", "--dir", place]
        for name in SYSTEM:
            words += _system(Path(name))
        for place in sorted(bound):
            words += ["--ro-bind", str(bound[place]), place]
        for name, value in environment.items():
            words += ["--setenv", name, value]
        words += ["--chdir", "/tmp", "--remount-ro", "/dev", "--remount-ro", "/", "--"]
        held = [*self._unprivileged(), *limits.command(self.prlimit), *self._landlock(bound)]
        return [*words, *held, *program]

    def _landlock(self, bound: Iterable[str]) -> list[str]:
        """What runs a program behind a second wall, with the rights that the mounts give it."""
        if self.python is None:
            return []
        folders = [*(name for name in SYSTEM if Path(name).is_dir()), ROOT]
        rights = {"run": [*folders, *bound], "read": ["/proc"], "use": ["/dev"], "write": PRIVATE}
        return [self.python, "-I", "-S", "-B", LANDLOCK_PLACE, json.dumps(rights)]

    def _namespaces(self) -> list[str]:
        if self.user is None:
            user = ["--unshare-user", "--uid", "65534", "--gid", "65534"]
        else:
            needed = ("CAP_SETUID", "CAP_SETGID", "CAP_SETPCAP")
            user = ["--cap-drop", "ALL", *(word for name in needed for word in ("--cap-add", name))]
        apart = ("pid", "net", "ipc", "uts", "cgroup-try")
        return [*user, *(f"--unshare-{name}" for name in apart)]

    def _unprivileged(self) -> list[str]:
        if self.user is None:
            return [self.setpriv, "--no-new-privs"]
        changed = [f"--reuid={self.user}", f"--regid={self.user}", "--clear-groups"]
        return [self.setpriv, *changed, "--bounding-set=-all", "--inh-caps=-all", "--no-new-privs"]

    def describe(self) -> dict[str, str]:
        """How it is made, for provenance."""
        said = subprocess.run([self.bwrap, "--version"], capture_output=True, text=True, check=False)
        way = "namespace of users" if self.user is None else "unprivileged user of its own"
        calls = "filtered" if seccomp_filter() else "not filtered on this processor"
        landlock = "not in force here" if self.python is None else "in force"
        return {
            "program": said.stdout.strip(),
            "privileges": way,
            "system_calls": calls,
            "landlock": landlock,
        }

    def works(self) -> str:
        """Empty if a program runs in it; else why not."""
        program = shutil.which("true", path=STANDARD_PATH) or "true"
        command = self.words([program], limits=Limits(), environment={}, show={})
        try:
            with filtered(command) as (words, handles):
                done = subprocess.run(
                    words,
                    capture_output=True,
                    text=True,
                    check=False,
                    timeout=TRIAL_SECONDS,
                    stdin=subprocess.DEVNULL,
                    env={},
                    pass_fds=handles,
                )
        except (OSError, subprocess.TimeoutExpired) as error:
            return str(error)
        return "" if done.returncode == 0 else done.stderr.strip() or f"exit {done.returncode}"


def working_sandbox() -> Sandbox:
    """A sandbox that has been tried on this machine.

    Raises
    ------
    InputError
        If there is none: the message says what is missing and how to install it.
    """
    found = {name: shutil.which(name, path=STANDARD_PATH) for name in ("bwrap", "prlimit", "setpriv")}
    missing = [name for name, path in found.items() if path is None]
    if missing:
        raise InputError(f"no sandbox for a stranger's estimator: {missing[0]} is not installed; {INSTALL}")
    user = USERS[0] + secrets.randbelow(USERS[1]) if os.geteuid() == 0 else None
    sandbox = Sandbox(user=user, **{name: str(path) for name, path in found.items()})
    why = sandbox.works()
    if why and user is not None:  # root of a container without privileges: it may have namespaces of users
        sandbox = replace(sandbox, user=None)
        why = sandbox.works() and why
    if why:
        raise InputError(
            "no sandbox for a stranger's estimator: bubblewrap does not work here "
            f"({' '.join(why.split())}); {INSTALL}"
        )
    behind = replace(sandbox, python=shutil.which("python3", path=STANDARD_PATH))
    return sandbox if behind.works() else behind


def _system(path: Path) -> list[str]:
    """A top-level folder of the system: a link into /usr on most, a folder on others."""
    if path.is_symlink():
        return ["--symlink", os.readlink(path), str(path)]
    return ["--ro-bind", str(path), str(path)] if path.is_dir() else []


def _parents(places: Iterable[str]) -> list[str]:
    """Folders that lead to these places, outermost first: those that bubblewrap makes itself are closed."""
    found = {parent for place in places for parent in Path(place).parents if parent != Path("/")}
    return sorted(str(folder) for folder in found if not folder.is_relative_to("/usr"))
