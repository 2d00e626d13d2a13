"""Programs that break the protocol: nothing of it is unpickled, believed or read beyond its limits.

What they wait for at their end, where the audit should have ended them, is far beyond a test's patience.
"""

import re
from collections.abc import Callable
from typing import Any

import pytest

# What a program does -> the reason that the audit gives.
BEFORE = {
    "is silent and ends": ("sys.exit(3)", "ended by itself \\(exit 3\\), and said nothing"),
    "prints words": ("print('hello, I am a posterior estimator', flush=True)", "announced a header of"),
    "answers before it is asked": ("draws(); block(npy())", "answered something else than describe"),
    "announces gigabytes": (
        r"target.write(b'\xff\xff\xff\xff' * 1000); target.flush()",
        "announced a header of 4,294,967,295",
    ),
    "speaks no JSON": (r"target.write(framed(b'\x80\x04\x95pickle')); target.flush()", "no JSON header"),
    "speaks no UTF-8": (
        r"""target.write(framed(b'{"answer": "\xff\xfe"}')); target.flush()""",
        "no JSON header",
    ),
    "nests": ("target.write(framed(b'[' * 60000)); target.flush()", "no JSON header"),
    "counts": ("target.write(framed(b'9' * 60000)); target.flush()", "no JSON header"),
    "answers a list": ("target.write(framed(b'[1, 2]')); target.flush()", "no JSON object"),
    "cannot sample": ("introduce(can=['embed'])", "does not say that it can sample"),
    "has parameters that are no names": ("introduce(parameters={'a': 1})", "no list of names"),
    "has versions that are no table": ("introduce(versions=[1])", "no table"),
    "has a million parameters": ("introduce(parameters=[''] * 15000)", "no list of names"),
    "has other parameters": ("introduce(parameters=['a', 'b', 'c'])", "has 3 parameters"),
}
AFTER = {
    "a pickle": (r"block(b'\x80\x04cos\nsystem\n(Vfalse\ntR.' + bytes(99))", "no .npy array of version 1.0"),
    "objects": (
        "block(npy(descr=\"'|O'\", content=b'cos\\nsystem\\n(Vfalse\\ntR.'))",
        "of type |O; expected one of <f8",
    ),
    "records": ("block(npy(descr=\"[('a', '<f8')]\"))", "of type [('a', '<f8')]; expected"),
    "complex numbers": ("block(npy(descr=\"'<c16'\", content=bytes(320)))", "of type <c16"),
    "letters": ("block(npy(descr=\"'<U1'\", content=bytes(80)))", "of type <U1"),
    "big-endian numbers": ("block(npy(descr=\"'>f8'\"))", "of type >f8"),
    "another shape": (
        "block(npy(shape='(1, 10, 3)', content=bytes(240)))",
        "of shape (1, 10, 3); expected (1, 10, 2)",
    ),
    "fewer axes": ("block(npy(shape='(20,)'))", "expected (1, 10, 2)"),
    "axes without end": ("block(npy(shape='(' + '10,' * 999 + ')'))", "expected (1, 10, 2)"),
    "negative sizes": ("block(npy(shape='(-10, -10, 2)'))", "header cannot be read"),
    "sizes that are no integers": ("block(npy(shape='(10, 10, True)'))", "header cannot be read"),
    "Fortran's order": ("block(npy(order='True'))", "Fortran order"),
    "gigabytes in the header": (
        "block(npy(shape='(1000000000, 10, 2)'), announced=160 * 10**9)",
        "of shape (1000000000, 10, 2)",
    ),
    "gigabytes in the length": ("block(npy(), announced=2**63)", "9,223,372,036,854,775,808 bytes"),
    "fewer bytes than it says": ("block(npy(content=bytes(8)))", "their shape makes"),
    "more bytes than it says": ("block(npy(content=bytes(16000)))", "their shape makes"),
    "a header without end": (
        r"block(b'\x93NUMPY\x01\x00\xff\xff' + b' ' * 70000)",
        ".npy header is 65,535 bytes long",
    ),
    "a header that is code": (
        """block(npy(shape='__import__("os").system("false")'))""",
        "header cannot be read",
    ),
    "a header that nests": ("block(npy(shape='(' * 1500 + ')' * 1500))", "header cannot be read"),
    "another version of .npy": ("block(npy().replace(b'Y' + bytes([1]), b'Y' + bytes([2])))", "version 1.0"),
    "nothing": ("block(b'')", "no .npy array (0 bytes)"),
}


def silence(text: str) -> str:
    """The same, and then nothing more."""
    return f"introduce(); request(); draws(); {text}; time.sleep(60)"


@pytest.mark.parametrize("name", BEFORE)
def test_what_is_no_introduction_is_refused(attack: Callable[..., Any], name: str) -> None:
    program, reason = BEFORE[name]
    assert re.search(reason, attack(f"{program}; time.sleep(60)", speaks=True).reason)


@pytest.mark.parametrize("name", AFTER)
def test_what_are_no_draws_is_refused(attack: Callable[..., Any], name: str) -> None:
    program, reason = AFTER[name]
    assert reason in attack(silence(program), speaks=True).reason


@pytest.mark.parametrize(
    "answer",
    [
        "arrays='draws'",
        "arrays=['draws', 'draws']",
        "arrays=[['draws']]",
        "arrays=None",
        "arrays=['draws'] * 5000",
    ],
)
def test_a_header_with_other_arrays_is_refused(attack: Callable[..., Any], answer: str) -> None:
    done = attack(f"introduce(); request(); say(answer='sample', {answer}); time.sleep(60)", speaks=True)
    assert "answered something else than sample" in done.reason
    assert len(done.reason) < 300


def test_a_second_answer_is_not_taken_for_the_next(attack: Callable[..., Any]) -> None:
    done = attack("introduce(); request(); draws(); block(npy()); introduce()", speaks=True)
    assert "answered something else than sample" in done.reason


@pytest.mark.parametrize("content", ["nan", "inf", "-inf"])
def test_numbers_that_are_none_are_counted_and_fail(attack: Callable[..., Any], content: str) -> None:
    numbers = f"struct.pack('<d', float('{content}')) * 20"
    program = f"introduce()\nfor _ in range(10): request(); draws(); block(npy(content={numbers}))\nrequest()"
    done = attack(program, speaks=True)
    assert done.code == 1, done
    assert re.search("FAIL +draws.finite: NaN or infinite: 100 draws", done.stdout)
