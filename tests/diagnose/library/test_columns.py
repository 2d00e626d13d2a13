"""What a column is: what was done to columns is found, said and undone."""

import numpy as np
import pytest

from gaugeblock.diagnosis.cases import Cases
from gaugeblock.diagnosis.library.columns import columns, log, sign, unit


def exact(trials=400, draws=40):
    """Three positive parameters that the data know well."""
    rng = np.random.default_rng(8)
    centre = rng.uniform([1.0, 4.0, 0.5], [3.0, 9.0, 4.0], (trials, 3))
    whole = centre[:, None] * np.exp(0.1 * rng.normal(size=(trials, draws + 1, 3)))
    return Cases(("a", "b", "c"), np.arange(trials), whole[:, 0], whole[:, 1:])


@pytest.mark.parametrize("find", [columns, unit, log, sign])
def test_columns_that_are_right_are_left_alone(find):
    assert not [each for each in find(exact()) if not each.variant or each.variant == "the other sign"]
    assert not list(columns(exact().drawn(exact().draws)))


def test_columns_in_another_order_are_put_back():
    cases = exact()
    for order in ([1, 0, 2], [2, 0, 1]):
        wrong = cases.drawn(cases.draws[..., order])
        repair = columns(wrong)[0]
        back = np.argsort(order)
        assert list(repair.numbers.values()) == back.tolist()
        np.testing.assert_array_equal(repair.apply(wrong).draws, cases.draws)
        for name, place in zip("abc", back, strict=True):
            moved = f"{name} is in the column of {'abc'[place]}"
            assert (moved in repair.words) == ("abc"[place] != name)
    one = Cases(("a",), cases.trial, cases.theta[:, :1], cases.draws[..., :1])
    assert columns(one) == []


def test_columns_in_another_order_and_read_otherwise():
    cases = exact()
    wrong = cases.drawn(np.stack([np.log(cases.draws[..., 1]), cases.draws[..., 0], cases.draws[..., 2]], -1))
    repair = next(each for each in columns(wrong) if each.variant == "read otherwise")
    np.testing.assert_allclose(repair.apply(wrong).draws, cases.draws, rtol=1e-6)
    assert "b is in the column of a and is drawn as " in repair.words


def test_factors_are_found_and_taken_out():
    cases = exact()
    wrong = cases.drawn(cases.draws / [1.0, 1000.0, 1.0])
    (repair,) = unit(wrong)
    assert repair.numbers == {"b": pytest.approx(1000.0, rel=0.05)}
    assert "b must be multiplied by 1" in repair.words
    np.testing.assert_allclose(repair.apply(wrong).draws, cases.draws, rtol=0.05)


def test_logarithms_are_read_as_such():
    cases = exact()
    draws = np.array(cases.draws)
    draws[..., 2] = np.log(draws[..., 2])
    wrong = cases.drawn(draws)
    (repair,) = log(wrong)
    np.testing.assert_allclose(repair.apply(wrong).draws, cases.draws, rtol=1e-6)
    assert repair.words.startswith("c is drawn as ")
    assert ";" not in repair.words


def test_signs_and_mirrors_are_turned_back():
    cases = exact()
    centre = np.median(cases.theta, axis=0)
    for about, words in ((np.zeros(3), "the other sign"), (centre, "the other way round")):
        wrong = cases.drawn(np.where([True, False, True], 2 * about - cases.draws, cases.draws))
        repair = next(each for each in sign(wrong) if each.variant == words)
        assert repair.numbers == {"a": -1.0, "c": -1.0}
        assert repair.words == f"a, c have {words}"
        np.testing.assert_allclose(repair.apply(wrong).draws, cases.draws)


def test_factors_below_one_are_found_too_and_small_ones_are_a_width_s_matter():
    cases = exact()
    wrong = cases.drawn(cases.draws * [50.0, 1.0, 1.3])
    (repair,) = unit(wrong)
    assert repair.numbers == {"a": pytest.approx(0.02, rel=0.05)}
    assert repair.neutral == 1.0
    assert repair.words == f"a must be multiplied by {repair.numbers['a']:.4g}"
    np.testing.assert_array_equal(repair.apply(wrong).draws[..., 1:], wrong.draws[..., 1:])


def test_logarithms_of_two_and_powers():
    cases = exact()
    wrong = cases.drawn(
        np.stack([10 ** cases.draws[..., 0], cases.draws[..., 1], np.log10(cases.draws[..., 2])], -1)
    )
    (repair,) = log(wrong)
    first, last = repair.words.split("; ")
    assert first.startswith("a is drawn as 10 to the power of it")
    assert last.startswith("c is drawn as ")
    mended = repair.apply(wrong).draws
    np.testing.assert_allclose(mended, cases.draws, rtol=1e-6)
    np.testing.assert_array_equal(mended[..., 1], wrong.draws[..., 1])
    # What cannot be read so is as far out as numbers go, and no infinity.
    wrong.draws[3, 4] = [0.0, 1.0, 400.0]
    assert repair.apply(wrong).draws[3, 4].tolist() == [-1e300, 1.0, 1e300]


def test_one_column_has_the_other_sign_and_is_turned_about_nothing():
    cases = exact()
    wrong = cases.drawn(cases.draws * [1.0, -1.0, 1.0])
    repair = next(each for each in sign(wrong) if each.variant == "the other sign")
    assert (repair.words, repair.numbers, repair.neutral) == ("b has the other sign", {"b": -1.0}, 1.0)
    np.testing.assert_array_equal(repair.apply(wrong).draws, cases.draws)


def test_columns_are_read_otherwise_only_where_that_foretells_far_better():
    cases = exact()
    for factor in (1.02, 1.04):
        wrong = cases.drawn(factor * cases.draws[..., [1, 0, 2]])
        assert [(repair.variant, list(repair.numbers.values())) for repair in columns(wrong)] == [
            ("", [1, 0, 2])
        ]
    wrong = cases.drawn(40.0 * cases.draws[..., [1, 0, 2]])
    assert "read otherwise" in [repair.variant for repair in columns(wrong)]
