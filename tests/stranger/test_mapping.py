import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gaugeblock.core.errors import InputError
from gaugeblock.stranger.mapping import TRANSFORMS, Mapping

NAMES = ("a", "b", "c")
THEIRS = ("x", "y", "z")


@st.composite
def tables(draw):
    """A table in any order, on any scales, in any units."""
    order = draw(st.permutations(range(3)))
    return {
        name: {
            "index": column,
            "transform": draw(st.sampled_from(sorted(TRANSFORMS))),
            "unit": draw(st.sampled_from([1.0, -1.0, 1e-3, 5.0])),
            "offset": draw(st.sampled_from([0.0, -2.0, 10.0])),
        }
        for name, column in zip(NAMES, order, strict=True)
    }


POSITIVE = st.lists(st.floats(0.2, 3.0), min_size=3, max_size=3)


@given(tables(), POSITIVE)
@settings(max_examples=200, deadline=None)
def test_there_and_back(table, values):
    mapping = Mapping.of(table, NAMES, stranger=THEIRS)
    theirs = np.asarray(values)
    ours = mapping.to_simulator(theirs[None])
    np.testing.assert_allclose(mapping.from_simulator(ours)[0], theirs, rtol=1e-9)


@given(tables(), POSITIVE)
@settings(max_examples=200, deadline=None)
def test_the_jacobian_is_what_finite_differences_say(table, values):
    mapping = Mapping.of(table, NAMES)
    theirs = np.asarray(values)
    step = 1e-5 * np.eye(3)
    matrix = (mapping.to_simulator(theirs + step) - mapping.to_simulator(theirs - step)) / 2e-5
    _, log_size = np.linalg.slogdet(matrix)
    # Steps of 1e-8 beside an offset of 10 keep some five digits of the differences.
    assert mapping.log_jacobian(theirs) == pytest.approx(-log_size, abs=1e-5)


def test_a_density_stays_one():
    """A log-normal, held as the normal of its log10 in other units, integrates to 1 over the simulator's."""
    mapping = Mapping.of({"a": {"index": 0, "transform": "log10", "unit": 0.001}}, ["a"])
    theta = np.geomspace(1e-9, 1e3, 200_001)[:, None]
    theirs = mapping.from_simulator(theta)
    log_q = -0.5 * (theirs[:, 0] / 0.4) ** 2 - np.log(0.4 * np.sqrt(2 * np.pi)) + mapping.log_jacobian(theirs)
    assert np.trapezoid(np.exp(log_q), theta[:, 0]) == pytest.approx(1, abs=1e-6)


def test_names_columns_and_places():
    mapping = Mapping.of({"a": "z", "c": 0}, NAMES, stranger=THEIRS)
    assert mapping.columns == (2, 1, 0)
    assert mapping.to_simulator([[1.0, 2.0, 3.0]]).tolist() == [[3.0, 2.0, 1.0]]


def test_names_alone_move_nothing():
    mapping = Mapping.of(None, NAMES, stranger=("c", "a", "b"))
    assert mapping.whole
    assert mapping.to_json()["columns"] == [0, 1, 2]


def test_a_column_that_is_not_wanted_is_left_out_and_costs_the_density():
    mapping = Mapping.of({"a": 1}, ["a"], stranger=("noise", "signal"))
    assert mapping.to_simulator(np.ones((4, 5, 2))).shape == (4, 5, 1)
    with pytest.raises(InputError, match="1 of the stranger's 2 columns are left out"):
        mapping.from_simulator(np.ones((4, 1)))


def test_a_value_outside_the_scale_is_nan_and_no_warning():
    mapping = Mapping.of({"a": {"transform": "log10"}, "b": {"transform": "logit"}}, ["a", "b"])
    assert np.isnan(mapping.from_simulator([[-1.0, 0.5]])[0]).tolist() == [True, False]
    assert np.isnan(mapping.from_simulator([[0.0, 1.0]])).all()
    assert np.isinf(mapping.to_simulator([[400.0, 0.0]])[0, 0])


def test_a_draw_that_is_no_number_stays_none():
    assert np.isnan(Mapping.of({"a": {"transform": "log"}}, ["a"]).to_simulator([[np.nan]])).all()


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"d": 0}, "'d' is no parameter; the simulator has a, b, c"),
        ({"a": "w"}, "no parameter 'w'; it has x, y, z"),
        ({"a": 3}, "index 3 is out of range; the stranger's columns are 0 to 2"),
        ({"a": -1}, "index = -1 cannot be"),
        ({"a": 1}, "a and b both come from the stranger's parameter 'y'"),
        ({"a": {"name": "x", "index": 0}}, "name and index are both given"),
        ({"a": {"transform": "sqrt"}}, "transform = 'sqrt' cannot be"),
        ({"a": {"unit": 0}}, "unit = 0 leaves nothing"),
        ({"a": {"unit": float("inf")}}, "unit = inf cannot be"),
        ({"a": {"scale": 2}}, "unknown key scale; there are name, index, transform, unit, offset"),
        ({"a": {"index": 1.5}}, "index = 1.5 cannot be"),
        ({"a": True}, "True must be a name"),
        ({"a": [0]}, "must be a name, a column"),
    ],
)
def test_what_cannot_be_is_one_line(table, says):
    with pytest.raises(InputError) as raised:
        Mapping.of(table, NAMES, stranger=THEIRS)
    assert says in str(raised.value)
    assert str(raised.value).startswith("estimator.parameters")
    assert "\n" not in str(raised.value)


def test_names_of_a_stranger_that_has_none():
    with pytest.raises(InputError, match="does not name its parameters; give an index"):
        Mapping.of({"a": "x"}, NAMES)


def test_too_few_columns():
    with pytest.raises(InputError, match="2 parameters only"):
        Mapping.of(None, NAMES, stranger=("x", "y"))
    with pytest.raises(InputError, match="needs the stranger's column 2"):
        Mapping.of(None, NAMES).to_simulator(np.ones((3, 2)))
    with pytest.raises(InputError, match="last axis must be 3 long"):
        Mapping.of(None, NAMES).from_simulator(np.ones((3, 2)))
