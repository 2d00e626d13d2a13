"""Draws that were drawn again from fewer: told from discrete posteriors, rounding, heaps and chains."""

import numpy as np
import pytest

from gaugeblock.validate import Outcome, judge, make_trials, read_policy, run_validators
from gaugeblock.validate.autocorrelation import draw_order
from gaugeblock.validate.repeats import repeated

N, DRAWS = 1000, 250


def again(few, rng, draws=DRAWS):
    """So many draws, drawn again from those ``(trial, draw, parameter)`` that there are."""
    place = rng.integers(few.shape[1], size=(len(few), draws))
    return np.take_along_axis(few, place[:, :, None], axis=1)


@pytest.mark.parametrize("parameters", [1, 3])
@pytest.mark.parametrize("distinct", [40, 200, 1000])
def test_what_was_drawn_again_is_worth_what_there_was(distinct, parameters):
    """A pair is the same one time in as many as there were; the commonest of a trial stays out."""
    rng = np.random.default_rng(distinct)
    few, truth = rng.normal(size=(N, distinct, parameters)), rng.normal(size=(N, parameters))
    draws = again(few, rng)
    share = repeated(draws, truth)
    assert share == pytest.approx(1 / distinct, rel=0.15)
    assert draw_order(draws).stride == 1
    stride, worth = draw_order(draws, share)
    assert worth == pytest.approx(1 / (1 / DRAWS + 1 / distinct), rel=0.1)
    # What is left adds 0.15 of a draw, or 0.2% of those that are used.
    assert (DRAWS // stride) * share <= max(0.16, 0.0021 * DRAWS)
    assert stride == 1 or (DRAWS // (stride - 1)) * share > 0.14


def atoms(rng, size, at, share):
    return np.where(rng.random(size) < share, at, rng.normal(size=size))


HONEST = {
    "coins": lambda rng, place, size: rng.integers(0, 2, size).astype(float),
    "three of its own": lambda rng, place, size: place + rng.integers(0, 3, size),
    "rare atom": lambda rng, place, size: atoms(rng, size, 0.0, 0.01),
    "an atom of its own": lambda rng, place, size: atoms(rng, size, place, 0.3),
    "two of its own": lambda rng, place, size: atoms(rng, size, place + 9.0 * rng.integers(0, 2, size), 0.3),
    "continuous": lambda rng, place, size: place + rng.normal(size=size),
}


@pytest.mark.parametrize("shape", HONEST)
def test_what_truths_do_as_well_is_no_copy(shape):
    """False alarm 1e-3 in each of 20: none with 98% in all shapes but continuous ones, which have none."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        place = rng.normal(size=(200, 1, 1))
        draws, truth = (HONEST[shape](rng, place, (200, many, 1)) for many in (60, 1))
        assert repeated(draws, truth[:, 0]) == 0.0


def test_what_is_wrong_otherwise_stays_to_be_judged():
    rng = np.random.default_rng(5)
    place, truth = rng.normal(size=(N, 1, 1)), rng.normal(size=(N, 1))
    size = (N, DRAWS, 1)
    assert repeated(np.broadcast_to(place, size), truth) == 0.0  # a point
    assert repeated(atoms(rng, size, place, 0.3), truth) == 0.0  # a heap that is not there
    for some in (N, 30):  # rounded as numbers are printed, and as halves are
        assert repeated(np.round(rng.normal(size=(some, DRAWS, 1)), 2), truth[:some]) == 0.0
        narrow = place[:some] + 0.02 * rng.normal(size=(some, DRAWS, 1))
        assert repeated(narrow.astype(np.float16), place[:some, 0] + 0.01 * truth[:some]) == 0.0
    # Each trial has some few halves that no other has; truths are rounded like them, but not like integers.
    far = 40.0 * np.arange(25.0)[:, None] + 1000.0 + rng.normal(size=(25, 1))
    assert repeated((far[:, None] + rng.normal(size=(25, DRAWS, 1))).astype(np.float16), far) == 0.0
    whole = np.round(far[:, None] + rng.normal(size=(25, DRAWS, 1))).astype(int)
    assert repeated(whole, far + 0.3) > 0.1
    stays = np.repeat(rng.normal(size=(N, 50, 1)), 5, axis=1)
    assert repeated(stays, truth) == 0.0  # a chain's order says it
    assert repeated(rng.permuted(stays, axis=1), truth) == pytest.approx(4 / 249, rel=0.1)
    assert repeated(np.empty((0, 9, 1)), np.empty((0, 1))) == repeated(stays[:, :1], truth) == 0.0


def test_what_a_posterior_repeats_by_itself_is_taken_off():
    """Fifty values of each trial's own, drawn again from forty: copies are one in forty of what differs, less
    the commonest, which has three or so of the forty; with what repeats by itself one in twenty-seven.
    """
    rng = np.random.default_rng(7)
    place = rng.normal(size=(N, 1, 1))
    draws = again(place + rng.integers(0, 50, (N, 40, 1)), rng)
    assert repeated(draws, place[:, 0] + rng.integers(0, 50, (N, 1))) == pytest.approx(0.98 / 40, rel=0.33)


def test_few_trials_are_enough_where_copies_are_many():
    """13 of 100 draws are copies: with truths, 24 of 101 are no trial's commonest and repeated; that no truth
    of 40 trials is one has a chance of 2e-5, and of half as many 4e-3.
    """
    rng = np.random.default_rng(8)
    distinct, truth = rng.normal(size=(40, 87, 1)), rng.normal(size=(40, 1))
    draws = np.concatenate([distinct, distinct[:, :13]], axis=1)
    assert repeated(draws, truth) == pytest.approx(12 / 2500)
    assert repeated(draws[:20], truth[:20]) == 0.0


def test_zero_is_zero_and_all_parameters_count():
    rng = np.random.default_rng(6)
    few, truth = rng.normal(size=(200, 20, 2)), rng.normal(size=(200, 2))
    draws = again(few, rng, 100)
    signs = np.where(rng.random((200, 100)) < 0.5, 0.0, -0.0)
    assert repeated(
        np.concatenate([draws, signs[..., None]], axis=2), np.column_stack([truth, truth[:, 0]])
    ) == (repeated(draws, truth))
    draws[..., 1] = rng.normal(size=(200, 100))
    assert repeated(draws, truth) == 0.0


@pytest.mark.parametrize(("distinct", "judged"), [(40, False), (150, True)])
def test_exact_posteriors_that_were_drawn_again_do_not_fail(distinct, judged):
    rng = np.random.default_rng(23)
    x = rng.normal(size=(2000, 1))
    truth, few = x + rng.normal(size=(2000, 1)), x[:, None] + rng.normal(size=(2000, distinct, 1))
    found, not_checked = run_validators(make_trials(truth, again(few, rng), x=x), seed=1)
    verdict = judge(found, not_checked, read_policy("default"), seed=1)
    assert all(gate.outcome is not Outcome.FAIL for gate in verdict.gates)
    told = [gate.message for gate in verdict.gates if gate.id.startswith("sbc.bias")]
    assert all(("copies of each other: 250 are worth about" in one) is not judged for one in told)
    assert any("copies of each other" in caveat for one in found for caveat in one.caveats)
