"""What differs, in one line each."""

import numpy as np
import xarray as xr

from gaugeblock.auditing.compare import (
    NEAR,
    dataset_differences,
    excerpt,
    plain_differences,
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
    assert list(text_differences(b"a\r\n", b"a\n")) != []
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
