"""What repairs are made of, and what cases know of their draws: each against a loop."""

from functools import partial

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.diagnosis.cases import Cases, places_within, scores_in, thirds
from gaugeblock.diagnosis.library.calls import standardised
from gaugeblock.diagnosis.library.marginal import moved, stretched
from gaugeblock.diagnosis.repair import (
    Repair,
    as_data,
    few_values,
    from_data,
    in_steps,
    listed,
    plain_repair,
    root,
    rows_of,
    weighted,
)


def made(n=30, draws=17, *, rounded=False):
    rng = np.random.default_rng(1)
    theta, drawn = rng.normal(size=(n, 2)), rng.normal(size=(n, draws, 2))
    if rounded:
        theta, drawn = np.round(2 * theta), np.round(2 * drawn)
    return Cases(("a", "b"), np.arange(n), theta, drawn, rng.normal(size=(n, 3)), ("u", "v", "w"))


@pytest.mark.parametrize("rounded", [False, True])
@pytest.mark.parametrize("draws", [16, 17])
def test_cases_know_middles_widths_and_ranks(draws, rounded):
    cases = made(draws=draws, rounded=rounded)
    low, middle, high = np.quantile(cases.draws, [0.16, 0.5, 0.84], axis=1)
    np.testing.assert_allclose(cases.middle, middle)
    np.testing.assert_allclose(cases.half_width, np.maximum((high - low) / 2, 1e-300), atol=1e-12)
    assert (cases.half_width > 0).all()
    for trial in range(len(cases)):
        for k in range(2):
            own, at = cases.draws[trial, :, k], cases.theta[trial, k]
            below, equal = np.sum(own < at), np.sum(own == at)
            expected = (below + equal / 2 + 0.5) / (draws + 1)
            assert cases.ranks(cases.theta)[trial, k] == pytest.approx(expected)
            place = places_within(cases.draws)[trial, :, k]
            assert place.tolist() == np.argsort(np.argsort(own, kind="stable")).tolist()
            all_at = scores_in(cases.draws, cases.theta)[trial, :, k]
            among = cases.theta[:, k]
            share = [(np.sum(among < v) + np.sum(among == v) / 2 + 0.5) / 31 for v in own]
            np.testing.assert_allclose(all_at, stats.norm.ppf(share), atol=1e-9)


def test_some_of_the_cases_keep_what_belongs_to_them():
    cases = made()
    some = cases.taken(np.array([4, 2]))
    assert (len(some), some.trial.tolist()) == (2, [4, 2])
    for name in ("theta", "draws", "x"):
        np.testing.assert_array_equal(getattr(some, name), getattr(cases, name)[[4, 2]])
    parts = thirds(31, 5)
    assert sorted(map(len, parts)) == [10, 10, 11]
    assert sorted(np.concatenate(parts).tolist()) == list(range(31))
    assert all((np.diff(part) > 0).all() for part in parts)


def test_a_root_is_found_or_the_nearer_end():
    wanted = np.array([-3.0, 0.5, 9.0, -9.0])
    found = root(lambda at: wanted - at, np.full(4, -4.0), np.full(4, 4.0))
    np.testing.assert_allclose(found, [-3.0, 0.5, 4.0, -4.0], atol=1e-4)


def test_others_stand_in_turn_for_draws_that_are_left_out():
    cases = made(4, 6)
    kept = np.array([[1, 0, 1, 0, 0, 0], [1] * 6, [0] * 6, [0, 1, 1, 1, 1, 0]], dtype=bool)
    found = rows_of(cases, kept).draws
    turns = ([0, 2, 0, 2, 0, 2], range(6), range(6), [1, 2, 3, 4, 1, 2])
    for trial, turn in enumerate(turns):
        np.testing.assert_array_equal(found[trial], cases.draws[trial, list(turn)])


def test_draws_are_resampled_as_often_as_their_weights_say():
    cases = made(20, 50)
    log = np.random.default_rng(2).normal(size=(20, 50)) + 700.0
    found = weighted(cases, log).draws
    share = np.exp(log - 700.0) / np.exp(log - 700.0).sum(axis=1, keepdims=True)
    often = (found[:, None, :, 0] == cases.draws[:, :, None, 0]).sum(axis=2)
    assert (often.sum(axis=1) == 50).all()
    assert np.abs(often - 50 * share).max() < 1
    never = np.where(np.arange(50) < 3, -np.inf, log)
    assert not np.isin(weighted(cases, never).draws[..., 0], cases.draws[:, :3, 0]).any()
    # Where they begin is another place in each trial.
    assert len(np.unique(np.argmax(weighted(made(20, 50), 0 * log + log[:1]).draws[..., 0], axis=1))) > 1


def test_few_values_are_kept_to():
    rng = np.random.default_rng(3)
    theta = np.stack([rng.choice([0.0, 1.0, 5.0], 60), rng.normal(size=60)], axis=1)
    columns, steps = few_values(theta)
    assert (columns.tolist(), steps.tolist()) == ([0, 0, 0], [0.0, 1.0, 5.0])
    cases = Cases(("a", "b"), np.arange(60), theta, rng.normal(2.0, 3.0, (60, 8, 2)))
    mended = in_steps(cases, lambda each: each.drawn(each.draws + 1.0), columns, steps).draws
    np.testing.assert_array_equal(mended[..., 1], cases.draws[..., 1] + 1.0)
    nearest = np.abs(cases.draws[..., :1] + 1.0 - steps).argmin(axis=2)
    np.testing.assert_array_equal(mended[..., 0], steps[nearest])


def test_those_that_stand_out_are_listed():
    sizes = np.array([1.0, 2.0, 0.5, 1.2, 3.0, 1.9, 0.1])
    names = list("abcdefg")
    assert listed(names, sizes, neutral=1.0, by="") == "b 2, e 3, f 1.9, g 0.1"
    assert listed(["a", "b"], np.array([0.0, -0.4]), "{:+.1f}") == "b by -0.4"
    assert listed(["a"], np.array([0.4])) == "a by 0.4"


INNER = partial(moved, by=np.array([0.5, -1.0]), in_widths=True)
MENDED = partial(in_steps, mend=INNER, columns=np.array([0, 0]), steps=np.array([1.0, 2.0]))
DATA = {
    "function": "in_steps",
    "mend": {"function": "moved", "by": [0.5, -1.0], "in_widths": True},
    "columns": [0, 0],
    "steps": [1.0, 2.0],
}


def test_repairs_as_plain_data_and_back():
    assert as_data(MENDED) == DATA
    again = from_data(DATA, where="here")
    assert again.func is in_steps
    assert (again.keywords["mend"].func, again.keywords["mend"].keywords["in_widths"]) == (moved, True)
    np.testing.assert_array_equal(again(made()).draws, MENDED(made()).draws)
    assert as_data(partial(stretched, by=np.float64(2.0), about="mean")) == {
        "function": "stretched", "by": 2.0, "about": "mean"
    }  # fmt: skip
    for none in (
        moved,
        lambda cases: cases,
        partial(lambda cases, by: cases, by=1),
        partial(moved, made(), by=1.0, in_widths=True),
        partial(in_steps, mend=partial(lambda cases: cases), columns=[], steps=[]),
    ):
        assert as_data(none) is None


def test_all_of_a_repair_can_be_written_down_or_nothing():
    def of(apply, **options):
        return Repair("a", apply, "words", **options)

    turn = partial(standardised, zero=0.0, unit=2.0)
    moves = {"function": "moved", "by": [0.5, -1.0], "in_widths": True}
    turns = {"function": "standardised", "zero": 0.0, "unit": 2.0}
    assert plain_repair([of(INNER), of(lambda cases: cases, turn=turn)]) == (moves, turns)
    assert plain_repair([of(INNER), of(lambda cases: cases)]) == ()
    assert plain_repair([]) == ()


def test_what_this_version_does_not_know_is_told():
    for data, said in (
        ("moved", "here: no repair of this version: 'moved'; diagnose the audit again"),
        ({"function": "f" * 90}, f"here: no repair of this version: {'f' * 60!r}; diagnose the audit again"),
        ({"by": 1}, "here: no repair of this version: 'None'; diagnose the audit again"),
        ({"function": "moved"}, "here: moved does not take nothing"),
        ({"function": "moved", "by": 1}, "here: moved does not take by"),
        (
            {"function": "moved", "by": 1, "in_widths": True, "k": 2},
            "here: moved does not take by, in_widths, k",
        ),
        (
            {**DATA, "mend": {"function": "no"}},
            "here: no repair of this version: 'no'; diagnose the audit again",
        ),
    ):
        with pytest.raises(InputError) as caught:
            from_data(data, where="here")
        assert str(caught.value) == said
