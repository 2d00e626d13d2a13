"""Groups of a few numbers: whose truths and data are taken, of what there is, and what is made of lists."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

from gaugeblock import trials_from_arviz
from gaugeblock.core.errors import InputError

RNG = np.random.default_rng(1)
DRAWS = RNG.normal(size=(4, 2, 5))
POSTERIOR = xr.Dataset(
    {"a": (("trial", "chain", "draw"), DRAWS), "b": (("trial", "chain", "draw"), DRAWS + 9)}
)


def truths(offset: float, *names: str, dim: str = "trial") -> xr.Dataset:
    return xr.Dataset({name: ((dim,), np.arange(4.0) + offset) for name in names})


def made(groups: dict[str, xr.Dataset], **options: Any) -> xr.Dataset:
    posterior = groups.pop("posterior", POSTERIOR)
    return trials_from_arviz(xr.DataTree.from_dict({"posterior": posterior, **groups}), **options)


@pytest.mark.parametrize(
    ("groups", "attrs", "first"),
    [
        ({"prior": truths(1, "a"), "constant_data": truths(2, "a")}, {}, 1.0),
        ({"prior": truths(1, "a_true"), "constant_data": truths(2, "a")}, {}, 1.0),
        ({"prior": truths(1, "a", "a_true") * [1.0]}, {}, 1.0),
        ({"constant_data": truths(2, "a_true", dim="other")}, {"a_true": [9.0] * 4}, 2.0),
        ({"prior": truths(1, "b")}, {"a_true": np.arange(4.0) + 3}, 3.0),
    ],
)
def test_truths_are_looked_for_in_this_order(groups: Any, attrs: dict[str, Any], first: float) -> None:
    found = made({**groups, "posterior": POSTERIOR.assign_attrs(attrs)}, names=["a"])
    assert found["theta_true"].values[:, 0].tolist() == [first + k for k in range(4)]
    assert found["parameter"].values.tolist() == ["a"]
    np.testing.assert_array_equal(found["draws"].values[..., 0], DRAWS.reshape(4, 10))


def test_an_attribute_of_the_root_comes_before_one_of_the_posterior() -> None:
    posterior = POSTERIOR.assign_attrs(a_true=[9.0] * 4)
    tree = xr.DataTree.from_dict({"/": xr.Dataset(attrs={"a_true": np.arange(4.0)}), "posterior": posterior})
    assert trials_from_arviz(tree, names=["a"])["theta_true"].values[:, 0].tolist() == [0, 1, 2, 3]
    with pytest.raises(InputError) as caught:
        made({"prior": truths(1, "a"), "sample_stats": truths(1, "c")})
    assert str(caught.value) == (
        "trials_from_arviz: no truths of b: looked for b and b_true in the groups prior and constant_data, "
        "and for an attribute b_true (groups there: posterior, prior, sample_stats)"
    )


BOTH = truths(1, "a", "b")


def test_data_are_those_of_the_prior_flat_where_there_are_several() -> None:
    y, z = np.arange(24.0).reshape(4, 3, 2), np.arange(4.0)
    image = xr.Dataset({"y": (("trial", "row", "column"), y)})
    several = xr.Dataset(
        {"a": (("trial",), z + 50), "y": (("trial", "row", "column"), y), "z": (("trial",), z)}
    )
    other = xr.Dataset({"w": (("trial",), z + 7)})
    np.testing.assert_array_equal(made({"prior": BOTH, "prior_predictive": image})["x"].values, y)
    # A variable called like a parameter is its truth, and no data.
    flat = np.concatenate([y.reshape(4, 6), z[:, None]], axis=1)
    found = made({"prior": BOTH, "prior_predictive": several, "observed_data": other})["x"]
    np.testing.assert_array_equal(found.values, flat)
    assert found["channel"].values.tolist() == [*(f"y[{i}, {j}]" for i in range(3) for j in range(2)), "z"]
    none = xr.Dataset({"a": (("trial",), z)})
    found = made({"prior": BOTH, "prior_predictive": none, "observed_data": other})["x"].values
    assert found.ravel().tolist() == [7, 8, 9, 10]
    given = made({"prior": BOTH, "prior_predictive": image}, x=[[1], [2], [3], [4]])["x"].values
    assert given.tolist() == [[1], [2], [3], [4]]
    assert "x" not in made({"prior": BOTH})


@pytest.mark.parametrize(
    ("posterior", "said", "chains"),
    [
        (POSTERIOR, None, True),
        (POSTERIOR, False, False),
        (POSTERIOR.isel(chain=0, drop=True), None, False),
        (POSTERIOR.isel(chain=0, drop=True), True, True),
        (POSTERIOR.assign_coords(chain=[0, 1], draw=range(5)).stack(sample=("chain", "draw")), None, True),
    ],
)
def test_draws_in_chains_are_said_to_be(posterior: xr.Dataset, said: bool | None, chains: bool) -> None:
    found = made({"posterior": posterior.reset_index("sample") if "sample" in posterior.dims else posterior,
                  "prior": BOTH}, autocorrelated=said)  # fmt: skip
    assert ("autocorrelated" in found.attrs) is chains


def test_lists_of_fits_and_their_truths() -> None:
    fits = [POSTERIOR.isel(trial=k) for k in range(4)]
    trees = [xr.DataTree.from_dict({"posterior": fit, "sample_stats": fit}) for fit in fits]
    for each in (fits, trees, tuple(fits)):
        found = trials_from_arviz(each, BOTH)
        np.testing.assert_array_equal(found["draws"].values[..., 1], DRAWS.reshape(4, 10) + 9)
        assert found["theta_true"].values.tolist() == [[k + 1.0, k + 1.0] for k in range(4)]
        assert found.attrs["autocorrelated"] == 1
    arrays = {"a": np.arange(4.0), "b": np.arange(4.0) + 5, "more": "words"}
    assert trials_from_arviz(fits, arrays)["theta_true"].values[2].tolist() == [2.0, 7.0]
    for wrong, said in (
        ([fits[0], fits[1].drop_vars("b")], "variable b: dims of fit 1 are none, of fit 0 ('chain', 'draw')"),
        (
            [fits[0], fits[1].transpose("draw", "chain")],
            "variable a: dims of fit 1 are ('draw', 'chain'), of fit 0 ('chain', 'draw')",
        ),
        ([fits[0], 3], "got int; expected a DataTree, an InferenceData, a Dataset, a list of them"),
        ([xr.Dataset()], "no group posterior with variables (groups there: posterior)"),
    ):
        with pytest.raises(InputError) as caught:
            trials_from_arviz(wrong, BOTH)
        assert said in str(caught.value)


def test_old_groups_are_read_by_their_names() -> None:
    class Old:
        held = {"posterior": POSTERIOR, "prior": BOTH}  # noqa: RUF012

        def groups(self) -> list[str]:
            return list(self.held)

        def __getitem__(self, name: str) -> xr.Dataset:
            return self.held[name]

    assert trials_from_arviz(Old())["theta_true"].values[:, 0].tolist() == [1, 2, 3, 4]
