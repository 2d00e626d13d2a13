from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from gaugeblock.validate.storage import CHUNK_CACHE, read_groups, read_tree, write_groups, write_tree


def test_several_threads_may_write_and_read_at_once(tmp_path: Path) -> None:
    """The libraries below are not made for it, and end the process."""

    def both(number: int) -> bool:
        rows = np.random.default_rng(number).random((50, 40))
        whole = xr.Dataset({"draws": (("trial", "draw"), rows)})
        parts = (whole.isel(trial=slice(k, k + 10)) for k in range(0, 50, 10))
        write_groups({"": parts}, tmp_path / f"{number}.nc")
        return read_groups(tmp_path / f"{number}.nc", what="Trials")[""].identical(whole)

    with ThreadPoolExecutor(8) as threads:
        assert all(threads.map(both, range(60)))


def test_what_is_not_made_smaller_is_not_compressed(tmp_path: Path) -> None:
    """A second of zlib for 40 MB of random bits was spent on 4% of them."""
    netCDF4 = pytest.importorskip("netCDF4")
    rng = np.random.default_rng(1)
    # The first channels of a spectrum are often empty, and of draws some are NaN.
    draws = rng.normal(size=(50, 40, 3))
    draws[0, ::2] = np.nan
    counts = np.zeros((50, 400))
    counts[:, 100:] = rng.poisson(7, size=(50, 300))
    whole = xr.Dataset(
        {
            "draws": (("trial", "draw", "parameter"), draws),
            "counts": (("trial", "channel"), counts),
            "block": ("trial", np.arange(50)),
            "nothing": (("trial", "none"), np.empty((50, 0))),
            "single": (("trial", "draw"), draws[..., 0].astype(np.float32)),
        }
    )
    write_groups({"": whole}, tmp_path / "a.nc")
    assert read_groups(tmp_path / "a.nc", what="Trials")[""].identical(whole)
    with netCDF4.Dataset(tmp_path / "a.nc") as file:
        said = {name: variable.filters()["zlib"] for name, variable in file.variables.items()}
    assert said == {"draws": False, "counts": True, "block": True, "nothing": False, "single": False}
    assert (tmp_path / "a.nc").stat().st_size < draws.nbytes + 0.3 * counts.nbytes + 20_000


def test_words_numbers_and_single_values_come_back_as_they_were(tmp_path: Path) -> None:
    """Words as NumPy and as pandas hold them; NaN and every integer, alone and in arrays."""
    words = ["a", "longer", "\N{GREEK SMALL LETTER SIGMA}"]
    whole = xr.Dataset(
        {
            "words": ("parameter", np.array(words)),
            "objects": ("parameter", np.array(words, dtype=object)),
            "numbers": ("parameter", np.array([np.nan, -np.inf, 9.969209968386869e36])),
            "integers": ("parameter", np.array([-(2**31) + 1, -1, 2**31 - 1], dtype=np.int32)),
            "truths": ("parameter", np.array([True, False, True])),
            "word": ((), "alone"),
            "number": ((), np.nan),
            "integer": ((), np.int64(-9223372036854775806)),
        }
    )
    write_groups({"": whole, "child": whole[["objects", "integers"]]}, tmp_path / "a.nc")
    groups = read_groups(tmp_path / "a.nc", what="Trials")
    assert groups[""].identical(whole)
    assert groups["child"].identical(whole[["objects", "integers"]])


def test_files_keep_little_of_what_was_read_and_others_their_own(tmp_path: Path, monkeypatch) -> None:
    """By default the library keeps 64 MiB of each variable: half a gigabyte, of a large audit."""
    netCDF4 = pytest.importorskip("netCDF4")
    before, seen = netCDF4.get_chunk_cache(), []
    read = xr.open_groups

    def parts():
        for start in (0, 10):
            seen.append(netCDF4.get_chunk_cache()[0])
            yield xr.Dataset({"draws": (("trial", "draw"), np.full((10, 3), float(start)))})

    def noted(*given, **more):
        seen.append(netCDF4.get_chunk_cache()[0])
        return read(*given, **more)

    monkeypatch.setattr(xr, "open_groups", noted)
    path = write_groups({"": parts()}, tmp_path / "trials.nc")
    assert read_groups(path, what="Trials")[""].sizes["trial"] == 20
    assert seen == [CHUNK_CACHE] * 3
    assert before[0] > CHUNK_CACHE
    assert netCDF4.get_chunk_cache() == before


def test_a_tree_comes_back_with_what_is_below_and_without_what_it_inherits(tmp_path: Path) -> None:
    tree = xr.DataTree.from_dict(
        {
            "/": xr.Dataset(coords={"channel": [1.5, 2.5]}, attrs={"what": "whole"}),
            "/scan": xr.Dataset({"z": ("channel", [0.0, 3.0])}),
            "/scan/deep": xr.Dataset({"name": ("row", ["a", "bc"])}, attrs={"what": "deep"}),
        }
    )
    path = write_tree(tree, tmp_path / "tree.nc")
    xr.testing.assert_identical(read_tree(path, what="tree"), tree)
    groups = read_groups(path, what="tree")
    assert set(groups) == {"", "scan", "scan/deep"}
    assert "channel" not in groups["scan"].variables
