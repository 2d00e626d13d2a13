"""Draws that are wrong in a part of the data: where it begins, and that nothing beyond it is touched."""

import numpy as np
import pytest

from gaugeblock.diagnosis.cases import Cases, scores_in
from gaugeblock.diagnosis.disagreement import Reference
from gaugeblock.diagnosis.library.place import ignored_parameter, only_there, region


def counted(shift, *, trials=4000, draws=64):
    """Exact draws whose data are a count of 0 to 9; moved by a function of the count."""
    rng = np.random.default_rng(4)
    count = rng.integers(0, 10, trials).astype(float)
    centre = rng.normal(size=(trials, 1))
    theta = centre + rng.normal(size=(trials, 1))
    drawn = centre[:, None] + rng.normal(size=(trials, draws, 1))
    drawn += shift(count)[:, None, None]
    return Cases(("a",), np.arange(trials), theta, drawn, np.stack([centre[:, 0], count], axis=1), ("c", "n"))


@pytest.mark.parametrize(("above", "said"), [(True, "where n > 6 ("), (False, "where n <= 2 (")])
def test_a_repair_of_a_part_of_the_data_ends_where_it_says(above, said):
    cases = counted(lambda count: 1.5 * ((count > 6) if above else (count <= 2)))
    moved = next(repair for repair in region(cases) if repair.variant == "shift")
    assert moved.words.startswith(said)
    mended = moved.apply(cases).draws
    count = cases.x[:, 1]
    wrong = (count > 6) if above else (count <= 2)
    assert f"({wrong.mean():.0%} of the trials)" in moved.words
    np.testing.assert_array_equal(mended[~wrong], cases.draws[~wrong])
    assert np.median(cases.draws[wrong] - mended[wrong]) == pytest.approx(1.5, abs=0.1)


def test_what_is_right_everywhere_has_no_such_part():
    for repair in region(counted(np.zeros_like)):
        assert all(abs(number - repair.neutral) < 0.2 for number in repair.numbers.values())


def test_where_is_said_by_the_draws_too_and_by_these_alone_without_data():
    """Draws twice as wide where those of a are large, in a third of the trials."""
    rng = np.random.default_rng(6)
    centre = rng.normal(size=(3000, 2))
    theta = centre + 0.1 * rng.normal(size=(3000, 2))
    away = 0.1 * rng.normal(size=(3000, 80, 2))
    high = centre[:, 0] > np.quantile(centre[:, 0], 0.65)
    draws = centre[:, None] + away * np.where(high, 2.0, 1.0)[:, None, None]
    cases = Cases(("a", "b"), np.arange(3000), theta, draws)
    moved, wide = region(cases)
    assert (moved.symptom, moved.variant, wide.symptom, wide.variant) == (
        "region",
        "shift",
        "region",
        "scale",
    )
    for repair in (moved, wide):
        assert repair.words.startswith("where the draws of a > ")
        assert "(35% of the trials) " in repair.words
    assert list(wide.numbers.values()) == pytest.approx([2.0, 2.0], rel=0.1)
    assert wide.apply.keywords["place"] == 0
    mended = wide.apply(cases).draws
    inside = cases.middle[:, 0] > wide.apply.keywords["cut"]
    np.testing.assert_array_equal(mended[~inside], draws[~inside])
    assert np.median(mended[inside].std(axis=1)) == pytest.approx(0.1, rel=0.1)
    nobody = only_there(cases, lambda part: part.drawn(part.draws + 1), place=1, cut=1e9, above=True)
    assert nobody is cases
    everybody = only_there(cases, lambda part: part.drawn(part.draws + 1), place=1, cut=1e9, above=False)
    np.testing.assert_array_equal(everybody.draws, draws + 1)


def test_of_few_trials_there_is_no_part():
    cases = counted(lambda count: 1.5 * (count > 6)).taken(slice(30))
    assert region(cases) == []


def known(trials=1500, draws=60):
    """Two parameters that the data know, of which the draws of b are the prior's."""
    rng = np.random.default_rng(7)
    x = rng.normal(size=(trials, 2))
    theta = x + 0.5 * rng.normal(size=(trials, 2))
    drawn = x[:, None] + 0.5 * rng.normal(size=(trials, draws, 2))
    drawn[..., 1] = np.sqrt(1.25) * rng.normal(size=(trials, draws))
    return Cases(("a", "b"), np.arange(trials), theta, drawn, x, ("x[0]", "x[1]"))


def test_a_parameter_whose_draws_do_not_know_the_data():
    cases = known()
    reference = Reference.of(cases)
    (repair,) = ignored_parameter(cases, reference)
    correlation = np.corrcoef(reference.foretell(cases)[:, 1], scores_in(cases.theta, cases.theta)[:, 1])[
        0, 1
    ]
    assert correlation == pytest.approx(1 / np.sqrt(1.25), abs=0.03)
    assert repair.numbers == {"b": pytest.approx(correlation)}
    assert repair.words == (
        "draws of b are the same whatever the data, from which a regression foretells it (correlation "
        f"{correlation:.2f})"
    )
    assert repair.recovers == 0.0
    mended = repair.apply(cases).draws
    np.testing.assert_array_equal(mended[..., 0], cases.draws[..., 0])
    # What is left is what the data do not say.
    assert np.median(mended[..., 1].std(axis=1)) == pytest.approx(0.5, rel=0.1)
    assert np.corrcoef(np.median(mended[..., 1], axis=1), cases.x[:, 1])[0, 1] > 0.97
    order = np.argsort(cases.draws[3, :, 1])
    assert (np.diff(mended[3, order, 1]) >= 0).all()
    both = cases.drawn(np.stack([cases.draws[..., 1], cases.draws[..., 1]], axis=2))
    (repair,) = ignored_parameter(both, reference)
    assert "draws of a, b are" in repair.words
    assert "foretells them" in repair.words
    assert list(repair.numbers) == ["a", "b"]


def test_what_data_do_not_say_is_not_ignored():
    cases = known()
    rng = np.random.default_rng(8)
    other = Cases(
        cases.names, cases.trial, cases.theta, cases.draws, rng.normal(size=(1500, 2)), cases.inputs
    )
    assert ignored_parameter(other, Reference.of(other)) == []
    without = Cases(cases.names, cases.trial, cases.theta, cases.draws)
    assert ignored_parameter(without, Reference.of(without)) == []
    sound = cases.drawn(np.stack([cases.draws[..., 0], cases.draws[..., 0]], axis=2))
    assert ignored_parameter(sound, Reference.of(cases)) == []
