"""What validators see of hand-made trials: which, in which blocks, with which words of caution."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from gaugeblock.core.streams import Rows
from gaugeblock.validate import prepared as module
from gaugeblock.validate import storage
from gaugeblock.validate.autocorrelation import DrawOrder
from gaugeblock.validate.features import fit_summariser
from gaugeblock.validate.joint import pool
from gaugeblock.validate.joint.pool import make_pool
from gaugeblock.validate.joint.projections import projections
from gaugeblock.validate.joint.tarp import tarp
from gaugeblock.validate.policy import Levels
from gaugeblock.validate.prepared import Prepared, count_not_finite, trial_numbers, values_per_trial
from gaugeblock.validate.ranks import randomised_pit
from gaugeblock.validate.standardised import standardised_errors
from gaugeblock.validate.trials import make_trials, trials_tree


def numbered(numbers, n=3):
    return trial_numbers(xr.Dataset({"a": ("trial", np.zeros(n))}, coords={"trial": ("trial", numbers)}))


def test_trials_keep_their_own_numbers_where_these_can_be_numbers():
    assert numbered([5, 0, 9]).tolist() == [5, 0, 9]
    assert numbered(np.array([5, 2, 9], dtype=np.int16)).dtype == np.int64
    for useless in ([5, 5, 9], [-1, 0, 1], [0.5, 1.5, 2.5], ["a", "b", "c"]):
        assert numbered(useless).tolist() == [0, 1, 2]
    assert trial_numbers(xr.Dataset({"a": ("trial", np.zeros(4))})).tolist() == [0, 1, 2, 3]


@pytest.fixture
def trials():
    """Seven trials of six draws, the fourth and the fifth with something that is no number."""
    rng = np.random.default_rng(1)
    draws, log_q = rng.normal(size=(7, 6, 2)).astype(np.float32), rng.normal(size=(7, 6))
    draws[3, 1, 0], draws[3, 1, 1], draws[3, 5, 1] = np.nan, np.inf, -np.inf
    log_q[4, :2] = np.nan
    weight = rng.exponential(size=(7, 6))
    made = make_trials(
        rng.normal(size=(7, 2)).astype(np.float32), draws, ["a", "b"], x=rng.normal(size=(7, 3)), log_q=log_q,
        weight=weight, log_likelihood=log_q + 1, log_prior=log_q + 2, log_q_true=np.arange(7),
        log_likelihood_true=np.arange(7) + 10, log_prior_true=np.arange(7) + 20,
    )  # fmt: skip
    return made.assign(
        own=("trial", np.arange(7) * 3),
        quantity_each=(("trial", "draw"), rng.normal(size=(7, 6)).astype(np.float32)),
        quantity_true=("trial", np.arange(7.0)),
    ).assign_coords(trial=[16, 12, 11, 10, 15, 13, 14])


def test_trials_with_draws_that_are_no_numbers_are_left_out(trials, monkeypatch):
    for values in (storage.VALUES, 1):  # all in one block, and each in its own
        monkeypatch.setattr(storage, "VALUES", values)
        assert count_not_finite(trials).tolist() == [[0, 0]] * 3 + [[2, 0], [0, 2]] + [[0, 0]] * 2
        made = Prepared(trials_tree(trials), 1)
        assert made.unaffected.tolist() == [True] * 3 + [False] + [True] * 3
        assert made.trial.tolist() == [16, 12, 11, 15, 13, 14]
        np.testing.assert_array_equal(
            made.theta_true, np.delete(trials["theta_true"].values.astype(float), 3, axis=0)
        )
        assert made.theta_true.dtype == np.float64
        assert [len(x) for x in made.data()] == ([6] if values > 1 else [1] * 6)
        np.testing.assert_array_equal(np.concatenate(list(made.data())), np.delete(trials["x"].values, 3, 0))
    assert count_not_finite(trials.isel(trial=[0, 4, 3])).tolist() == [[0, 0], [0, 2], [2, 0]]
    assert count_not_finite(trials.drop_vars("log_q"))[:, 1].tolist() == [0] * 7
    assert values_per_trial(trials) == 12
    assert values_per_trial(trials.isel(trial=slice(0, 0))) == 0


def test_blocks_hold_all_that_the_trials_have(trials, monkeypatch):
    kept = [0, 1, 2, 4, 5, 6]
    monkeypatch.setattr(storage, "VALUES", 24)  # two trials a block, where all are unaffected
    made = Prepared(trials_tree(trials), 1)
    blocks = list(made.blocks())
    assert [len(block) for block in blocks] == [2, 1, 2, 1]
    assert [(block.rows.start, block.rows.stop) for block in blocks] == [(0, 2), (2, 3), (3, 5), (5, 6)]
    assert all(block.prepared is made for block in blocks)

    def held(of):
        return np.concatenate([of(block) for block in blocks])

    assert held(lambda block: block.trial).tolist() == [16, 12, 11, 15, 13, 14]
    for name in ("draws", "theta_true", "x", "weight", "log_q", "log_likelihood", "log_prior", "log_q_true",
                 "log_likelihood_true", "log_prior_true"):  # fmt: skip
        found = held(lambda block, name=name: getattr(block, name))
        np.testing.assert_array_equal(found, trials[name].values[kept].astype(float), err_msg=name)
        assert found.dtype == np.float64
    assert set(blocks[0].own) == {"own", "quantity_each", "quantity_true"}
    assert held(lambda block: block.own["own"]).tolist() == [0, 3, 6, 12, 15, 18]
    assert held(lambda block: block.own["quantity_each"]).dtype == np.float64
    np.testing.assert_array_equal(
        held(lambda block: block.own["quantity_each"]), trials["quantity_each"].values[kept].astype(float)
    )
    bare = next(Prepared(trials_tree(trials[["theta_true", "draws"]]), 1).blocks())
    assert (bare.x, bare.weight, bare.log_q, bare.log_prior_true, bare.own) == (None, None, None, None, {})


def test_a_trial_that_thinning_leaves_no_weight_counts_its_draws_equally(trials):
    weight = np.zeros((7, 6))
    weight[:, 1::2] = 2.0
    made = Prepared(trials_tree(trials.assign(weight=(("trial", "draw"), weight))), 1)
    vars(made)["order"] = DrawOrder(2, 3.0)
    assert made.kept_draws == 3
    (block,) = made.blocks()
    assert block.draws.shape == (6, 3, 2)
    place = made.thinned(np.tile(np.arange(6), (6, 1)), made.trial)
    assert set(place[:, 0].tolist()) == {0, 1}
    np.testing.assert_array_equal(block.weight, np.where(place % 2 == 1, 2.0, 1.0))
    kept = np.delete(trials["draws"].values, 3, axis=0)
    np.testing.assert_array_equal(block.draws, np.take_along_axis(kept, place[..., None], axis=1))
    np.testing.assert_array_equal(
        block.own["quantity_each"],
        np.take_along_axis(np.delete(trials["quantity_each"].values, 3, 0), place, axis=1),
    )


def test_thinning_starts_anywhere_that_leaves_as_many():
    """Of eleven draws every fourth, two: from one of the first seven, by a random number of the trial's."""
    made = Prepared(trials_tree(make_trials(np.zeros((9, 1)), np.zeros((9, 11, 1)))), 3)
    vars(made)["order"] = DrawOrder(4, 11.0)
    trial = np.arange(9)
    found = made.thinned(np.tile(np.arange(11.0)[:, None] + [[0.0, 0.5]], (9, 1, 1)), trial)
    first = np.floor(7 * Rows(3, "thinning", trial).random((9, 1)))
    np.testing.assert_array_equal(found, np.stack([first + [[0, 4]], first + [[0.5, 4.5]]], axis=2))


def test_weights_are_used_and_random_numbers_are_the_trials_own(trials):
    made = Prepared(trials_tree(trials), 7)
    (block,) = made.blocks()
    assert block.rng("a").random((6, 2)).tolist() == Rows(7, "a", made.trial).random((6, 2)).tolist()
    for found, of, purpose in (
        (made.pit, randomised_pit, "ranks"),
        (made.errors, standardised_errors, "standardised errors"),
    ):
        wanted = of(block.theta_true, block.draws, Rows(7, purpose, made.trial), weight=block.weight)
        np.testing.assert_array_equal(found, wanted)
    effective = [sum(w) ** 2 / sum(w * w) for w in block.weight]
    assert made.effective_draws == pytest.approx(np.mean(effective))
    unweighted = Prepared(trials_tree(trials.drop_vars("weight")), 7)
    assert unweighted.effective_draws == 6.0
    assert not np.array_equal(unweighted.pit, made.pit)


def test_the_first_trials_are_those_of_the_lowest_numbers(trials):
    levels = Levels(coverage=(0.5,))
    made = Prepared(trials_tree(trials), 5, levels)
    assert made.first(None) is made.first(7) is made.first(8) is made
    three = made.first(3)
    assert three.main["trial"].values.tolist() == [12, 11, 10]
    assert (three.seed, three.levels) == (5, levels)
    assert made.first(5).main["trial"].values.tolist() == [12, 11, 10, 13, 14]
    np.testing.assert_array_equal(made.first(5).main["x"].values, trials["x"].values[[1, 2, 3, 5, 6]])
    assert made.first(1).main["trial"].values.tolist() == [10]


def test_each_statistic_is_computed_once_in_one_pass(trials, monkeypatch):
    monkeypatch.setattr(storage, "VALUES", 24)
    made, asked = Prepared(trials_tree(trials), 1), []

    def number(block):
        asked.append(("number", len(block)))
        return block.trial

    def two(block):
        asked.append(("two", len(block)))
        return np.stack([block.draws.sum(axis=(1, 2)), block.draws[:, 0, 0]], axis=1)

    made.compute([number, two, number])
    assert asked == [(name, n) for n in (2, 1, 2, 1) for name in ("number", "two")]
    assert made.per_trial(number).tolist() == made.trial.tolist()
    assert made.per_trial(number).dtype == np.int64
    kept = np.delete(trials["draws"].values.astype(float), 3, axis=0)
    np.testing.assert_allclose(made.per_trial(two), np.stack([kept.sum(axis=(1, 2)), kept[:, 0, 0]], axis=1))
    assert len(asked) == 8
    nothing = Prepared(trials_tree(trials.isel(trial=[3])), 1)
    assert nothing.per_trial(two).shape == (0, 2)
    made_of = []
    assert made.once(lambda of: made_of.append(of) or "made") == "made"

    def once(of):
        made_of.append(of)
        return len(made_of)

    assert (made.once(once), made.once(once), made_of) == (2, 2, [made, made])


def test_what_several_statistics_need_of_a_block_is_made_once_and_for_this_block_alone(trials, monkeypatch):
    made = []

    def total(block):
        made.append(block)
        return float(block.draws.sum())

    block, *others = Prepared(trials_tree(trials), 1).blocks()
    assert [block.once(total), block.once(total)] == 2 * [block.draws.sum()]
    assert len(made) == 1
    # Another block with the same trials and other draws is another one.
    moved = replace(block, draws=block.draws + 1)
    assert moved.once(total) == pytest.approx(block.draws.sum() + block.draws.size)
    assert not others
    pools = []
    monkeypatch.setattr(
        pool, "make_pool", lambda *given, **words: pools.append(1) or make_pool(*given, **words)
    )
    for statistic in (tarp, projections):
        statistic(block)
    assert len(pools) == 1


def test_features_are_of_data_and_of_the_user_s_own_numbers(trials, monkeypatch):
    monkeypatch.setattr(module, "FITTED", 4)
    trials = trials.assign(log_evidence_own=("trial", np.zeros(7)))
    found = Prepared(trials_tree(trials), 1).features
    assert found.names == ("total", "component 1", "component 2", "component 3", "own")
    assert found.column("own").tolist() == [0, 3, 6, 12, 15, 18]
    x = np.delete(trials["x"].values, 3, axis=0)
    np.testing.assert_allclose(found.values[:, :-1], fit_summariser(x[:4])(x))
    alone = Prepared(trials_tree(trials.drop_vars("x")), 1).features
    assert (alone.names, alone.values.tolist()) == (("own",), [[0], [3], [6], [12], [15], [18]])
    assert Prepared(trials_tree(trials.drop_vars(["x", "own"])), 1).features is None
    assert Prepared(trials_tree(trials.isel(trial=[3])), 1).features is None


def test_what_is_said_of_the_draws(trials):
    made = Prepared(trials_tree(trials), 1)
    weighted = "weighted draws: ranks are exact only as far as the weights represent the posterior"
    left_out = "1 of 7 trials have NaN or infinite draws; left out here"
    assert made.caveats == (left_out, weighted)
    assert made.too_dependent == ""
    again = Prepared(trials_tree(trials.drop_vars("weight")), 1)
    vars(again)["order"] = DrawOrder(2, 49.6)
    order = "draws depend on their order: 6 are worth about 50"
    assert again.caveats == (left_out, f"{order}; every 2th used, from each trial's own start, 3 a trial")
    assert again.too_dependent.startswith(f"{order}; 50 are needed: draw more (")
    for enough in (DrawOrder(2, 50.0), DrawOrder(1, 6.0)):
        vars(again)["order"] = enough
        assert again.too_dependent == ""


def test_the_order_is_measured_on_the_same_trials_in_any_order(monkeypatch):
    """Every second of the trials by number, of which the odd ones alone are chains."""
    rng = np.random.default_rng(2)
    draws = rng.normal(size=(120, 40, 1))
    draws[1::2] = np.repeat(draws[1::2, :10], 4, axis=1)
    order = rng.permutation(120)
    trials = make_trials(np.zeros((120, 1)), draws).assign_coords(trial=np.arange(120)).isel(trial=order)
    monkeypatch.setattr(module, "measured_trials", lambda n, values: np.arange(n // 2) * 2 + (values != 40))
    assert Prepared(trials_tree(trials), 1).order.stride == 1
    monkeypatch.setattr(module, "measured_trials", lambda n, values: np.arange(n // 2) * 2 + 1)
    assert Prepared(trials_tree(trials), 1).order.stride == 4
    nothing = Prepared(trials_tree(trials.assign(draws=trials["draws"] * np.nan)), 1)
    assert nothing.order == DrawOrder(1, 40.0)


def test_circular_parameters_come_cut_open():
    trials = make_trials([[0.1]], [[[6.2], [0.2], [6.1]]], ["angle"], circular=["angle"])
    (block,) = Prepared(trials_tree(trials), 1).blocks()
    apart = block.draws[0, :, 0] - block.theta_true[0, 0]
    np.testing.assert_allclose(apart, [6.1 - 2 * np.pi, 0.1, 6.0 - 2 * np.pi], atol=1e-12)
