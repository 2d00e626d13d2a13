"""System calls that a stranger is refused: memory that nobody counts, and the kernel's less trodden corners.

A filter in the kernel's own language (seccomp, classic BPF). Whatever asks is told that there is no such
call, as on an older kernel, so that libraries fall back to something else.
"""

from __future__ import annotations

import os
import platform
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

# name -> number on x86_64 and on aarch64
REFUSED = {
    "memfd_create": (319, 279),
    "memfd_secret": (447, 447),
    "shmget": (29, 194),
    "msgget": (68, 186),
    "semget": (64, 190),
    "mq_open": (240, 180),
    "io_uring_setup": (425, 425),
    "userfaultfd": (323, 282),
    "bpf": (321, 280),
    "perf_event_open": (298, 241),
    "add_key": (248, 217),
    "request_key": (249, 218),
    "keyctl": (250, 219),
    "mount": (165, 40),
    "umount2": (166, 39),
    "pivot_root": (155, 41),
    "fsopen": (430, 430),
    "open_tree": (428, 428),
    "kexec_load": (246, 104),
    "open_by_handle_at": (304, 265),
    "ptrace": (101, 117),
    "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271),
    "setns": (308, 268),
    "unshare": (272, 97),
    # Its flags lie in memory, where a filter cannot look; the C library then takes `clone`.
    "clone3": (435, 435),
}
CLONE = (56, 220)
NEW_USER_NAMESPACE = 0x10000000
SOCKET = (41, 198)
# Unix, both internets and netlink, which a namespace of networks holds. Others it does not hold: by vsock a
# program in a virtual machine talks to the machine around it.
FAMILIES = (1, 2, 10, 16)
MACHINES = {"x86_64": (0, 0xC000003E), "aarch64": (1, 0xC00000B7)}
FOREIGN_CALLS = 0x40000000

LOAD, JUMP_IF_EQUAL, JUMP_IF_AT_LEAST, JUMP_IF_ANY_BIT, RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
NUMBER, ARCHITECTURE, FIRST_ARGUMENT = 0, 4, 16
ALLOW, KILL, NO_SUCH_CALL = 0x7FFF0000, 0x80000000, 0x00050000 | 38


def seccomp_filter(machine: str | None = None) -> bytes:
    """The filter for a kind of processor (default: this one); empty where its numbers are not known.

    >>> len(seccomp_filter("x86_64")) % 8, seccomp_filter("vax")
    (0, b'')
    """
    column, architecture = MACHINES.get(machine or platform.machine(), (None, 0))
    if column is None:
        return b""
    refuse = (RETURN, 0, 0, NO_SUCH_CALL)
    program = [
        (LOAD, 0, 0, ARCHITECTURE),
        (JUMP_IF_EQUAL, 1, 0, architecture),
        (RETURN, 0, 0, KILL),
        (LOAD, 0, 0, NUMBER),
        (JUMP_IF_AT_LEAST, 0, 1, FOREIGN_CALLS),
        refuse,
    ]
    for numbers in REFUSED.values():
        program += [(JUMP_IF_EQUAL, 0, 1, numbers[column]), refuse]
    program += [
        (JUMP_IF_EQUAL, 0, len(FAMILIES) + 3, SOCKET[column]),
        (LOAD, 0, 0, FIRST_ARGUMENT),
        *((JUMP_IF_EQUAL, len(FAMILIES) - i, 0, family) for i, family in enumerate(FAMILIES)),
        refuse,
        (RETURN, 0, 0, ALLOW),
        (JUMP_IF_EQUAL, 0, 3, CLONE[column]),
        (LOAD, 0, 0, FIRST_ARGUMENT),
        (JUMP_IF_ANY_BIT, 0, 1, NEW_USER_NAMESPACE),
        refuse,
        (RETURN, 0, 0, ALLOW),
    ]
    return b"".join(struct.pack("=HBBI", *instruction) for instruction in program)


@contextmanager
def filtered(words: Sequence[str]) -> Iterator[tuple[list[str], tuple[int, ...]]]:
    """A bubblewrap command line with the filter, and the descriptors to be handed to it."""
    program = seccomp_filter()
    if not program:
        yield list(words), ()
        return
    handle = os.memfd_create("filter")
    try:
        os.write(handle, program)
        os.lseek(handle, 0, os.SEEK_SET)
        yield [words[0], "--seccomp", str(handle), *words[1:]], (handle,)
    finally:
        os.close(handle)
