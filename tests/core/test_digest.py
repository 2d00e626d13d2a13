"""Digests are those that anybody can reckon: of JSON with sorted keys, of a file's bytes."""

import hashlib
from pathlib import Path

import pytest

from gaugeblock.core.digest import digest, file_digest
from gaugeblock.core.errors import InputError


def test_the_digest_is_of_json_with_sorted_keys() -> None:
    written = '{"a": [1, 2.5, null, true], "b": "/tmp/x"}'
    assert (
        digest({"b": Path("/tmp/x"), "a": (1, 2.5, None, True)})
        == hashlib.sha256(written.encode()).hexdigest()
    )
    assert digest([1, 2]) != digest([2, 1])


def test_the_digest_of_a_file_is_of_its_bytes(tmp_path: Path) -> None:
    content = bytes(range(256)) * 5000
    (tmp_path / "file").write_bytes(content)
    assert file_digest(tmp_path / "file") == hashlib.sha256(content).hexdigest()
    with pytest.raises(InputError, match=r"none: cannot be read \(No such file or directory\)$"):
        file_digest(tmp_path / "none")
