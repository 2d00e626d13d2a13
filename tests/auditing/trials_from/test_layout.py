"""Where data sets and draws lie among dims, by hand-made Datasets of a few numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

from gaugeblock.auditing.trials_from.layout import Layout, draws_of, labels_of, layout_of, per_trial
from gaugeblock.core.errors import InputError


def held(*dims: str) -> xr.Dataset:
    return xr.Dataset({"a": (dims, np.zeros([2] * len(dims)))})


@pytest.mark.parametrize(
    ("dims", "trial", "layout"),
    [
        (("trial", "chain", "draw"), None, ("trial", ("chain", "draw"))),
        (("draw", "chain", "sim", "k"), None, ("sim", ("chain", "draw"))),
        (("sample", "draw"), None, ("sample", ("draw",))),
        (("dataset", "sample"), None, ("dataset", ("sample",))),
        (("trial", "chain", "sample"), None, ("trial", ("chain", "sample"))),
        (("sbc", "draw", "galaxy"), "galaxy", ("galaxy", ("draw",))),
        (("sample", "draw", "k"), "sample", ("sample", ("draw",))),
        (("trial", "sample", "draw"), "trial", ("trial", ("draw",))),
    ],
)
def test_the_layout_is_read_off_the_dims(dims: tuple[str, ...], trial: str | None, layout: Any) -> None:
    found = layout_of(held(*dims), trial=trial, source="here")
    assert (found.trial, found.draws) == layout
    assert found.dims == (layout[0], *layout[1])


@pytest.mark.parametrize(
    ("dims", "trial", "said"),
    [
        (("trial", "k"), None, "draws need (chain, draw), (draw) or (sample)"),
        (("trial", "chain"), None, "draws need (chain, draw), (draw) or (sample)"),
        (("sample", "k"), "sample", "draws need (chain, draw), (draw) or (sample)"),
        (("trial", "draw"), "k", "'k' cannot be the dim of the simulated data sets"),
        (("trial", "draw"), "draw", "'draw' cannot be the dim of the simulated data sets"),
        (("trial", "sim", "draw"), None, "trial and sim may each be the simulated data sets"),
        (("trial", "draw", "sample"), None, "trial and sample may each be the simulated data sets"),
    ],
)
def test_dims_that_do_not_tell(dims: tuple[str, ...], trial: str | None, said: str) -> None:
    with pytest.raises(InputError) as caught:
        layout_of(held(*dims), trial=trial, source="here")
    assert str(caught.value) == f"here: group posterior has the dims ({', '.join(dims)}); {said}"


LAYOUT = Layout("trial", ("chain", "draw"))
VALUES = np.arange(2.0 * 3 * 4 * 5).reshape(2, 3, 4, 5)
LIKE = xr.DataArray(
    VALUES,
    dims=("trial", "chain", "draw", "k"),
    coords={"trial": [7, 3], "k": list("abcde")},
    name="a",
)


def test_draws_are_chain_after_chain_whatever_the_order_of_dims() -> None:
    for order in (("trial", "chain", "draw", "k"), ("k", "draw", "trial", "chain")):
        found, rest = draws_of(LIKE.transpose(*order), LAYOUT, source="here")
        np.testing.assert_array_equal(found, VALUES.reshape(2, 12, 5))
        assert rest == ("k",)
    found, rest = draws_of(LIKE, Layout("k", ("draw",)), source="here")
    np.testing.assert_array_equal(found, VALUES.transpose(3, 2, 0, 1))
    assert rest == ("trial", "chain")
    with pytest.raises(InputError) as caught:
        draws_of(LIKE.isel(chain=0), LAYOUT, source="here")
    assert str(caught.value) == (
        "here: group posterior, variable a has the dims (trial, draw, k); expected (trial, chain, draw, ...)"
    )


TRUE = np.arange(10.0).reshape(2, 5)
"""Truths in the posterior's order, trials 7 and 3."""


@pytest.mark.parametrize(
    "variable",
    [
        xr.DataArray(TRUE, dims=("trial", "k")),
        xr.DataArray(TRUE.T, dims=("k", "trial")),
        xr.DataArray(TRUE, dims=("trial", "k"), coords={"trial": [7, 3], "k": list("abcde")}),
        xr.DataArray(TRUE[::-1], dims=("trial", "k"), coords={"trial": [3, 7]}),
        xr.DataArray(TRUE[:, ::-1], dims=("trial", "k"), coords={"k": list("edcba")}),
        xr.DataArray(TRUE, dims=("other", "m")),
        xr.DataArray(TRUE[None], dims=("chain", "draw", "k")),
        xr.DataArray(TRUE[:, None], dims=("chain", "draw", "k")),
        xr.DataArray(TRUE.T, dims=("m", "draw")),
        xr.DataArray(TRUE.T, dims=("m", "sample")),
    ],
)
def test_one_value_a_data_set_in_the_order_of_the_posterior(variable: xr.DataArray) -> None:
    found = per_trial(variable.rename("a"), LIKE, LAYOUT, group="prior", source="here")
    np.testing.assert_array_equal(found, TRUE)


def test_values_that_do_not_pair_with_fits() -> None:
    def said(variable: xr.DataArray) -> str:
        with pytest.raises(InputError) as caught:
            per_trial(variable.rename("a"), LIKE, LAYOUT, group="prior", source="here")
        return str(caught.value)

    assert said(xr.DataArray(TRUE.T, dims=("m", "n"))) == (
        "here: group prior, variable a has the dims (m: 5, n: 2); expected one value for each of 2 simulated "
        "data sets, (trial, ...), as the posterior has them"
    )
    assert "has the dims ();" in said(xr.DataArray(1.0))
    assert "has the dims (chain: 2, draw: 5);" in said(xr.DataArray(TRUE, dims=("chain", "draw")))
    for labels in ([3, 8], [3, 3]):
        assert said(xr.DataArray(TRUE, dims=("trial", "k"), coords={"trial": labels})) == (
            "here: group prior, variable a: the labels of dim trial are not those of the posterior "
            f"({labels[0]}, {labels[1]} against 7, 3); they must pair truths with fits"
        )
    other = xr.DataArray(TRUE, dims=("trial", "k"), coords={"k": list("abcdf")})
    assert "(a, b, c, ... 5 in all against a, b, c, ... 5 in all)" in said(other)


def test_words_stand_in_the_brackets_and_numbers_do_not() -> None:
    assert labels_of(LIKE, ("k",)) == ["a", "b", "c", "d", "e"]
    assert labels_of(LIKE, ("trial",)) == ["0", "1"]
    assert labels_of(LIKE.isel(k=slice(2)), ("chain", "k")) == ["0,a", "0,b", "1,a", "1,b", "2,a", "2,b"]
    made = LIKE.assign_coords(k=np.array(list("vwxyz"), dtype=object))
    assert labels_of(made, ("k",)) == ["v", "w", "x", "y", "z"]
    assert labels_of(LIKE, ()) == [""]
