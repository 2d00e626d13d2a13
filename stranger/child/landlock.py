"""Landlock: a wall behind the sandbox's mounts, which a process puts up before it becomes the stranger.

Called in the sandbox with the system's Python as ``landlock.py RIGHTS PROGRAM WORDS...``. RIGHTS is JSON:
what may be done, "run", "read", "write" or "use", and the places below which it may. Everything else of what
Landlock knows is refused: to the stranger, to whatever it starts, and for ever. PROGRAM runs behind the wall
or not at all.

Source: the Linux kernel's userspace-api/landlock, linux/landlock.h.
"""

import ctypes
import json
import os
import signal
import stat
import sys

# The same numbers on all kinds of processors.
CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
ASK_VERSION, PATH_BENEATH = 1, 1
EXECUTE, WRITE_FILE, READ_FILE, READ_DIR, TRUNCATE, IOCTL_DEV = (1 << bit for bit in (0, 1, 2, 3, 14, 15))
OF_FILES = EXECUTE | WRITE_FILE | READ_FILE | TRUNCATE | IOCTL_DEV
# Rights that a version of the kernel's interface knows. The first does not let files move between folders,
# not even below /tmp, so that one is not used.
KNOWN = {2: (1 << 14) - 1, 3: (1 << 15) - 1, 4: (1 << 15) - 1}
NEWEST = (1 << 16) - 1
# Since the sixth: no signals and no abstract sockets to processes before the wall.
SCOPED_SINCE, SCOPED = 6, 3
READ = READ_FILE | READ_DIR
RIGHTS = {"run": EXECUTE | READ, "read": READ, "write": NEWEST, "use": READ | WRITE_FILE | IOCTL_DEV}


class Ruleset(ctypes.Structure):
    """struct landlock_ruleset_attr."""

    _fields_ = [("files", ctypes.c_uint64), ("network", ctypes.c_uint64), ("scoped", ctypes.c_uint64)]


class Beneath(ctypes.Structure):
    """struct landlock_path_beneath_attr."""

    _pack_ = 1
    _fields_ = [("allowed", ctypes.c_uint64), ("handle", ctypes.c_int32)]


def called(number, *arguments):
    """The answer of a system call.

    Raises
    ------
    OSError
        If it says no.
    """
    words = [ctypes.c_long(word) for word in (number, *arguments)]
    found = ctypes.CDLL(None, use_errno=True).syscall(*words)
    if found < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return found


def restrict(rights):
    """Leave this process what `rights` say, and nothing else."""
    version = called(CREATE_RULESET, 0, 0, ASK_VERSION)
    if version < min(KNOWN):
        raise OSError("this kernel's Landlock knows no files that move between folders")
    known = KNOWN.get(version, NEWEST)
    asked = Ruleset(known, 0, SCOPED if version >= SCOPED_SINCE else 0)
    rules = called(CREATE_RULESET, ctypes.addressof(asked), ctypes.sizeof(asked), 0)
    for what, places in rights.items():
        for place in places:
            handle = os.open(place, os.O_PATH | os.O_CLOEXEC)
            kind = NEWEST if stat.S_ISDIR(os.fstat(handle).st_mode) else OF_FILES
            rule = Beneath(RIGHTS[what] & known & kind, handle)
            called(ADD_RULE, rules, PATH_BENEATH, ctypes.addressof(rule), 0)
            os.close(handle)
    called(RESTRICT_SELF, rules, 0)
    os.close(rules)


def main():
    """Put up the wall, and become the program."""
    try:
        restrict(json.loads(sys.argv[1]))
    except (OSError, AttributeError) as error:
        sys.exit(f"landlock: {error}")
    # Python ignores these, and what is ignored stays so.
    for number in (signal.SIGPIPE, signal.SIGXFSZ):
        signal.signal(number, signal.SIG_DFL)
    try:
        os.execvp(sys.argv[2], sys.argv[2:])
    except OSError as error:
        sys.stderr.write(f"{sys.argv[2]}: {error.strerror}\n")
        sys.exit(127)


if __name__ == "__main__":
    main()
