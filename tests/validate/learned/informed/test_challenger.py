"""What a challenger sees, foretells and names, by hand from its parts."""

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate.learned.informed import challenger as module
from gaugeblock.validate.learned.informed.challenger import Known, fit_challenger, place_among
from gaugeblock.validate.learned.informed.data import make_data
from gaugeblock.validate.learned.informed.location import fit_location
from gaugeblock.validate.learned.informed.pools import Pools, rank_scores
from gaugeblock.validate.learned.informed.ridge import fit_ridge
from gaugeblock.validate.learned.informed.terms import parameters_of, regressed_terms, values_of
from gaugeblock.validate.learned.informed.trees import fit_trees


def known(n=90, *, channels=3, periods=None, features=0):
    rng = np.random.default_rng(1)
    x = rng.normal(size=(n, channels))
    values = rng.normal(size=(n, 7, 2))
    values[:, 0] = x[:, :2] + 0.5 * rng.normal(size=(n, 2))
    values[:, :, 1] = (values[:, :, 1] + 3.0) % 6.0 - 3.0
    centre = rng.normal(size=(n, 2)) * [0.0, 1.0]
    pools = Pools(
        values, rank_scores(values, rng.random((n, 7))), values.mean(axis=1), values.std(axis=1), centre,
        rng.random(n), periods or {},
    )  # fmt: skip
    names = [f"own {k}" for k in range(features)]
    called = [f"x[{k}]" for k in range(channels)]
    data = make_data(x, rng.normal(size=(n, features)), channels=called, names=names)
    return Known(pools, data, pools.summaries(), ("a", "b"))


def test_a_place_among_the_candidates_is_a_normal_score():
    """Ties count half; what is circular is compared with the pool the short way round."""
    seen = known(12, periods={1: 6.0})
    guess = seen.pools.values[:, 3] + seen.pools.centre
    guess[:4] = [[0.1, 7.5], [50.0, -7.5], [-50.0, 30.2], [0.0, 2.9]]
    rows = np.array([11, 0, 1, 2, 3, 7])
    found = place_among(seen.pools, rows, guess[rows])
    for place, row in zip(found, rows, strict=True):
        for k in range(2):
            at = guess[row, k] - seen.pools.centre[row, k]
            at = (at + 3.0) % 6.0 - 3.0 if k == 1 else at
            pool = seen.pools.values[row, :, k]
            below, equal = np.sum(pool < at - 1e-12), np.sum(np.abs(pool - at) <= 1e-12)
            if k == 0 or equal == 0:  # a turn and back moves the last bit
                assert place[k] == pytest.approx(stats.norm.ppf((below + equal / 2 + 0.5) / 8))


@pytest.mark.parametrize("periods", [None, {1: 6.0}])
@pytest.mark.parametrize("most", [40, 2])
def test_what_is_foretold_and_from_what(periods, most, monkeypatch):
    """Everything that is known side by side; trees see few of the channels, those that foretell most."""
    monkeypatch.setattr(module, "SPLIT_CHANNELS", most)
    seen, terms, taught = known(periods=periods, features=1), regressed_terms(2), np.arange(10, 80)
    found = fit_challenger(seen, terms, taught)
    truth = seen.pools.values[taught, 0] + seen.pools.centre[taught]
    location = fit_location(seen.data.values[taught], truth, periods or {})

    def wide(rows):
        expected = location(seen.data.values[rows])
        place = place_among(seen.pools, rows, location.values(expected))
        return np.concatenate([seen.data.values[rows], seen.summaries[rows], place, expected], axis=1)

    targets = values_of(terms.every, seen.pools.scores[taught, 0])
    ridge = fit_ridge(wide(taught), targets)
    left = (targets - ridge(wide(taught)))[:, :5]
    kept = [0, 1, 2]
    if most == 2:
        own = seen.data.values[taught][:, :3]
        told = [max(max(abs(c @ t), abs((c**2 - 1) @ t)) for t in left.T) for c in own.T]
        kept = sorted(np.argsort(told)[-2:].tolist())
    split = [*kept, *range(3, wide(taught).shape[1])]
    assert found.split.tolist() == split
    trees = fit_trees(wide(taught)[:, split], left)
    rows = np.array([0, 85, 40])
    linear, treed = found(seen, rows)
    wanted = ridge(wide(rows)) - targets.mean(axis=0)
    np.testing.assert_allclose(linear, wanted, atol=1e-4)
    np.testing.assert_allclose(treed, trees(wide(rows)[:, split]), atol=1e-4)
    names = found.inputs(seen)
    assert len(names) == wide(rows).shape[1]
    said = [
        "x[0]", "x[1]", "x[2]", "own 0", "the width of the draws of a", "the width of the draws of b",
        "the mean of the draws of a", "the mean of the draws of b",
    ]  # fmt: skip
    expected = [f"where a regression on the data expects {name}" for name in "ab"]
    among = [f"{one} among the draws" for one in expected]
    if periods:
        angle = "the angle of b"
        assert names == [*said, angle, *among, *expected, angle, angle]
    else:
        assert names == [*said, *among, *expected]


def test_what_a_term_is_foretold_from_is_named_in_terms_of_the_data():
    seen, terms = known(200), regressed_terms(2)
    found = fit_challenger(seen, terms, np.arange(200))
    names = found.inputs(seen)
    for term in range(len(terms.every)):
        largest = int(np.argmax(np.abs(found.ridge.coefficient[1:, term])))
        said = found.looked_at(term, seen, trees=False)
        parameters = list(parameters_of(terms.every[term]))
        if largest < 3 or not parameters:
            assert said == (names[largest],)
        else:
            weight = np.abs(found.location.ridge.coefficient[1:, parameters]).sum(axis=1)
            assert said == (f"x[{int(np.argmax(weight))}]",)
    assert found.looked_at(0, seen, trees=False) == ("x[0]",)
    assert found.looked_at(1, seen, trees=False) == ("x[1]",)
    for term in range(5):
        grown = found.trees.trees[term]
        said = found.looked_at(term, seen, trees=True)
        if not grown:
            assert said == ()
            continue
        strongest = sorted(grown, key=lambda tree: tree.gain)[-1]
        wanted = [names[found.split[split.input]] for split in strongest.splits]
        assert said == tuple(wanted if wanted[0] != wanted[1] else wanted[:1])
