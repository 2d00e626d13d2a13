"""The filter of system calls, run by a machine of the kernel's language that was written here."""

from __future__ import annotations

import os
import re
import struct
from pathlib import Path

import pytest

from gaugeblock.stranger.system_calls import REFUSED, filtered, seccomp_filter

HEADERS = {
    "x86_64": Path("/usr/include/x86_64-linux-gnu/asm/unistd_64.h"),
    "aarch64": Path("/usr/include/asm-generic/unistd.h"),
}
KINDS = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
ALLOW, KILL, ABSENT = 0x7FFF0000, 0x80000000, 0x00050026
# Without these no interpreter runs: read, write, mmap, futex, exit_group, openat, prlimit64, rseq.
NEEDED = {"x86_64": (0, 1, 9, 202, 231, 257, 302, 334), "aarch64": (63, 64, 222, 98, 94, 56, 261, 293)}


def answered(machine: str, number: int, first: int = 0, *, kind: int | None = None) -> int:
    """What the kernel would do with a call, by the operations of classic BPF."""
    content = seccomp_filter(machine)
    program = [struct.unpack_from("=HBBI", content, place) for place in range(0, len(content), 8)]
    asked = struct.pack("=IIQQ", number, KINDS[machine] if kind is None else kind, 0, first)
    held, place = 0, 0
    while True:
        operation, true, false, value = program[place]
        place += 1
        if operation == 0x20:
            (held,) = struct.unpack_from("=I", asked, value)
            assert (true, false) == (0, 0)
        elif operation == 0x06:
            assert (true, false) == (0, 0)
            return value
        else:
            met = {0x15: held == value, 0x35: held >= value, 0x45: bool(held & value)}[operation]
            place += true if met else false


@pytest.mark.parametrize("column", [0, 1])
def test_what_is_named_is_refused_and_the_rest_of_the_known_is_not(column: int) -> None:
    machine = list(KINDS)[column]
    refused = {numbers[column] for numbers in REFUSED.values()}
    socket, clone = ((41, 56), (198, 220))[column]
    known = {*range((335, 295)[column]), *range(424, 457)} - {socket, clone}
    for number in range(600):
        wanted = ALLOW if number in known - refused else ABSENT
        if number not in (socket, clone):
            assert answered(machine, number) == wanted, number
    for number in NEEDED[machine]:
        for first in (0, 2, 0x10000011):  # of no matter there
            assert answered(machine, number, first) == ALLOW
    for number in (0x40000000, 0x40000001, 0xFFFFFFFF):
        assert answered(machine, number) == ABSENT
    for number in (0, socket, 1000):
        assert answered(machine, number, kind=0x40000003) == KILL
    for family in range(50):
        assert answered(machine, socket, family) == (ALLOW if family in (1, 2, 10, 16) else ABSENT)
    assert answered(machine, clone, 0x01200011) == ALLOW
    assert answered(machine, clone, 0x10000011) == ABSENT


@pytest.mark.skipif(not seccomp_filter(), reason="no filter of system calls for this kind of processor")
def test_the_filter_is_handed_over_to_be_read_and_closed() -> None:
    before = set(os.listdir("/proc/self/fd"))
    with filtered(["bwrap", "--die-with-parent", "true"]) as (words, handles):
        (handle,) = handles
        assert words == ["bwrap", "--seccomp", str(handle), "--die-with-parent", "true"]
        assert os.read(handle, 1 << 16) == seccomp_filter()
    assert set(os.listdir("/proc/self/fd")) == before


def test_without_a_filter_the_words_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platform.machine", lambda: "vax")
    assert seccomp_filter() == b""
    with filtered(("bwrap", "true")) as found:
        assert found == (["bwrap", "true"], ())


@pytest.mark.parametrize("machine", KINDS)
def test_numbers_are_those_of_the_kernels_headers(machine: str) -> None:
    if not HEADERS[machine].exists():
        pytest.skip("no headers of the kernel")
    text = HEADERS[machine].read_text()
    there = {name: int(number) for name, number in re.findall(r"define __NR(?:3264)?_(\w+)\s+(\d+)", text)}
    column = list(KINDS).index(machine)
    assert len(there) > 300
    for name, numbers in REFUSED.items():
        assert there.get(name) == numbers[column], name
    assert max(number for number in there.values() if number < 400) == (334, 294)[column]
