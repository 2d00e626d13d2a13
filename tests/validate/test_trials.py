from __future__ import annotations

import os

import numpy as np
import pytest
import xarray as xr

from gaugeblock.core.errors import InputError
from gaugeblock.validate import (
    check_trials,
    importance_trials,
    main_trials,
    make_trials,
    read_trials,
    trials_tree,
    write_trials,
)
from gaugeblock.validate.check import circular_parameters

NAMES = ["tbabs_1.nh", "angle"]


def trials(n: int = 6, draws: int = 9, **extra) -> xr.Dataset:
    rng = np.random.default_rng(n)
    counts = rng.poisson(3, size=(n, 4))
    return make_trials(rng.normal(size=(n, 2)), rng.normal(size=(n, draws, 2)), NAMES, x=counts, **extra)


def replaced(name: str, **change) -> xr.Dataset:
    """Trials with one array changed: `at` a position to `to` a value."""
    good = trials(weight=np.ones((6, 9)), log_q=np.zeros((6, 9)))
    values = good[name].values.astype(float)
    values[change["at"]] = change["to"]
    return good.assign({name: (good[name].dims, values)})


def test_tree_survives_the_disk_bit_for_bit(tmp_path):
    log_q = np.random.default_rng(1).normal(size=(6, 9))
    log_q[2, 3] = np.nan
    log_q[3, 3] = -np.inf
    tree = trials_tree(trials(log_q=log_q, circular=["angle"], autocorrelated=True), trials(3, 20))
    path = write_trials(tree, tmp_path / "trials.nc")
    again = read_trials(path)
    xr.testing.assert_identical(main_trials(again), main_trials(tree))
    xr.testing.assert_identical(importance_trials(again), importance_trials(tree))
    assert os.listdir(tmp_path) == ["trials.nc"]


@pytest.mark.parametrize("in_memory", [1 << 28, 100])
def test_xarray_opens_the_file_as_it_is(tmp_path, monkeypatch, in_memory):
    """Also where the groups are of other sizes, and where they came in parts."""
    monkeypatch.setattr("gaugeblock.validate.storage.IN_MEMORY", in_memory)
    tree = trials_tree(trials(), trials().isel(trial=slice(3)), joint=trials().isel(trial=slice(2)))
    path = write_trials(tree, tmp_path / "t.nc")
    with xr.open_datatree(path) as opened:
        assert opened.attrs["schema_version"] == 2
        assert set(opened.children) == {"importance", "joint"}
        assert opened["joint"].sizes["joint_trial"] == 2
        assert "trial" not in opened["importance"].to_dataset(inherit=False).dims
        shown = opened["importance"]["draws"]
        assert shown.dims == ("importance_trial", "importance_draw", "parameter")
        np.testing.assert_array_equal(shown, trials()["draws"].values[:3])


def test_files_of_the_version_before_are_read(tmp_path):
    old = {"/": trials().assign_attrs(schema_version=1), "/importance": trials().isel(trial=slice(3))}
    for group, dataset in old.items():
        dataset.to_netcdf(tmp_path / "old.nc", group=group, mode="w" if group == "/" else "a")
    found = read_trials(tmp_path / "old.nc")
    assert main_trials(found).equals(trials())
    assert importance_trials(found).equals(trials().isel(trial=slice(3)))


def test_a_tree_without_importance_trials_has_none(tmp_path):
    path = write_trials(trials(), tmp_path / "t.nc")
    assert importance_trials(read_trials(path)) is None


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    path = write_trials(trials(), tmp_path / "t.nc")
    before = path.read_bytes()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(InputError, match="No space left"):
        write_trials(trials(7), path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["t.nc"]


def test_unwritable_folder_is_one_line(tmp_path):
    with pytest.raises(InputError, match="cannot write"):
        write_trials(trials(), tmp_path / "no" / "such" / "folder.nc")


def test_a_strangers_file_may_order_its_axes_as_it_likes(tmp_path):
    mine = trials(log_q=np.zeros((6, 9)))
    other = mine.drop_vars("trial").transpose("parameter", "draw", "channel", "trial")
    other.attrs = {}
    other.to_netcdf(tmp_path / "theirs.nc", engine="netcdf4")
    read = main_trials(read_trials(tmp_path / "theirs.nc"))
    np.testing.assert_array_equal(read["draws"].values, mine["draws"].values)
    assert read["draws"].dims == ("trial", "draw", "parameter")


@pytest.mark.parametrize("fraction", [0.1, 0.5, 0.9, 0.999])
def test_truncated_files_are_one_line(tmp_path, fraction):
    data = write_trials(trials(200), tmp_path / "whole.nc").read_bytes()
    cut = tmp_path / "cut.nc"
    cut.write_bytes(data[: int(len(data) * fraction)])
    with pytest.raises(InputError, match=r"cut\.nc: cannot be read as NetCDF") as caught:
        read_trials(cut)
    assert "\n" not in str(caught.value)


def test_files_that_are_not_netcdf_missing_or_folders(tmp_path):
    (tmp_path / "text.nc").write_text("theta_true")
    (tmp_path / "empty.nc").write_bytes(b"")
    with pytest.raises(InputError, match="not NetCDF"):
        read_trials(tmp_path / "text.nc")
    with pytest.raises(InputError, match="not NetCDF"):
        read_trials(tmp_path / "empty.nc")
    with pytest.raises(InputError, match="no such file"):
        read_trials(tmp_path / "missing.nc")
    with pytest.raises(InputError, match="is not a file"):
        read_trials(tmp_path)


def test_newer_and_senseless_schema_versions(tmp_path):
    for version, said in ((3, "schema_version 3 is newer"), ("one", "must be the whole number")):
        trials().assign_attrs(schema_version=version).to_netcdf(tmp_path / "v.nc", engine="netcdf4")
        with pytest.raises(InputError, match=said):
            read_trials(tmp_path / "v.nc")


@pytest.mark.parametrize(
    ("dataset", "said"),
    [
        (trials().drop_vars("theta_true"), "no array 'theta_true'"),
        (trials().drop_vars("draws"), "no array 'draws'"),
        (xr.Dataset(), "found nothing"),
        (
            replaced("theta_true", at=(4, 1), to=np.nan),
            r"theta_true has NaN .* first in trial 4, parameter angle",
        ),
        (replaced("theta_true", at=(0, 0), to=np.inf), "theta_true has NaN or infinite"),
        (replaced("x", at=(5, 2), to=np.nan), "x has NaN or infinite values in 1 trial.* trial 5"),
        (
            replaced("x", at=(5, 2), to=-1.1e150),
            r"x has values beyond 1e\+150 in 1 .* trial 5; their squares",
        ),
        (replaced("x", at=(5, 2), to=np.inf).astype(np.float32), "x has NaN or infinite values in 1 trial"),
        (
            replaced("theta_true", at=(4, 1), to=1e308),
            r"theta_true has values beyond 1e\+150 in 1 trial\(s\), first in trial 4, parameter angle",
        ),
        (replaced("weight", at=(1, 1), to=-1.0), "weight has negative values"),
        (replaced("weight", at=(1, 1), to=np.nan), "weight has NaN"),
        (replaced("weight", at=2, to=0.0), "weights of trial 2 sum to zero"),
        (trials().isel(trial=slice(0, 0)), "there are no trials"),
        (trials().isel(draw=slice(0, 1)), r"1 draw\(s\) per trial; at least 2"),
        (trials().isel(parameter=slice(0, 0)), "there are no parameters"),
        (trials().isel(draw=0), "draws has the axes"),
        (trials().rename(draw="sample"), "draws has the axes .*sample"),
        (trials().drop_vars("parameter"), "no coordinate 'parameter'"),
        (trials().assign_coords(parameter=["a", "a"]), "a occurs more than once"),
        (trials().assign_coords(parameter=["a", " "]), "empty name"),
        (trials().assign_coords(parameter=["a", "b\x1b[2J"]), r"the name 'b\\x1b\[2J' holds letters"),
        (trials().rename(x="x\u202e"), r"the name 'x\\u202e' holds letters"),
        (trials().assign_coords(parameter=[1, 2]), "must hold the parameters' names"),
        (trials().assign(draws=trials()["draws"].astype(str)), "draws holds .* real numbers"),
        (trials().assign(draws=trials()["draws"] + 1j), "draws holds complex"),
        (trials().assign(x=trials()["x"].astype(str)), "x holds"),
        (trials().assign(x=("channel", np.ones(4))), "one of them must be trial"),
        (trials().assign(log_q=("trial", np.ones(6))), "log_q has the axes"),
        (trials().assign_attrs(circular=["phase"]), "circular names phase, which is no parameter"),
        (trials().assign_attrs(circular="angle", circular_period=-1.0), "circular_period must be positive"),
        (trials().assign_attrs(circular="[broken"), "attribute circular is .* must list parameter names"),
        (trials().assign_attrs(autocorrelated="maybe"), "autocorrelated is 'maybe'; it must be 0 or 1"),
    ],
)
def test_bad_input_is_one_line_that_names_file_and_fault(dataset, said):
    with pytest.raises(InputError, match=said) as caught:
        check_trials(dataset, source="file.nc")
    assert str(caught.value).startswith("file.nc: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("expected", "said"),
    [
        (["tbabs_1.nh", "norm"], "unknown parameter angle; missing parameter norm"),
        (["tbabs_1.nh", "angle", "norm"], "missing parameter norm"),
        (["tbabs_1.nh"], "unknown parameter angle"),
        (["angle", "tbabs_1.nh"], "in the order"),
    ],
)
def test_names_are_held_against_those_expected(expected, said):
    check_trials(trials(), source="t", parameters=NAMES)
    with pytest.raises(InputError, match=said):
        check_trials(trials(), source="t", parameters=expected)


def test_importance_group_must_have_the_same_parameters(tmp_path):
    trials().to_netcdf(tmp_path / "t.nc", engine="netcdf4")
    other = trials().assign_coords(parameter=["a", "b"])
    other.to_netcdf(tmp_path / "t.nc", engine="netcdf4", mode="a", group="importance")
    with pytest.raises(InputError, match="group importance: unknown parameter a, b"):
        read_trials(tmp_path / "t.nc")


def test_make_trials_says_what_does_not_fit():
    theta, draws = np.zeros((4, 2)), np.zeros((4, 9, 2))
    for arguments, said in [
        ((theta[0], draws, NAMES), "theta_true has shape"),
        ((theta, draws[0], NAMES), "draws has shape"),
        ((theta, draws, ["a"]), "2 columns but 1 parameter names"),
        ((theta[:3], draws, NAMES), "do not fit together"),
        ((theta, draws.swapaxes(0, 1), NAMES), r"look like \(draw, trial, parameter\): exchange their first"),
        ((theta[:, 0], draws, NAMES), "of one parameter, give it a last axis of length 1"),
    ]:
        with pytest.raises(InputError, match=said):
            make_trials(*arguments)
    with pytest.raises(InputError, match="log_q has shape"):
        make_trials(theta, draws, NAMES, log_q=np.zeros(4))


@pytest.mark.parametrize("name", ["theta_true", "draws", "x", "weight", "log_likelihood_true"])
def test_masked_arrays_and_those_of_words_are_refused(name):
    shapes = {"theta_true": (4, 2), "draws": (4, 5, 2), "x": (4, 3), "weight": (4, 5)}
    sound = {key: np.arange(np.prod(shape)).reshape(shape) for key, shape in shapes.items()}
    sound["log_likelihood_true"] = np.zeros(4)
    assert make_trials(**sound)[name].shape == sound[name].shape
    hidden = np.ma.masked_array(sound[name], mask=sound[name] == sound[name].max())
    with pytest.raises(InputError, match=rf"^{name} has \d masked values"):
        make_trials(**{**sound, name: hidden})
    with pytest.raises(InputError, match=f"^{name} holds <U21 values|^{name} holds <U32 values"):
        make_trials(**{**sound, name: sound[name].astype(str)})


def test_nan_draws_and_log_q_are_not_bad_input():
    log_q = np.full((6, 9), np.nan)
    kept = check_trials(trials(log_q=log_q), source="t")
    assert np.isnan(kept["log_q"].values).all()
    make_trials(np.zeros((2, 1)), np.full((2, 5, 1), np.inf), ["a"])


@pytest.mark.parametrize("stated", ["angle", ["angle"], '["angle"]', " angle ", ("angle",)])
def test_circular_parameters_in_every_spelling(stated):
    assert circular_parameters(trials().assign_attrs(circular=stated)) == {1: 2 * np.pi}
    degrees = trials().assign_attrs(circular=stated, circular_period=360.0)
    assert circular_parameters(degrees) == {1: 360.0}
