"""Arrays as others have them in hand: what belongs together is put together, or refused."""

import numpy as np
import pytest
import xarray as xr

import gaugeblock as gb
from gaugeblock.auditing.trials_from.in_hand import trials_in_hand
from gaugeblock.core.errors import InputError

TRIALS, DRAWS = 7, 5


@pytest.fixture
def arrays():
    """Truths and draws whose every number is another, data, and weights."""
    rng = np.random.default_rng(3)
    return (
        rng.normal(size=(TRIALS, 2)),
        rng.normal(size=(TRIALS, DRAWS, 2)),
        rng.normal(size=(TRIALS, 4)),
        rng.random((TRIALS, DRAWS)),
    )


def holds(trials, theta, draws, names=("a", "b")):
    assert trials["parameter"].values.tolist() == list(names)
    np.testing.assert_array_equal(trials["theta_true"].values, theta)
    np.testing.assert_array_equal(trials["draws"].values, draws)
    assert trials["draws"].dtype == trials["theta_true"].dtype == np.float64


def test_dictionaries_go_by_name_in_the_order_of_the_truths(arrays):
    theta, draws, x, weight = arrays
    truths = {"counts": x, "a": theta[:, 0], "b": theta[:, 1:]}  # what a simulator of BayesFlow gives
    drawn = {"b": draws[..., 1:], "a": draws[..., 0]}
    trials = trials_in_hand(truths, drawn, x="counts", weight=weight, autocorrelated=True)
    holds(trials, theta, draws)
    np.testing.assert_array_equal(trials["x"].values, x)
    np.testing.assert_array_equal(trials["weight"].values, weight)
    assert trials.attrs["autocorrelated"] == 1
    one = trials_in_hand(truths, drawn, names=["b"], x=x)
    holds(one, theta[:, 1:], draws[..., 1:], ["b"])
    np.testing.assert_array_equal(one["x"].values, x)
    assert "autocorrelated" not in one.attrs


def test_data_keep_the_names_of_their_values(arrays):
    theta, draws, x, _ = arrays
    energies = xr.DataArray(x, dims=("trial", "energy"), coords={"energy": [1.0, 2.0, 4.0, 8.0]})
    by_name = {"flux": x[:, 0], "rest": x[:, 1:]}
    for data in (energies, energies.T):
        assert trials_in_hand(theta, draws, x=data)["energy"].values.tolist() == [1.0, 2.0, 4.0, 8.0]
    trials = trials_in_hand(theta, draws, x=by_name)
    assert trials["channel"].values.tolist() == ["flux", "rest[0]", "rest[1]", "rest[2]"]
    np.testing.assert_array_equal(trials["x"].values, x)
    among = trials_in_hand({"a": theta[:, 0], "y": by_name}, {"a": draws[..., 0]}, x="y", names=["a"])
    assert among["channel"].values.tolist() == trials["channel"].values.tolist()
    assert gb.audit_draws(theta, draws, x=energies, progress=False).trials["energy"].size == 4


def test_a_variable_of_several_numbers_is_several_parameters(arrays):
    theta, draws, *_ = arrays
    holds(trials_in_hand({"v": theta}, {"v": draws}), theta, draws, ["v[0]", "v[1]"])


def test_xarray_goes_by_the_names_of_axes_and_parameters(arrays):
    theta, draws, *_ = arrays
    named = {"parameter": ["a", "b"]}
    truths = xr.DataArray(theta, dims=("trial", "parameter"), coords=named)
    drawn = xr.DataArray(draws, dims=("trial", "draw", "parameter"), coords=named)
    turned = drawn.isel(parameter=[1, 0]).transpose("draw", "parameter", "trial")
    holds(trials_in_hand(truths.T, turned), theta, draws)
    # Without names of parameters the axes still have theirs.
    holds(trials_in_hand(truths.drop_vars("parameter").T, draws), theta, draws, ["theta_1", "theta_2"])
    bare = trials_in_hand(theta, drawn.drop_vars("parameter").transpose("parameter", "draw", "trial"))
    holds(bare, theta, draws, ["theta_1", "theta_2"])
    # Other names of axes say nothing: they are taken as they lie.
    other = drawn.rename(trial="set", draw="sample")
    holds(trials_in_hand(theta, other), theta, draws, ["theta_1", "theta_2"])


def test_names_of_columns_are_those_of_parameters(arrays):
    theta, draws, *_ = arrays
    pandas = pytest.importorskip("pandas")
    table = pandas.DataFrame(theta, columns=["a", "b"])
    holds(trials_in_hand(table, draws), theta, draws)
    holds(
        trials_in_hand(table[["b", "a"]], {"b": draws[..., 1], "a": draws[..., 0]}, names=["a", "b"]),
        theta,
        draws,
    )
    holds(trials_in_hand(table, draws, names=["c", "d"]), theta, draws, ["c", "d"])
    holds(trials_in_hand(pandas.DataFrame(theta), draws), theta, draws, ["theta_1", "theta_2"])
    half = pandas.DataFrame(theta, columns=["a", 2])
    holds(trials_in_hand(half, draws), theta, draws, ["theta_1", "theta_2"])


def test_single_precision_is_computed_in_double(arrays):
    theta, draws, x, _ = arrays
    trials = trials_in_hand(theta.astype(np.float32), draws.astype(np.float16), x=x.astype(np.float32))
    holds(trials, theta.astype(np.float32), draws.astype(np.float16), ["theta_1", "theta_2"])
    assert trials["x"].dtype == np.float32


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (lambda t, d: ({"a": t[:, 0], "b": t[:, 1]}, d), "draws has no names and the other is a dictionary"),
        (lambda t, d: (t, {"a": d[..., 0], "b": d[..., 1]}), "theta_true has no names and the other is"),
        (lambda t, d: ({"a": t[:, 0]}, {"a": d[..., 0], "c": d[..., 1]}), "no truths of c .there are a."),
        (lambda t, d: (t, d.swapaxes(0, 1)), r"\(draw, trial, parameter\): exchange their first two"),
        (lambda t, d: (t, d.swapaxes(1, 2)), r"\(trial, parameter, draw\): exchange their last two"),
        (lambda t, d: (t, np.moveaxis(d, 2, 0)), "are their first axis: make it the last"),
        (lambda t, d: (t, [one[: 3 + at % 2] for at, one in enumerate(d)]), "rows have different lengths"),
        (lambda t, d: (np.ma.masked_greater(t, t.max() - 1e-9), d), "theta_true has 1 masked values"),
        (lambda t, d: (t, np.ma.masked_less(d, 0.0)), r"draws has \d+ masked values; fill them"),
    ],
)
def test_what_does_not_belong_together_is_one_line(arrays, given, says):
    theta, draws = given(*arrays[:2])
    with pytest.raises(InputError, match=says) as told:
        gb.audit_draws(theta, draws)
    assert "\n" not in str(told.value)


def test_an_array_whose_mask_hides_nothing_is_an_array(arrays):
    theta, draws, *_ = arrays
    holds(trials_in_hand(np.ma.asarray(theta), np.ma.asarray(draws)), theta, draws, ["theta_1", "theta_2"])


def test_the_audit_takes_them(arrays):
    theta, draws, x, weight = arrays
    truths, drawn = {"a": theta[:, 0], "b": theta[:, 1]}, {"a": draws[..., 0], "b": draws[..., 1]}
    log_q, log_q_true = np.log(weight), np.arange(7.0)
    audit = gb.audit_draws(truths, drawn, x=x, weight=weight, log_q=log_q, log_q_true=log_q_true)
    trials = audit.trials
    holds(trials, theta, draws)
    for name, value in {"x": x, "weight": weight, "log_q": log_q, "log_q_true": log_q_true}.items():
        np.testing.assert_array_equal(trials[name].values, value)
    assert "autocorrelated" not in trials.attrs
    assert gb.audit_draws(theta, draws, autocorrelated=True).trials.attrs["autocorrelated"] == 1
