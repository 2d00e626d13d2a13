"""What differs, in one line each."""

import math

import numpy as np
import pytest
import xarray as xr

from gaugeblock.auditing.compare import (
    NEAR,
    close,
    dataset_differences,
    excerpt,
    plain_differences,
    same_text,
    shortened,
    text_differences,
)


def test_comparing_plain_data() -> None:
    assert list(plain_differences([1, 2], [1])) == [" has 2 entries, should have 1"]
    assert list(plain_differences({"a": 1}, {"a": True})) == ["a is 1, should be True"]
    assert list(plain_differences({"a": None, "c": 1}, {"a": 0, "b": 1})) == [
        "a is None, should be 0",
        "b is missing",
        "c should not be there",
    ]
    ids = [{"id": "a"}, {"id": "b"}]
    assert list(plain_differences({"x": ids}, {"x": ids[::-1]})) == ["x is in another order"]


def test_comparing_texts() -> None:
    assert list(text_differences(b"a 1.25\n", b"a 1.26\n", near=NEAR)) == []
    assert list(text_differences(b"a 1.25\n", b"a 1.27\n", near=NEAR)) == [
        "line 1 is 'a 1.25', should be 'a 1.27'"
    ]
    assert list(text_differences(b"12 gates\n", b"13 gates\n", near=NEAR)) != []
    assert list(text_differences(b"a\r\n", b"a\n")) == ["line 1 is 'a\r', should be 'a'"]
    assert list(text_differences(b"a\nb\nc\n", b"a\nc\n")) == ["line 2: 'b' should not be there"]
    assert list(text_differences(b"a\nc\nd\n", b"a\nX\n")) == ["line 2 is 'c', should be 'X'"]


def test_comparing_datasets() -> None:
    stored = xr.Dataset({"a": ("trial", [1.0, np.nan, 3.0]), "b": ((), 1)}, attrs={"claim": "words"})
    assert list(dataset_differences(stored, stored)) == []
    nearly = stored.assign(a=stored["a"] * (1 + 1e-9))
    assert list(dataset_differences(nearly, stored, near=NEAR)) == []
    assert "(and 1 more of its 3 values)" in next(dataset_differences(nearly, stored))
    assert list(dataset_differences(stored.drop_vars("b"), stored)) == ["b is missing"]
    assert list(dataset_differences(stored.assign(c=1), stored)) == ["c should not be there"]
    shorter = stored.isel(trial=slice(2))
    assert list(dataset_differences(shorter, stored)) == [
        "a is float64 {'trial': 2}, should be float64 {'trial': 3}"
    ]
    assert list(dataset_differences(stored.assign_attrs(claim="other"), stored)) == [
        "claim is 'other', should be 'words'"
    ]


def test_an_excerpt_shows_where_it_differs() -> None:
    long = "a" * 200
    assert excerpt(long + "X", long + "Y").endswith("X'")
    assert excerpt(long) == f"'{'a' * 60}…'"


def test_numbers_are_near_by_the_larger_and_never_by_less_than_a_millionth() -> None:
    for stored, derived, near in ((100.0, 110.0, 0.0909), (-110.0, -100.0, 0.0909), (0.0, 1e-7, 0.09999)):
        for one, other in ((stored, derived), (derived, stored)):
            assert not close(one, other, near)
            assert close(one, other, near * 1.0002)
    assert not close(1.0, math.nan, 1.0)
    assert close(math.inf, math.inf, 0.0)
    assert not close(1.0, 1.0 + 1e-15, 0.0)


@pytest.mark.parametrize(
    ("stored", "derived", "lines"),
    [
        ({"a": {"b": [1, {"c": 2}]}}, {"a": {"b": [1, {"c": 3}]}}, ["a.b[1].c is 2, should be 3"]),
        (
            [{"id": "a", "p": 1}, {"id": "b"}],
            [{"id": "a", "p": 2}, {"id": "c"}],
            ["[a].p is 1, should be 2", "[c] is missing", "[b] should not be there"],
        ),
        ({"x": [{"id": "a"}] * 2}, {"x": [{"id": "a"}]}, ["x has 2 entries, should have 1"]),
        ({"x": [{"id": 1}]}, {"x": [{"id": 2}]}, ["x[0].id is 1, should be 2"]),
        ({"x": []}, {"x": [{"id": "a"}]}, ["x has 0 entries, should have 1"]),
        ({"x": 1.0}, {"x": 1}, []),
        ({"x": True}, {"x": True}, []),
        ({"x": True}, {"x": 1}, ["x is True, should be 1"]),
        ({"x": "a"}, {"x": None}, ["x is 'a', should be None"]),
        ({"x": (1,)}, {"x": [1]}, ["x is (1,), should be [1]"]),
        ({"x": "a" * 99}, {"x": {}}, [f"x is '{'a' * 58}…, should be {{}}"]),
        ({"x": "a" * 58}, {"x": {}}, [f"x is '{'a' * 58}', should be {{}}"]),
        ({"x": "one"}, {"x": "two"}, ["x is 'one', should be 'two'"]),
        ({3: 1}, {3: 2}, ["3 is 1, should be 2"]),
    ],
)
def test_every_difference_has_its_place(stored: object, derived: object, lines: list[str]) -> None:
    assert list(plain_differences(stored, derived)) == lines


def test_nearness_holds_at_any_depth() -> None:
    stored, derived = (
        {"a": [{"id": "b", "p": 0.5 + x, "says": f"p = 0.50{n}"}]} for x, n in ((0, 0), (1e-9, 1))
    )
    assert len(list(plain_differences(stored, derived))) == 2
    assert list(plain_differences(stored, derived, near=NEAR)) == []


@pytest.mark.parametrize(
    ("stored", "derived", "same"),
    [
        ("p 1,234.5 a", "p 1,234.6 a", True),
        ("p 1,234.5 a", "p 1,234.7 a", False),
        ("p 1.5e-07", "p 1.6e-07", True),
        ("p 1.5e-07", "p 1.7e-07", False),
        ("p 1.5e-07", "p 1.5e-06", False),
        ("p \N{MINUS SIGN}0.12", "p -0.13", True),
        ("p \N{MINUS SIGN}0.12", "p 0.12", False),
        ("p 12", "p 13", False),
        ("p 1.25 b", "p 1.25 c", False),
        ("p 1.2 1.3", "p 1.3 1.5", False),
    ],
)
def test_texts_are_the_same_but_for_a_last_digit(stored: str, derived: str, same: bool) -> None:
    assert same_text(stored, derived, near=NEAR) is same
    assert same_text(derived, stored, near=NEAR) is same
    assert not same_text(stored, derived, near=0.0)


def test_the_last_digit_is_that_of_what_is_derived() -> None:
    assert same_text("p 0.123", "p 0.12", near=NEAR)
    assert not same_text("p 0.12", "p 0.123", near=NEAR)
    assert same_text("p 1.26e-3", "p 1.3e-3", near=NEAR)
    assert not same_text("p 1.3e-3", "p 1.26e-3", near=NEAR)


def test_arrays_tell_the_first_and_how_many_more() -> None:
    def lines(one: object, other: object, near: float = 0.0) -> list[str]:
        return list(
            dataset_differences(*(xr.Dataset({"a": ("t", each)}) for each in (one, other)), near=near)
        )

    numbers = np.arange(2000.0)
    assert lines(numbers, numbers + (numbers == 3)) == ["a is 3.0, should be 4.0"]
    assert lines(numbers, numbers + (numbers >= 998)) == [
        "a is 998.0, should be 999.0 (and 1,001 more of its 2,000 values)"
    ]
    assert lines(np.array([1.0, np.nan]), np.array([np.nan, np.nan])) == ["a is 1.0, should be nan"]
    assert lines(np.array([100.0]), np.array([110.0]), 0.0909) == ["a is 100.0, should be 110.0"]
    for sign in (1.0, -1.0):
        assert lines(np.array([sign * 100.0]), np.array([sign * 110.0]), 0.091) == []
        assert lines(np.array([sign * 110.0]), np.array([sign * 100.0]), 0.091) == []
    assert lines(np.array([0.0]), np.array([1e-7]), 0.101) == []
    assert len(lines(np.array([0.0]), np.array([1e-7]), 0.099)) == 1
    assert lines(np.array(["a", "b"]), np.array(["a", "c"])) == ["a is b, should be c"]
    assert lines(np.array([1, 2]), np.array([1, 3]), 1.0) == ["a is 2, should be 3"]
    assert lines(np.array([1, 2]), np.array([1.0, 2.0])) == [
        "a is int64 {'t': 2}, should be float64 {'t': 2}"
    ]
    for attribute in (np.array([1, 2]), np.int64(3)):
        stored = xr.Dataset(attrs={"k": attribute})
        assert list(dataset_differences(stored, xr.Dataset(attrs={"k": attribute.tolist()}))) == []


def test_lines_of_texts_that_are_missing_or_too_many() -> None:
    derived = b"".join(b"line %d\n" % k for k in range(9))
    for stored, lines in (
        (derived.replace(b"line 4\n", b""), ["line 5: 'line 4' is missing"]),
        (derived.replace(b"line 4\n", b"line 4\nmore\n"), ["line 6: 'more' should not be there"]),
        (derived.replace(b"line 4\n", b"one\ntwo\n"), ["line 5 is 'one', should be 'line 4'"]),
        (derived.replace(b"line 4", b"other"), ["line 5 is 'other', should be 'line 4'"]),
        (derived, []),
    ):
        assert list(text_differences(stored, derived)) == lines
    assert list(text_differences(b"a\xff\n", b"a\xfe\n")) == ["other bytes, the same text"]
    assert list(text_differences(b"a\xff\n", b"a\xfe\n", near=NEAR)) == []
    assert list(text_differences(b"a 1.2\nb\nd", b"a 1.3\nb\nc\nd", near=NEAR)) == ["line 3: 'c' is missing"]


def test_where_an_excerpt_begins() -> None:
    letters = "".join(chr(ord("a") + k % 26) for k in range(100))
    assert excerpt(letters[:60]) == f"'{letters[:60]}'"
    assert excerpt(letters[:61]) == f"'{letters[:60]}…'"
    assert excerpt(letters, letters[:50] + "X") == f"'…{letters[30:90]}…'"
    assert excerpt(letters, letters[:70] + "X") == f"'…{letters[50:]}'"
    assert excerpt(letters, letters[:20] + "X") == f"'{letters[:60]}…'"
    assert excerpt(letters, letters[:21] + "X") == f"'…{letters[1:61]}…'"
    assert excerpt("ab\n", "ac") == "'ab'"


def test_ten_lines_and_how_many_more() -> None:
    lines = [str(k) for k in range(2011)]
    assert shortened(lines[:10]) == lines[:10]
    assert shortened(lines[:11]) == [*lines[:10], "and 1 more"]
    assert shortened(lines) == [*lines[:10], "and 2,001 more"]
