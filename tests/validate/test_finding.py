"""Findings of every kind by hand: some of their components, their influences, and as Datasets."""

import numpy as np
import pytest
import xarray as xr

from gaugeblock.validate.finding import (
    CountFinding,
    Finding,
    MeanFinding,
    PValueFinding,
    QuantileFinding,
    RootFinding,
    SequenceFinding,
    finding_from,
)

OWN = {
    MeanFinding: {"influence": np.arange(12.0).reshape(3, 4)},
    QuantileFinding: {"values": np.arange(12.0).reshape(3, 4), "quantile": np.array([0.1, 0.2, 0.3])},
    RootFinding: {
        "influence": np.arange(12.0).reshape(3, 4),
        "curve": np.arange(6.0).reshape(3, 2),
        "place": np.array([-1.0, 1.0]),
    },
    CountFinding: {},
    PValueFinding: {},
    SequenceFinding: {
        "score": np.arange(12, dtype=np.int8).reshape(3, 4),
        "expected": np.arange(3.0)[:, None],
        "draws": 17.0,
    },
}


def made(kind, **more) -> Finding:
    return kind(
        **{
            "id": "sbc.bias[a.b]", "quantity": "bias", "claim": "what", "null": "zero", "reference": "paper",
            "n_trials": 4, "sense": "at-most", "components": ("x", "y", "z"), "population": "some",
            "estimate": np.array([1.0, 2.0, 3.0]), "standard_error": np.array([0.1, 0.2, 0.3]),
            "p_value": 0.25, "details": xr.Dataset({"plot": ("bin", [5, 6])}, attrs={"not": "kept"}),
            "caveats": ("one", "two"), "doubt": "why", "excuse": "why not",
        } | OWN[kind] | more
    )  # fmt: skip


@pytest.mark.parametrize("kind", OWN)
def test_some_components(kind):
    whole = made(kind)
    part = whole.of(np.array([True, False, True]))
    assert part.components == ("x", "z")
    for name, dims in kind.arrays.items():
        wanted = getattr(whole, name)
        np.testing.assert_array_equal(getattr(part, name), wanted if dims == ("place",) else wanted[[0, 2]])
    assert (part.id, part.claim, part.n_trials, part.doubt) == ("sbc.bias[a.b]", "what", 4, "why")
    assert part.validator == "sbc"


@pytest.mark.parametrize("kind", OWN)
def test_a_dataset_and_back(kind):
    """All that it holds; attributes are as NetCDF gives them back, without Python's own numbers."""
    whole = made(kind)
    dataset = whole.to_dataset()
    assert dataset.attrs["kind"] == kind.kind
    assert {"estimate", "standard_error", "detail_plot", *kind.arrays} == set(dataset.variables)
    assert "not" not in dataset.attrs
    stored = {
        name: np.float64(value)
        if isinstance(value, float)
        else np.int64(value)
        if isinstance(value, int)
        else value
        for name, value in dataset.attrs.items()
    }
    found = finding_from(dataset.assign_attrs(stored))
    assert type(found) is kind
    for name in kind.words:
        assert getattr(found, name) == getattr(whole, name)
        assert type(getattr(found, name)) is type(getattr(whole, name))
    for name in kind.arrays:
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name))
        assert type(getattr(found, name)) is np.ndarray
    assert (found.components, found.caveats) == (("x", "y", "z"), ("one", "two"))
    assert (found.doubt, found.excuse) == ("why", "why not")
    assert list(found.details.data_vars) == ["plot"]
    assert found.details["plot"].values.tolist() == [5, 6]
    assert found.details.attrs == {}
    sure = made(kind, doubt="", excuse="", details=xr.Dataset()).to_dataset()
    assert not {"doubt", "excuse"} & set(sure.attrs)
    assert finding_from(sure).doubt == finding_from(sure).excuse == ""
    assert not finding_from(sure).details.data_vars


def test_influences_of_a_quantile_are_those_of_the_share_up_to_it():
    values = np.array([[5.0, 1.0, 3.0, 9.0], [2.0, 2.0, 2.0, 7.0], [1.0, np.nan, 4.0, 8.0]])
    found = made(QuantileFinding, values=values, estimate=np.array([3.0, 2.0, 8.0])).influence
    wanted = [[-0.5, 0.5, 0.5, -0.5], [0.25, 0.25, 0.25, -0.75], [0.25, -0.75, 0.25, 0.25]]
    np.testing.assert_allclose(found, wanted)
