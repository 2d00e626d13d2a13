"""Files from elsewhere: nothing is read but they themselves, and no more of them than they may hold."""

from __future__ import annotations

import gzip
import io
import json
import os
import pickle
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

import gaugeblock as gb
from gaugeblock.auditing.config import read_config
from gaugeblock.auditing.trials_from import any_trials
from gaugeblock.core import foreign
from gaugeblock.core.errors import InputError
from gaugeblock.core.hdf5 import Limits, check_hdf5
from gaugeblock.validate import read_trials
from gaugeblock.validate.storage import read_groups

Hostile = Callable[[str], Path]


def refused(path: Path, words: str) -> None:
    """In one line that names the file, and soon."""
    begun = time.perf_counter()
    with pytest.raises(InputError, match=words) as caught:
        any_trials(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert time.perf_counter() - begun < 5


@pytest.mark.attack("trials with HDF5 external storage: another file's bytes as data", "refused, exit 2")
def test_external_storage_from_the_command_line(hostile: Hostile, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "gaugeblock", "audit", "--trials", str(hostile("external"))]
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "out"), "--quiet"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    assert "reads from other files (external storage)" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out" / "trials.nc").exists()


@pytest.mark.attack("trials with an HDF5 virtual dataset over another file", "refused, exit 2")
def test_a_virtual_dataset(hostile: Hostile) -> None:
    refused(hostile("virtual"), "virtual dataset")


@pytest.mark.attack("trials with an HDF5 external link, in a small group or a large one", "refused, exit 2")
@pytest.mark.parametrize("name", ["link", "dense"])
def test_a_link_out_of_the_file(hostile: Hostile, name: str) -> None:
    refused(hostile(name), "external link")


@pytest.mark.attack("a compressed chunk that inflates to gigabytes", "refused, exit 2")
def test_a_chunk_that_inflates_without_end(hostile: Hostile) -> None:
    refused(hostile("bomb"), "inflates to more than its values")


def test_what_the_walk_does_not_know_is_refused(hostile: Hostile) -> None:
    refused(hostile("filter"), "zlib alone")
    refused(hostile("latest"), "layout 4")
    refused(hostile("userblock"), "not NetCDF")


def test_sound_files_and_links_inside_them_pass(hostile: Hostile) -> None:
    for name in ("sound", "soft"):
        assert any_trials(hostile(name)).sizes["trial"] == 12


def test_a_group_of_many_members_is_walked_to_the_last(tmp_path: Path) -> None:
    with netCDF4.Dataset(tmp_path / "many.nc", "w") as file:
        for k in range(300):
            file.createGroup(f"group_{k:04d}").createDimension("d", k + 1)
    check_hdf5(tmp_path / "many.nc")
    with pytest.raises(InputError, match="more than 300 objects"):
        check_hdf5(tmp_path / "many.nc", Limits(objects=300))


@pytest.mark.attack("a NetCDF file of 10 kB that declares gigabytes", "refused at once, exit 2")
def test_a_small_file_that_declares_gigabytes(tmp_path: Path) -> None:
    with netCDF4.Dataset(tmp_path / "huge.nc", "w") as file:
        for name, size in (("trial", 200_000), ("draw", 1000), ("parameter", 2)):
            file.createDimension(name, size)
        file.createVariable("theta_true", "f8", ("trial", "parameter"), zlib=True)
        file.createVariable("draws", "f8", ("trial", "draw", "parameter"), zlib=True)
    refused(tmp_path / "huge.nc", r"declares 3\.2 GB of values in a file of")


def test_as_many_values_as_are_allowed_may_be_declared_and_not_a_byte_more(tmp_path: Path) -> None:
    with netCDF4.Dataset(tmp_path / "two.nc", "w") as file:
        file.createDimension("long", 1000)
        file.createDimension("short", 30)
        file.createVariable("wide", "f8", ("long", "short"), contiguous=True)
        file.createVariable("narrow", "i2", ("long",), zlib=True)

    # The two arrays, and the two dimensions, which are arrays of four bytes a value.
    declared = 1000 * 30 * 8 + 1000 * 2 + (1000 + 30) * 4
    check_hdf5(tmp_path / "two.nc", Limits(size=declared))
    with pytest.raises(InputError, match="values in a file of"):
        check_hdf5(tmp_path / "two.nc", Limits(size=declared - 1))


@pytest.mark.attack("arrays of too many axes, texts without number", "refused, exit 2")
def test_axes_and_texts(tmp_path: Path) -> None:
    with netCDF4.Dataset(tmp_path / "axes.nc", "w") as file:
        names = [f"d{k}" for k in range(9)]
        for name in names:
            file.createDimension(name, 1)
        file.createVariable("x", "f8", names)
    refused(tmp_path / "axes.nc", "9 axes; 8 are the most")
    with netCDF4.Dataset(tmp_path / "texts.nc", "w") as file:
        file.createDimension("parameter", 20_000)
        file.createVariable("parameter", str, ("parameter",))
    refused(tmp_path / "texts.nc", "20,000 texts")


def _classic(path: Path) -> xr.Dataset:
    rng = np.random.default_rng(1)
    trials = xr.Dataset(
        {
            "theta_true": (("trial", "parameter"), rng.normal(size=(40, 2))),
            "draws": (("trial", "draw", "parameter"), rng.normal(size=(40, 30, 2))),
        },
        coords={"parameter": ["a", "b"]},
    )
    trials.to_netcdf(path, engine="scipy")
    return trials


def test_the_classic_kind_is_read_by_a_reader_of_its_own(tmp_path: Path) -> None:
    written = _classic(tmp_path / "classic.nc")
    read = read_groups(tmp_path / "classic.nc", what="Trials")[""]
    assert read["draws"].values == pytest.approx(written["draws"].values, rel=0, abs=0)
    assert [str(name) for name in read["parameter"].values] == ["a", "b"]
    assert gb.audit_draws(tmp_path / "classic.nc", progress=False).trials["draws"].shape == (40, 30, 2)


@pytest.mark.attack("classic NetCDF cut off, or that declares gigabytes", "refused, exit 2")
def test_a_classic_file_holds_no_more_than_there_is(tmp_path: Path) -> None:
    _classic(tmp_path / "classic.nc")
    content = (tmp_path / "classic.nc").read_bytes()
    for length in (5, 60, 200, len(content) // 2):
        (tmp_path / "cut.nc").write_bytes(content[:length])
        refused(tmp_path / "cut.nc", "cannot be read as NetCDF")
    declared = content.index(b"trial") + 8
    huge = content[:declared] + (2**31 - 1).to_bytes(4, "big") + content[declared + 4 :]
    (tmp_path / "huge.nc").write_bytes(huge)
    refused(tmp_path / "huge.nc", "cannot be read as NetCDF")


@pytest.mark.attack("a NetCDF file cut off, or with any byte changed", "refused, or read as what it says")
def test_flipped_bytes_of_the_structure_end_in_one_line(hostile: Hostile, tmp_path: Path) -> None:
    sound = hostile("sound").read_bytes()
    changed = tmp_path / "changed.nc"
    rng = np.random.default_rng(20)
    for cut in rng.integers(0, len(sound), 20):
        changed.write_bytes(sound[: int(cut)])
        with pytest.raises(InputError):
            check_hdf5(changed)
    for place in rng.integers(0, len(sound), 400):
        copy = bytearray(sound)
        copy[place] ^= 1 << int(rng.integers(8))
        changed.write_bytes(copy)
        with suppress(InputError):
            check_hdf5(changed)


@pytest.mark.attack("a pipe, a device or a folder in a file's place", "refused at once, exit 2")
def test_what_is_no_file_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for place in (tmp_path / "pipe", Path("/dev/zero"), tmp_path):
        with pytest.raises(InputError, match=r"not a file|Is a directory"):
            foreign.read_bytes(place, most=foreign.MB)
    with pytest.raises(InputError, match="not a file"):
        read_trials(tmp_path / "pipe")


@pytest.mark.attack("an .npz that inflates to gigabytes, or declares them", "refused, exit 2")
def test_arrays_that_are_larger_than_they_may(tmp_path: Path) -> None:
    path = tmp_path / "zeros.npz"
    np.savez_compressed(path, draws=np.zeros(1_000_000))
    assert path.stat().st_size < 20_000
    with pytest.raises(InputError, match="inflates to more than 1 MB"):
        foreign.read_arrays(path, most=foreign.MB)
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        head, {"descr": "<f8", "fortran_order": False, "shape": (1 << 40, 1 << 20)}
    )
    with zipfile.ZipFile(tmp_path / "shape.npz", "w") as archive:
        archive.writestr("draws.npy", head.getvalue() + bytes(64))
        archive.writestr("theta_true.npy", head.getvalue() + bytes(64))
    refused(tmp_path / "shape.npz", "more than there is")


class Harmful:
    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, ("it-ran",)


@pytest.mark.attack("a pickle in an .npz or .npy", "refused, never loaded, exit 2")
def test_pickles_are_never_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    np.savez(tmp_path / "p.npz", draws=np.array([Harmful()], dtype=object), theta_true=np.zeros((1, 1)))
    refused(tmp_path / "p.npz", "Python objects")
    (tmp_path / "p.npy").write_bytes(pickle.dumps(Harmful()))
    with pytest.raises(InputError, match="cannot be read as a NumPy array"):
        foreign.read_array(tmp_path / "p.npy")
    assert not (tmp_path / "it-ran").exists()


@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_are_read_as_numpy_wrote_them(tmp_path: Path, order: str) -> None:
    given = {
        "a": np.asarray(np.arange(24.0).reshape(2, 3, 4), order=order),  # type: ignore[call-overload]
        "names": np.array(["a", "bc"]),
        "empty": np.empty((0, 3)),
        "scalar": np.array(3.0, dtype=">f4"),
    }
    np.savez(tmp_path / "a.npz", **given)
    found = foreign.read_arrays(tmp_path / "a.npz")
    for name, array in given.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype


def gzipped(path: Path, megabytes: int) -> Path:
    """A gzip file of zeros, one member for each 16 MB."""
    path.write_bytes(gzip.compress(bytes(16 << 20), 9) * (megabytes // 16))
    return path


@pytest.mark.attack("a spectrum (.pha.gz) that inflates to gigabytes", "refused in seconds, exit 2")
def test_a_spectrum_that_inflates_to_gigabytes(tmp_path: Path) -> None:
    pytest.importorskip("astropy")
    from gaugeblock.simulators.xray.pha import load_pha

    path = gzipped(tmp_path / "s.pha.gz", 4096)
    assert path.stat().st_size < 5_000_000
    begun = time.perf_counter()
    with pytest.raises(InputError, match=r"s\.pha\.gz: inflates to more than 256 MB"):
        load_pha("PHA", path)
    assert time.perf_counter() - begun < 5


def test_gzip_in_several_parts_cut_and_damaged() -> None:
    parts = gzip.compress(b"one ") + gzip.compress(b"two") + b"\0" * 5
    assert foreign.inflated(io.BytesIO(parts), most=100) == b"one two"
    with pytest.raises(InputError, match="truncated"):
        foreign.inflated(io.BytesIO(parts[:30]), most=100)
    with pytest.raises(InputError, match="damaged"):
        foreign.inflated(io.BytesIO(parts[:12] + b"\xff\xff" + parts[14:]), most=100)
    with pytest.raises(InputError, match="more than 0 MB"):
        foreign.inflated(io.BytesIO(parts), most=6)
    assert foreign.inflated(io.BytesIO(parts), most=7) == b"one two"


@pytest.mark.attack("TOML or JSON of any depth or length", "refused in one line, exit 2")
def test_configurations_without_end(tmp_path: Path) -> None:
    path = tmp_path / "deep.toml"
    path.write_text("a = " + "[" * 100_000)
    with pytest.raises(InputError, match=r"deep\.toml"):
        read_config(path)
    path.write_text("a = 1\n" * 1_000_000)
    with pytest.raises(InputError, match="larger than 4 MB"):
        read_config(path)
    path.write_text("[" * 100_000)
    with pytest.raises(InputError, match=r"not valid JSON"):
        foreign.read_json(path)


@pytest.mark.attack("a model folder that describes gigabytes of network", "refused, not built, exit 2")
@pytest.mark.parametrize("change", [{"embedding": [400_000, 400_000]}, {"transforms": 10_000_000}])
def test_a_model_larger_than_its_weights(tmp_path: Path, change: dict[str, object]) -> None:
    pytest.importorskip("sbi")
    from gaugeblock.estimators.npe import load, reference_model_path

    shipped = reference_model_path("epic-pn-medium")
    for name in ("model.json", "model.safetensors"):
        (tmp_path / name).write_bytes((shipped / name).read_bytes())
    said = json.loads((tmp_path / "model.json").read_text())
    said["network"] |= change
    (tmp_path / "model.json").write_text(json.dumps(said))
    with pytest.raises(InputError, match=r"larger than its weights|do not fit together"):
        load(tmp_path)
