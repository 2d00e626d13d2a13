"""A seed that is kept: before anybody uses it, for its owner alone, and anew where it was cut off."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gaugeblock.auditing.kept_seed import kept_seed
from gaugeblock.core.errors import InputError


def test_it_is_on_the_disk_before_it_is_used_and_its_owners_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blocks made with a seed that a power cut takes away could never be joined by others."""
    path, sync, synced = tmp_path / "seeds" / "key.seed", os.fsync, []

    def noted(handle: int) -> None:
        sync(handle)
        assert os.fstat(handle).st_ino == path.stat().st_ino
        synced.append(path.read_text())

    monkeypatch.setattr(os, "fsync", noted)
    seed = kept_seed(path.parent, "key")
    assert synced == [str(seed)] == [path.read_text()]
    assert path.stat().st_mode & 0o777 == 0o600
    assert path.parent.stat().st_mode & 0o777 == 0o700
    assert kept_seed(path.parent, "key") == seed
    assert len(synced) == 1


def test_seeds_are_of_63_bits_and_no_two_are_alike(tmp_path: Path) -> None:
    """Of 40 the largest is below 2^62 once in 10^12 tests."""
    seeds = [kept_seed(tmp_path, f"run-{k}") for k in range(40)]
    assert len(set(seeds)) == 40
    assert 2**62 < max(seeds) < 2**63
    assert min(seeds) >= 0


@pytest.mark.parametrize("left", ["", "12x"])
def test_what_was_cut_off_is_made_anew(tmp_path: Path, left: str) -> None:
    (tmp_path / "key.seed").write_text(left)
    seed = kept_seed(tmp_path, "key")
    assert (tmp_path / "key.seed").read_text() == str(seed)
    assert kept_seed(tmp_path, "key") == seed


def test_where_nothing_can_be_written(tmp_path: Path) -> None:
    (tmp_path / "key.seed").mkdir()
    with pytest.raises(InputError) as caught:
        kept_seed(tmp_path, "key")
    assert str(caught.value).startswith(f"{tmp_path / 'key.seed'}: cannot be written (")
    assert "\n" not in str(caught.value)
