"""Data keep the names they came with: from tables, xarray and dictionaries into files and messages."""

import numpy as np
import pytest
import xarray as xr

from gaugeblock.core.errors import InputError
from gaugeblock.validate import (
    NotChecked,
    make_trials,
    read_trials,
    run_validators,
    trials_tree,
    write_trials,
)
from gaugeblock.validate.check import check_trials
from gaugeblock.validate.named_data import named_data, value_name


class Table:
    """What pandas and polars have in common."""

    def __init__(self, values, columns):
        self.values, self.columns = values, columns

    def __array__(self, dtype=None, copy=None):
        return np.asarray(self.values, dtype=dtype)


def names(x):
    data = named_data(x)
    return [value_name(data, place) for place in range(int(np.prod(data.shape[1:])))]


def test_a_value_is_called_by_its_column_its_coordinate_or_its_number():
    assert names(np.zeros((3, 2))) == ["x[0]", "x[1]"]
    assert names(np.zeros((3, 1, 2))) == ["x[0, 0]", "x[0, 1]"]
    assert names(np.zeros(3)) == ["x"]
    assert names(Table(np.zeros((3, 2)), ["flux", "colour"])) == ["flux", "colour"]
    assert names(Table(np.zeros((3, 2)), [0, 1])) == ["x[0]", "x[1]"]
    spectrum = xr.DataArray(np.zeros((3, 2)), dims=("trial", "energy"), coords={"energy": [0.5, 1 / 3]})
    assert names(spectrum) == ["x[energy=0.5]", "x[energy=0.333333]"]
    assert names(spectrum.assign_coords(energy=[1234567, 2])) == ["x[energy=1234567]", "x[energy=2]"]
    assert names(spectrum.assign_coords(energy=["soft", "hard"])) == ["soft", "hard"]
    assert names(spectrum.drop_vars("energy")) == ["x[0]", "x[1]"]
    days = np.array(["2026-01-01", "2026-01-02"], dtype="datetime64[D]")
    assert names(spectrum.assign_coords(energy=days))[1].startswith("2026-01-02")
    image = xr.DataArray(
        np.zeros((2, 3, 1)), dims=("row", "trial", "x"), coords={"row": ["up", "low"], "x": [7]}
    )
    assert named_data(image).shape == (3, 2, 1)
    # An axis that is called as the data are has the name of its place.
    assert names(image) == ["x[up, x_1=7]", "x[low, x_1=7]"]


def test_a_dictionary_becomes_one_axis():
    rng = np.random.default_rng(1)
    parts = {
        "image": rng.normal(size=(4, 2, 2)),
        "time": np.arange(4),
        "band": xr.DataArray(rng.normal(size=(4, 2)), dims=("trial", "eV"), coords={"eV": [300, 700]}),
        "table": Table(rng.normal(size=(4, 1)), ["only"]),
    }
    assert names(parts) == [
        *("image[0, 0]", "image[0, 1]", "image[1, 0]", "image[1, 1]"),
        *("time", "band[eV=300]", "band[eV=700]", "table"),
    ]
    np.testing.assert_array_equal(named_data(parts)[:, :4], parts["image"].reshape(4, 4))
    np.testing.assert_array_equal(named_data(parts)[:, 4], parts["time"])
    # A Dataset is such a dictionary.
    assert names(xr.Dataset({"band": parts["band"]})) == ["band[eV=300]", "band[eV=700]"]
    for wrong, why in [
        ({}, "x: is a dictionary of nothing"),
        (
            {"a": np.zeros(3), "b": np.zeros((4, 2))},
            r"x: is a dictionary of a \(3,\), b \(4, 2\); give arrays",
        ),
        ({"a": 3.0, "b": np.zeros(4)}, r"a \(\), b \(4,\)"),
        ({"a": ["dark"]}, "x, a holds"),
    ]:
        with pytest.raises(InputError, match=why):
            named_data(wrong)


def trials(x, fault=0.0):
    """Two parameters, each seen in the value of x of its place; draws too high where the first is high."""
    rng = np.random.default_rng(2)
    data = rng.normal(size=(1200, 2))
    theta = data + rng.normal(size=data.shape)
    draws = data[:, None] + rng.normal(size=(1200, 60, 2))
    draws[data[:, 0] > 0.8, :, 1] += fault
    return make_trials(theta, draws, ["a", "b"], x=x(data, rng.normal(size=(1200, 4))))


WAYS = {
    "table": lambda data, noise: Table(
        np.column_stack([data, noise]), ["flux", "colour", *(f"other {k}" for k in range(4))]
    ),
    "dictionary": lambda data, noise: {"flux": data[:, 0], "colour": data[:, 1], "noise": noise},
    "xarray": lambda data, noise: xr.DataArray(
        np.column_stack([data, noise]).T, dims=("keV", "trial"), coords={"keV": 0.5 + np.arange(6)}
    ),
}


@pytest.mark.parametrize(
    ("way", "flux", "colour"),
    [
        ("table", "flux", "colour"),
        ("dictionary", "flux", "colour"),
        ("xarray", "x[keV=0.5]", "x[keV=1.5]"),
    ],
)
def test_names_reach_regions_challengers_learned_scores_and_controls(way, flux, colour, tmp_path):
    """Through a file too; and the numbers are those of the same data without names."""
    named = trials(WAYS[way], fault=1.5)
    path = write_trials(trials_tree(named), tmp_path / "trials.nc")
    select = ["local", "lc2st", "informed", "controls"]
    findings, _ = run_validators(read_trials(path), seed=3, select=select)
    said = {finding.id: finding for finding in findings if not isinstance(finding, NotChecked)}
    regions = "; ".join(said["local.coverage[b]"].components)
    assert f"{flux} > " in regions
    assert f"(most of it {flux})" in "; ".join(said["lc2st.local"].components)
    assert said["informed.rank"].components[0].endswith(f"a ridge regression on {colour}")
    (where,) = said["controls.region[b]"].caveats
    assert f"(most of it {flux})" in where
    plain = trials(lambda data, noise: np.column_stack([data, noise]), fault=1.5)
    for other in run_validators(plain, seed=3, select=select)[0]:
        np.testing.assert_array_equal(other.estimate, said[other.id].estimate)
        assert "x[0]" in "".join(other.components) or other.id not in ("local.coverage[b]", "lc2st.local")


def test_names_that_cannot_be_printed_are_refused():
    bad = trials(WAYS["table"])
    bad = bad.assign_coords(channel=["flux\x1b[2J", *map(str, range(5))])
    with pytest.raises(InputError, match="cannot be printed"):
        check_trials(bad, source="file")
