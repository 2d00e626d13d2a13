import io
import json
import re
from contextlib import suppress
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from gaugeblock.core.errors import InputError
from gaugeblock.stranger.wire import pack, plain, read_array, read_header


class Source:
    """Bytes to be read, and how far anybody ever read."""

    def __init__(self, content: bytes):
        self.content, self.at = content, 0

    def read(self, size: int, what: str) -> bytes:
        if self.at + size > len(self.content):
            raise InputError(f"{what}: at the end")
        self.at += size
        return self.content[self.at - size : self.at]


def framed(array: Any, **options: Any) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, **options)
    return len(buffer.getvalue()).to_bytes(8, "big") + buffer.getvalue()


numbers = arrays.arrays(
    st.sampled_from([np.dtype("<f8"), np.dtype("<i8")]),
    arrays.array_shapes(max_dims=4, max_side=5, min_side=0),
)


@settings(deadline=None, derandomize=True)
@given(numbers, st.dictionaries(st.text(max_size=5), st.integers(), max_size=3))
def test_what_is_packed_is_read_back(array: Any, header: dict[str, Any]) -> None:
    header.pop("arrays", None)
    source = Source(b"".join(pack({"request": "sample", **header}, {"x": array})))
    assert read_header(source.read) == {"request": "sample", **header, "arrays": ["x"]}
    np.testing.assert_array_equal(read_array(source.read, "x", array.shape), array.astype(float))
    assert source.at == len(source.content)


@settings(deadline=None, derandomize=True)
@given(st.binary(max_size=400))
def test_any_bytes_end_in_an_answer_or_in_an_input_error(content: bytes) -> None:
    for read in (lambda s: read_header(s.read), lambda s: read_array(s.read, "draws", (2, 3))):
        with suppress(InputError):
            read(Source(content))


@settings(deadline=None, derandomize=True)
@given(st.binary(max_size=120), st.integers(0, 127))
def test_any_bytes_in_an_array_end_in_an_array_of_the_shape_or_in_an_input_error(
    noise: bytes, at: int
) -> None:
    content = framed(np.arange(6.0).reshape(2, 3))
    content = content[: 8 + at] + noise + content[8 + at + len(noise) :]
    with suppress(InputError):
        assert read_array(Source(content).read, "draws", (2, 3)).shape == (2, 3)


@settings(deadline=None, derandomize=True)
@given(arrays.array_shapes(max_dims=3, max_side=4), arrays.array_shapes(max_dims=3, max_side=4))
def test_only_the_expected_shape_is_read(shape: tuple[int, ...], expected: tuple[int, ...]) -> None:
    source = Source(framed(np.zeros(shape)))
    if shape == expected:
        assert read_array(source.read, "draws", expected).shape == shape
    else:
        with pytest.raises(InputError, match=re.escape(f"of shape {shape}; expected {expected}")):
            read_array(source.read, "draws", expected)
        # The numbers themselves were left where they were.
        assert len(source.content) - source.at == 8 * np.prod(shape)


def test_a_free_axis_may_have_any_length() -> None:
    assert read_array(Source(framed(np.zeros((2, 7)))).read, "features", (2, None)).shape == (2, 7)
    assert read_array(Source(framed(np.zeros((0, 10**6)))).read, "features", (0, None)).shape == (0, 10**6)
    with pytest.raises(InputError, match=r"of shape \(0, 1000001\); expected \(0, any\)"):
        read_array(Source(framed(np.zeros((0, 10**6 + 1)))).read, "features", (0, None))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (framed(np.array([[{"a": 1}]], dtype=object)), "of type |O"),
        (framed(np.array([["words"]])), "of type <U5"),
        (framed(np.zeros((1, 1), dtype=">f8")), "of type >f8"),
        (framed(np.zeros((1, 1), dtype=[("a", "<f8")])), r"of type \[\('a'"),
        (framed(np.zeros((1, 1), dtype=complex)), "of type <c16"),
        (framed(np.asfortranarray(np.ones((2, 2)))), "in Fortran order"),
        ((10**18).to_bytes(8, "big") + framed(np.zeros((1, 1)))[8:], "of 1,000,000,000,000,000,000 bytes"),
        ((3).to_bytes(8, "big") + b"abc", "no .npy array"),
        ((100).to_bytes(8, "big") + b"\x80\x04" + b"x" * 98, "no .npy array of version"),
        ((100).to_bytes(8, "big") + b"\x93NUMPY\x01\x00\xff\xff" + b"x" * 90, "header is 65,535 bytes"),
    ],
)
def test_what_is_no_array_of_plain_numbers_is_named(content: bytes, says: str) -> None:
    with pytest.raises(InputError, match=says.replace("|", r"\|").replace("(1", r"\(1")):
        read_array(Source(content).read, "draws", (1, 1))


@pytest.mark.parametrize("shape", ["(10**30, 2)", "(-1, 2)", "(1.0, 2)", "(True, 2)", "[1, 2]", "'x'"])
def test_a_shape_that_is_none_is_refused(shape: str) -> None:
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}}}".encode().ljust(118) + b"\n"
    content = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text
    with pytest.raises(InputError, match=r"cannot be read|of shape"):
        read_array(Source(len(content).to_bytes(8, "big") + content).read, "draws", (1, 2))


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"\x00\x00\x00\x02[]", "no JSON object"),
        (b"\x00\x00\x00\x04what", "no JSON header"),
        (b"\x00\x00\x00\x02\xff\xfe", "no JSON header"),
        (b"\xff\xff\xff\xff", "announced a header of 4,294,967,295 bytes"),
        (b"\x00\x00\x00\x00", "announced a header of 0 bytes"),
        ((20000).to_bytes(4, "big") + b"[" * 20000, "no JSON"),
    ],
)
def test_a_header_that_is_none_is_refused(content: bytes, says: str) -> None:
    with pytest.raises(InputError, match=says):
        read_header(Source(content).read)


def test_words_of_a_stranger_move_no_cursor() -> None:
    assert plain("a\x1b[2Jb\r\nc\u202ed") == "a?[2Jb c?d"
    assert len(plain("x" * 10**6)) == 300
    assert json.loads(json.dumps(plain("\ud800"))) == "?"
