"""Strangers that look around, or for somebody to talk to: there is nothing and nobody."""

import os
import socket
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

# Tries everything, and says what it got; `secret` is what it would know the truth by.
LOOK = """
got = []

def attempt(what, act):
    try:
        found = act()
    except (OSError, ValueError, RuntimeError, ImportError):
        return
    got.append(f"{what} {str(found)[:40]}")

def content(path):
    with open(path, "rb") as file:
        return file.read(1 << 16)

def tell():
    raise RuntimeError(f"ESCAPED: {got}" if got else "nothing that is not mine is to be had")
"""
NOTHING = "could not answer sample: RuntimeError: nothing that is not mine is to be had"


def test_files_of_the_machine_are_not_there(attack: Callable[..., Any], place: Any, tmp_path: Path) -> None:
    beside = tmp_path / "beside.txt"
    beside.write_text("next to the model")
    home = Path.home()
    places = [
        "/etc/shadow",
        "/etc/hostname",
        "/etc/machine-id",
        "/etc/resolv.conf",
        "/home",
        "/var",
        "/sys",
        "/run",
        "/dev/sda",
    ]
    places += ["/dev/mem", "/dev/kmsg", "/dev/fuse", "/proc/kcore", "/proc/kmsg"]
    places += map(str, (home, home / ".ssh", home / ".bash_history", place.canary, beside, tmp_path))
    places += [os.getcwd(), __file__]
    done = attack(
        LOOK
        + f"""
def sample(x, n, seed):
    import glob
    for path in {places!r}:
        attempt(path, lambda: content(path))
        # A folder that leads to the interpreter is there, with nothing else in it.
        attempt(path, lambda: [e.path for e in os.scandir(path) if e.is_file()] or 1 / 0)
    out = {str(place.out)!r}
    for path in glob.glob(out + "/**/*", recursive=True) + glob.glob(out + "/.chunks/*"):
        got.append(path)
    # The users that are known are made up.
    users = content("/etc/passwd").decode()
    if users.count("\\n") != 1 or not users.startswith("user:"):
        got.append(users)
    # What belongs to it is there: its own file, alone.
    if len(os.listdir(os.path.dirname(__file__))) != 1:
        got.append("files beside the model")
    tell()
""".replace("or 1 / 0)", "or os.stat('/none'))")
    )
    assert NOTHING in done.reason
    # It looked while the seed was there to be found.
    assert list((place.out / ".chunks").glob("*.seed"))


def test_the_environment_and_the_parent_are_not_there(attack: Callable[..., Any]) -> None:
    parent = os.getpid()
    done = attack(
        LOOK
        + f"""
def sample(x, n, seed):
    import subprocess
    if any("gaugeblock" in key.lower() + value.lower() for key, value in os.environ.items()):
        got.append("environment")
    numbers = {{int(name) for name in os.listdir("/proc") if name.isdigit()}}
    for number in {{1, {parent}, os.getppid()}} - {{os.getpid()}}:
        for name in ("environ", "mem", "root/etc/shadow", "cwd/canary.txt"):
            attempt(f"{{number}} {{name}}", lambda: content(f"/proc/{{number}}/{{name}}") or os.stat("/none"))
    if len(numbers) > 3:
        got.append(f"processes {{numbers}}")
    # Pipes to the audit, and nothing that was open there.
    # Those of the sandbox's own first process can be seen where it has no other user.
    for path in [f"/proc/{{one}}/fd/{{number}}" for one in numbers for number in range(64)]:
        attempt(path, lambda: not (link := os.readlink(path)).startswith(
            ("pipe:", "anon_inode:", "/dev/null", "/proc/")) and link or os.stat("/none"))
    tell()
""",
    )
    assert NOTHING in done.reason


@contextmanager
def _listener(kind: int, family: int, address: Any) -> Iterator[socket.socket]:
    with socket.socket(family, kind) as listener:
        listener.bind(address)
        if kind == socket.SOCK_STREAM:
            listener.listen()
        listener.setblocking(False)
        yield listener


def test_nobody_listens(attack: Callable[..., Any], place: Any) -> None:
    name = f"\0gaugeblock-{os.getpid()}"
    with ExitStack() as stack:
        kinds = {
            "tcp": (socket.SOCK_STREAM, socket.AF_INET, ("127.0.0.1", 0)),
            "udp": (socket.SOCK_DGRAM, socket.AF_INET, ("127.0.0.1", 0)),
            "abstract": (socket.SOCK_STREAM, socket.AF_UNIX, name),
            "file": (socket.SOCK_STREAM, socket.AF_UNIX, str(place.folder / "s")),
        }
        listeners = {key: stack.enter_context(_listener(*kind)) for key, kind in kinds.items()}
        stack.callback((place.folder / "s").unlink)
        addresses = {key: one.getsockname() for key, one in listeners.items()}
        done = attack(
            LOOK
            + f"""
def connected(family, kind, address):
    with socket.socket(family, kind) as made:
        made.settimeout(1)
        made.connect(address)
        made.send(b"theta")
    return address

def sample(x, n, seed):
    addresses = {addresses!r}
    attempt("tcp", lambda: connected(socket.AF_INET, socket.SOCK_STREAM, addresses["tcp"]))
    for key in ("abstract", "file"):
        attempt(key, lambda: connected(socket.AF_UNIX, socket.SOCK_STREAM, addresses[key]))
    for address in ("192.0.2.1", "10.0.0.1", "169.254.169.254"):
        attempt(address, lambda: connected(socket.AF_INET, socket.SOCK_STREAM, (address, 80)))
        attempt(address, lambda: connected(socket.AF_INET, socket.SOCK_DGRAM, (address, 53)))
    attempt("name", lambda: socket.getaddrinfo("example.org", 80))
    attempt("raw", lambda: socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_ICMP))
    attempt("packet", lambda: socket.socket(socket.AF_PACKET, socket.SOCK_RAW))
    # Not apart in every kernel's namespaces: the machine around a virtual machine listens there.
    attempt("vsock", lambda: socket.socket(socket.AF_VSOCK, socket.SOCK_STREAM))
    attempt("bluetooth", lambda: socket.socket(31, socket.SOCK_RAW, 1))
    attempt("crypto", lambda: socket.socket(38, socket.SOCK_SEQPACKET))
    if [interface for _, interface in socket.if_nameindex() if interface != "lo"]:
        got.append("interfaces")
    # Datagrams to nobody go without an error; the listener says whether one arrived.
    try:
        connected(socket.AF_INET, socket.SOCK_DGRAM, addresses["udp"])
    except OSError:
        pass
    tell()
"""
        )
        assert NOTHING in done.reason
        for key, listener in listeners.items():
            try:
                got = listener.recv(9) if key == "udp" else listener.accept()[0]
            except BlockingIOError:
                continue
            raise AssertionError((key, got))


def test_nothing_outside_can_be_written(attack: Callable[..., Any], place: Any) -> None:
    places = [str(place.canary), str(place.out), os.getcwd(), str(Path.home()), "/usr/lib", "/usr/local/lib",
              "/etc/passwd", "/etc", "/", "/dev", "/srv", "/srv/server/serve.py", "/srv/model",
              "/proc/sys/kernel/core_pattern", "/proc/sysrq-trigger", "/lib",
              "/var/tmp", "/run"]  # fmt: skip
    # What lies in /tmp itself it may make anew, in a /tmp of its own.
    places = [path for path in places if os.path.dirname(path) != "/tmp"]
    done = attack(
        LOOK
        + f"""
def sample(x, n, seed):
    own = [sys.prefix, os.path.dirname(np.__file__), np.__file__, __file__, sys.executable]
    for path in {places!r} + own:
        attempt(path, lambda: open(path, "ab"))
        attempt(path, lambda: open(path + "/new", "wb"))
        attempt(path, lambda: os.mkdir(path + "/folder"))
        attempt(path, lambda: os.symlink("/tmp", path + "/link"))
        attempt(path, lambda: os.mkfifo(path + "/fifo"))
        attempt(path, lambda: os.chmod(path, 0o777))
        attempt(path, lambda: os.rename(path, path + "-gone"))
        attempt(path, lambda: os.utime(path))
    attempt("device", lambda: os.mknod("/tmp/device", 0o60666, os.makedev(8, 0)))
    attempt("root", lambda: os.setuid(0))
    attempt("chroot", lambda: os.chroot("/tmp"))
    attempt("nice", lambda: os.setpriority(os.PRIO_PROCESS, 0, -5))
    tell()
"""
    )
    assert NOTHING in done.reason


def test_the_canary_could_be_read_from_here(place: Any) -> None:
    # So what no stranger sees is hidden by the sandbox, not by the file's own mode.
    said = subprocess.run(["cat", place.canary], capture_output=True, check=True, text=True)
    assert said.stdout == "the canary sings"
