"""System calls that a stranger has: those of a kernel of 2024, but for what it has no business with.

A filter in the kernel's own language (seccomp, classic BPF). What is refused are numbers that were not
given out then, what containers refuse too, memory that nobody counts, and the kernel's less trodden corners.
Whatever asks is told that there is no such call, as on an older kernel, so that libraries fall back to
something else.
"""

from __future__ import annotations

import os
import platform
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

# Numbers that are calls: from 0 to the first of these on x86_64, on aarch64; on both between the others.
ONCE, SINCE, NEWEST = (334, 294), 424, 456
# name -> number on x86_64 and on aarch64, where there is one
REFUSED: dict[str, tuple[int, int | None]] = {
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
    # What only the machine's administrator may do, or should: nothing that an estimator needs begins there.
    "acct": (163, 89),
    "adjtimex": (159, 171),
    "chroot": (161, 51),
    "clock_adjtime": (305, 266),
    "clock_settime": (227, 112),
    "create_module": (174, None),
    "delete_module": (176, 106),
    "fanotify_init": (300, 262),
    "finit_module": (313, 273),
    "fsconfig": (431, 431),
    "fsmount": (432, 432),
    "fspick": (433, 433),
    "get_kernel_syms": (177, None),
    "init_module": (175, 105),
    "ioperm": (173, None),
    "iopl": (172, None),
    "kcmp": (312, 272),
    "kexec_file_load": (320, 294),
    "lookup_dcookie": (212, 18),
    "migrate_pages": (256, 238),
    "modify_ldt": (154, None),
    "mount_setattr": (442, 442),
    "move_mount": (429, 429),
    "move_pages": (279, 239),
    "nfsservctl": (180, 42),
    "pidfd_getfd": (438, 438),
    "process_madvise": (440, 440),
    "query_module": (178, None),
    "quotactl": (179, 60),
    "quotactl_fd": (443, 443),
    "reboot": (169, 142),
    "setdomainname": (171, 162),
    "sethostname": (170, 161),
    "settimeofday": (164, 170),
    "swapoff": (168, 225),
    "swapon": (167, 224),
    "_sysctl": (156, None),
    "sysfs": (139, None),
    "syslog": (103, 116),
    "uselib": (134, None),
    "ustat": (136, None),
    "vhangup": (153, 58),
}
CLONE = (56, 220)
NEW_USER_NAMESPACE = 0x10000000
SOCKET = (41, 198)
# Unix, both internets and netlink, which a namespace of networks holds. Others it does not hold: by vsock a
# program in a virtual machine talks to the machine around it.
FAMILIES = (1, 2, 10, 16)
MACHINES = {"x86_64": (0, 0xC000003E), "aarch64": (1, 0xC00000B7)}

LOAD, JUMP_IF_EQUAL, JUMP_IF_AT_LEAST, JUMP_IF_ANY_BIT, RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
NUMBER, ARCHITECTURE, FIRST_ARGUMENT = 0, 4, 16
ALLOW, KILL, NO_SUCH_CALL = 0x7FFF0000, 0x80000000, 0x00050000 | 38


def seccomp_filter(machine: str | None = None) -> bytes:
    """The filter for a kind of processor (default: this one); empty where its numbers are not known.

    >>> len(seccomp_filter("x86_64")) % 8, seccomp_filter("vax")
    (0, b'')
    """
    known = MACHINES.get(machine or platform.machine())
    if known is None:
        return b""
    column, architecture = known
    refuse = (RETURN, 0, 0, NO_SUCH_CALL)
    program = [
        (LOAD, 0, 0, ARCHITECTURE),
        (JUMP_IF_EQUAL, 1, 0, architecture),
        (RETURN, 0, 0, KILL),
        (LOAD, 0, 0, NUMBER),
        # Younger ones, and those of the other ways to call that a kind of processor may have (x32).
        (JUMP_IF_AT_LEAST, 0, 1, NEWEST + 1),
        refuse,
        (JUMP_IF_AT_LEAST, 2, 0, SINCE),
        (JUMP_IF_AT_LEAST, 0, 1, ONCE[column] + 1),
        refuse,
    ]
    for number in (numbers[column] for numbers in REFUSED.values()):
        if number is not None:
            program += [(JUMP_IF_EQUAL, 0, 1, number), refuse]
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
