"""Trials from files of NumPy's and of xarray's, and from what is in memory."""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import xarray as xr

from gaugeblock import make_trials, write_trials
from gaugeblock.auditing.trials_from import any_trials
from gaugeblock.core.errors import InputError
from gaugeblock.validate.trials import trials_tree

RNG = np.random.default_rng(1)
THETA, DRAWS, X = RNG.normal(size=(4, 2)), RNG.normal(size=(4, 6, 2)), RNG.normal(size=(4, 3))
FURTHER: dict[str, Any] = {
    "x": X,
    "log_q": RNG.normal(size=(4, 6)),
    "log_likelihood": RNG.normal(size=(4, 6)),
    "log_prior": RNG.normal(size=(4, 6)),
    "log_q_true": RNG.normal(size=4),
    "log_likelihood_true": RNG.normal(size=4),
    "log_prior_true": RNG.normal(size=4),
    "weight": RNG.random(size=(4, 6)),
}


@pytest.mark.parametrize(
    ("held", "names", "wanted"),
    [
        ({}, None, ["theta_1", "theta_2"]),
        ({"names": ["a", "b"]}, None, ["a", "b"]),
        ({"parameter": ["a", "b"]}, None, ["a", "b"]),
        ({"parameter": ["c", "d"], "names": [["a"], ["b"]]}, None, ["a", "b"]),
        ({"names": ["a", "b"]}, ["e", "f"], ["e", "f"]),
    ],
)
def test_arrays_by_name(tmp_path: Path, held: dict[str, Any], names: Any, wanted: list[str]) -> None:
    path = tmp_path / "t.npz"
    np.savez(path, theta_true=THETA, draws=DRAWS, **FURTHER, **held)
    found = any_trials(str(path), names=names).to_dataset()
    xr.testing.assert_identical(found, make_trials(THETA, DRAWS, wanted, **FURTHER))


def test_arrays_that_are_missing_or_none_of_ours(tmp_path: Path) -> None:
    path = tmp_path / "t.npz"
    how = (
        "save theta_true (trial, parameter) and draws (trial, draw, parameter) with numpy.savez, and where "
        "you have them x, log_q, log_likelihood, log_prior, log_q_true, log_likelihood_true, log_prior_true, "
        "weight and names"
    )
    for arrays, what in (
        ({"theta_true": THETA}, "no array draws"),
        ({"wieght": X}, "no array draws"),
        ({"draws": DRAWS}, "no array theta_true"),
        ({"theta_true": THETA, "draws": DRAWS, "wieght": X}, "an array wieght that is none of ours"),
    ):
        np.savez(path, **arrays)
        with pytest.raises(InputError) as caught:
            any_trials(path)
        assert str(caught.value) == f"{path}: {what}; {how}"


def test_arrays_of_h5py_have_no_axes_and_go_by_place(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    arrays = {"theta_true": THETA, "draws": DRAWS, **FURTHER}
    with h5py.File(tmp_path / "t.h5", "w") as file:
        for name, values in arrays.items():
            file.create_dataset(name, data=values, compression="gzip")
        file["names"] = ["a", "b"]
    made = any_trials(tmp_path / "t.h5")
    assert made["parameter"].values.tolist() == ["a", "b"]
    for name, values in arrays.items():
        np.testing.assert_array_equal(made[name].values, values)
    assert any_trials(tmp_path / "t.h5", names=["c", "d"])["parameter"].values.tolist() == ["c", "d"]
    # Where one has names and another none, nothing is guessed.
    with h5py.File(tmp_path / "half.h5", "w") as file:
        for name, axes in {"theta_true": ("trial", "parameter"), "draws": ()}.items():
            file[name] = arrays[name]
            for at, axis in enumerate(axes):
                file[axis] = np.arange(arrays[name].shape[at])
                file[axis].make_scale(axis)
                file[name].dims[at].attach_scale(file[axis])
    with pytest.raises(InputError, match=r"draws has the axes .*phony_dim_\d.*; it needs"):
        any_trials(tmp_path / "half.h5")
    with h5py.File(tmp_path / "t.h5", "a") as file:
        file["wieght"] = X
    with pytest.raises(InputError, match=r"t\.h5: an array wieght that is none of ours; save theta_true"):
        any_trials(tmp_path / "t.h5")


@pytest.mark.parametrize("name", ["draws.npy", "draws.csv", "DRAWS.PT"])
def test_files_of_other_formats_are_told_how_to_be_saved(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.write_bytes(b"1, 2, 3")
    with pytest.raises(InputError, match=r"NetCDF, and .npz; save theta_true .* with numpy.savez$"):
        any_trials(path)
    with pytest.raises(InputError, match="no such file"):
        any_trials(tmp_path / f"no-{name}")


def test_an_ending_is_no_reason_to_refuse_trials(tmp_path: Path) -> None:
    for name in ("draws", "draws.h5", "draws.hdf5", "draws.nc4"):
        write_trials(make_trials(THETA, DRAWS), tmp_path / name)
        np.testing.assert_array_equal(any_trials(tmp_path / name)["draws"].values, DRAWS)


def test_what_is_in_memory_stays_what_it_is(tmp_path: Path) -> None:
    made = make_trials(THETA, DRAWS, ["a", "b"], x=X)
    tree = trials_tree(made)
    assert any_trials(tree) is tree
    for held in (made, make_trials(THETA, DRAWS, ["a", "b"])):
        xr.testing.assert_identical(any_trials(held).to_dataset(), held)
    with pytest.raises(InputError, match=r"^trials: "):
        any_trials(made.drop_vars("parameter").isel(parameter=0, drop=True))
    for path in (tmp_path / "t.nc", str(tmp_path / "t.nc")):
        write_trials(made, path)
        np.testing.assert_array_equal(any_trials(path)["draws"].values, DRAWS)


def test_our_own_trials_come_before_groups_of_arviz(tmp_path: Path) -> None:
    """A file of both kinds is ours: audits put a group `posterior` beside theirs."""
    made = make_trials(THETA, DRAWS, ["a", "b"])
    path = tmp_path / "both.nc"
    write_trials(made, path)
    (made + 1).to_netcdf(path, mode="a", group="posterior", engine="netcdf4")
    np.testing.assert_array_equal(any_trials(path)["draws"].values, DRAWS)
    posterior = xr.Dataset({"a": (("trial", "draw"), DRAWS[..., 0] + 9)}, attrs={"a_true": THETA[:, 0]})
    posterior.to_netcdf(tmp_path / "one.nc", group="posterior", engine="netcdf4")
    np.testing.assert_array_equal(any_trials(tmp_path / "one.nc")["draws"].values[..., 0], DRAWS[..., 0] + 9)
    posterior.to_netcdf(tmp_path / "other.nc", group="elsewhere", engine="netcdf4")
    with pytest.raises(InputError, match=r"other\.nc") as caught:
        any_trials(tmp_path / "other.nc")
    assert "group posterior" not in str(caught.value)


def test_no_library_opens_a_file_before_it_was_walked_through(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hostile = Path(__file__).parents[2] / "trust" / "hostile" / "external.nc.gz"
    (tmp_path / "external.nc").write_bytes(gzip.decompress(hostile.read_bytes()))
    opened: list[Any] = []
    monkeypatch.setattr(netCDF4, "Dataset", lambda *given, **named: opened.append(given))
    with pytest.raises(InputError, match="external storage"):
        any_trials(tmp_path / "external.nc")
    assert opened == []
