"""Tables of one file: each has coordinates of its own, and nothing is left of one that cannot be written."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from studies.kit.results import read, read_groups, write


def test_groups_keep_coordinates_that_the_root_has_otherwise(tmp_path):
    root = xr.Dataset({"z": ("case", [1.0, 2.0])}, coords={"case": ["first", "second"]}, attrs={"seed": 3})
    more = xr.Dataset({"value": ("case", np.arange(3))}, coords={"case": ["a", "b", "c"]})
    none = xr.Dataset(coords={"case": []})
    write({"": root, "profiles": more, "marginal": none}, tmp_path / "new" / "made.nc")
    stored = tmp_path / "new" / "made.nc"
    assert read(stored).identical(root)
    assert read(stored, "profiles").identical(more)
    assert read(stored, "marginal").sizes == {"case": 0}
    assert set(read_groups(stored)) == {"", "profiles", "marginal"}


def test_a_file_that_cannot_be_written_leaves_what_was_there(tmp_path):
    root = xr.Dataset({"z": ("case", [1.0, 2.0])})
    write({"": root}, tmp_path / "made.nc")
    wrong = xr.Dataset({"z": ("case", np.array([{}, []], dtype=object))})
    with pytest.raises((TypeError, ValueError)):
        write({"": root + 1, "wrong": wrong}, tmp_path / "made.nc")
    assert read(tmp_path / "made.nc").identical(root)
    assert [path.name for path in tmp_path.iterdir()] == ["made.nc"]
