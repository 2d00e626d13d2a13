from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from gaugeblock.validate import family as module
from gaugeblock.validate.family import Judgeable, bounds, bounds_at, exact_bounds, families, maxima
from gaugeblock.validate.finding import CountFinding, MeanFinding, QuantileFinding, RootFinding
from gaugeblock.validate.joint.importance import importance_findings
from gaugeblock.validate.quantiles import order_statistic_bounds


def test_maxima_of_one_component_are_students_t():
    largest = maxima([np.random.default_rng(0).normal(size=(1, 30))], seed=1)
    assert np.quantile(largest, 0.95) == pytest.approx(stats.t.ppf(0.975, 29), rel=0.02)


def test_maxima_of_independent_and_of_equal_components():
    rng = np.random.default_rng(2)
    apart = maxima([rng.normal(size=(20, 20_000))], seed=1)
    assert np.quantile(apart, 0.95) == pytest.approx(stats.norm.ppf((1 + 0.95 ** (1 / 20)) / 2), rel=0.02)
    equal = maxima([np.tile(rng.normal(size=20_000), (20, 1))], seed=1)
    assert np.quantile(equal, 0.95) == pytest.approx(1.96, rel=0.02)


def test_maxima_agree_with_multipliers_on_the_trials():
    """The shortcut through the correlation matrix against 4,000 explicit multiplier replicates: 5%."""
    rng = np.random.default_rng(3)
    influence = rng.normal(size=(8, 500)) + rng.normal(size=500)
    influence -= influence.mean(axis=1, keepdims=True)
    scale = np.sqrt((influence**2).sum(axis=1))
    explicit = np.abs(rng.normal(size=(4000, 500)) @ influence.T / scale).max(axis=1)
    shortcut = maxima([influence], seed=1)
    for level in (0.5, 0.9, 0.95):
        assert np.quantile(shortcut, level) == pytest.approx(np.quantile(explicit, level), rel=0.05)


@pytest.mark.parametrize("parameters", [1, 40])
def test_maxima_of_many_correlated_components_are_hardly_larger_than_they_should_be(parameters):
    """600 components, each much like that of the next parameter, against explicit multipliers: never below,
    but for 40,000 replicates' error, and 1% above; the same at one parameter, where none is."""
    rng = np.random.default_rng(11)
    shared = rng.normal(size=(600 // parameters, 1, 900))
    influence = (0.8 * shared + 0.6 * rng.normal(size=(600 // parameters, parameters, 900))).reshape(600, 900)
    scale = np.sqrt((influence**2).sum(axis=1))
    weights = rng.normal(size=(20_000, 900))
    explicit = np.abs(weights @ influence.T / scale).max(axis=1)
    found = maxima([influence[:250], influence[250:]], seed=1)
    for level in (0.5, 0.95):
        assert -0.004 < np.quantile(found, level) / np.quantile(explicit, level) - 1 < 0.012


def test_maxima_of_blocks_hold_their_level_at_the_worst():
    """One component 600 times: what blocks add is that of three instead of one, and never less than it."""
    found = maxima([np.tile(np.random.default_rng(12).normal(size=5000), (600, 1))], seed=1)
    three = stats.norm.ppf((1 + 0.95 ** (1 / 3)) / 2)
    assert np.quantile(found, 0.95) == pytest.approx(three, rel=0.01)


def test_maxima_are_deterministic_and_survive_components_that_never_vary():
    influence = np.vstack([np.random.default_rng(4).normal(size=(2, 100)), np.zeros((1, 100))])
    np.testing.assert_array_equal(maxima([influence], seed=5), maxima([influence], seed=5))
    assert not np.array_equal(maxima([influence], seed=5), maxima([influence], seed=6))
    assert np.isfinite(maxima([np.zeros((3, 10))], seed=1)).all()


@pytest.mark.parametrize("n", [10, 51, 200])
def test_order_statistic_bounds_miss_no_more_often_than_they_say(n):
    """Median of an exponential, 4,000 samples, 5% each side; within the 0.999 binomial quantile."""
    values = np.random.default_rng(n).exponential(size=(4000, n))
    found = np.array([order_statistic_bounds(row, 0.5, 0.05) for row in values])
    most = stats.binom.ppf(0.999, 4000, 0.05)
    assert np.count_nonzero(found[:, 0] > np.log(2)) <= most
    assert np.count_nonzero(found[:, 1] < np.log(2)) <= most


def test_too_few_values_for_a_bound():
    assert order_statistic_bounds(np.arange(3.0), 0.5, 0.05) == (-np.inf, np.inf)


def held(findings) -> list[Judgeable]:
    return [Judgeable(finding=finding, low=-0.1, high=0.1) for finding in findings]


def test_findings_on_the_same_trials_are_one_family(marginal_findings):
    ess = Judgeable(finding=importance_findings(np.zeros((9, 30)))[0], low=0.1, high=np.inf)
    one, other = (held(marginal_findings("a", np.random.default_rng(n).normal(size=n))) for n in (50, 60))
    assert [len(family) for family in families([*one, ess, *other])] == [2, 1, 2]


@pytest.mark.usefixtures("quick_judging")
def test_simultaneous_intervals_hold_the_truth(marginal_findings):
    """Bias and width of three parameters, 300 repetitions: misses within binomial limits (0.001 each)."""
    missed = 0
    for seed in range(300):
        t = np.random.default_rng([7, seed]).normal(size=(3, 400))
        family = held(finding for row in t for finding in marginal_findings("p", row))
        found = bounds(family, budget=0.05, number=1, seed=seed)
        missed += any((bound.low > 0).any() or (bound.high < 0).any() for bound in found)
    assert stats.binom.ppf(0.001, 300, 0.03) <= missed <= stats.binom.ppf(0.999, 300, 0.05)


@pytest.mark.parametrize("which", [0, 1])
def test_adjusted_p_value_and_interval_agree(marginal_findings, which):
    """The adjusted p-value is below the budget just when the simultaneous interval is outside."""
    decided = set()
    for fault in np.linspace(0.1, 0.45, 41):
        t = np.random.default_rng(8).normal(size=400)
        t = np.exp(-fault) * t if which else t + fault
        (bound,) = bounds(held(marginal_findings("a", t)[which : which + 1]), budget=0.05, number=2, seed=1)
        outside = (bound.low > 0.1).any()
        assert (bound.p_adjusted.min() <= 0.05) == outside
        assert bound.p_adjusted.min() >= bound.p_value.min()
        decided.add(bool(outside))
    assert decided == {True, False}


def means(estimate, influence, error, **more) -> MeanFinding:
    said = {"id": "a", "quantity": "", "claim": "", "null": "", "reference": ""} | more
    return MeanFinding(
        estimate=np.array(estimate), influence=influence, standard_error=np.array(error),
        n_trials=influence.shape[1], **said,
    )  # fmt: skip


def test_families_are_of_one_population_and_number_and_counts_of_none():
    rng = np.random.default_rng(1)
    a, b, c, d = (
        Judgeable(
            finding=means([0.0], rng.normal(size=(1, n)), [1.0], id=name, population=name[0]), low=-1, high=1
        )
        for name, n in (("x1", 5), ("y1", 5), ("x2", 5), ("x3", 6))
    )
    count = CountFinding(
        id="n", quantity="", claim="", null="", reference="", n_trials=5,
        estimate=np.array([3.0, 0.0]), standard_error=np.zeros(2),
    )  # fmt: skip
    counted = Judgeable(finding=count, low=0, high=0)
    assert [[i.finding.id for i in found] for found in families([a, counted, b, c, d])] == [
        ["x1", "x2"], ["y1"], ["x3"],
    ]  # fmt: skip
    bound = exact_bounds(counted)
    for row in (bound.low, bound.high, bound.pass_low, bound.pass_high):
        assert row.tolist() == [3.0, 0.0]
    assert np.isnan([bound.p_value, bound.p_adjusted]).all()
    assert np.shape(bound.p_value) == np.shape(bound.p_adjusted) == (2,)
    assert (bound.critical, bound.next_critical) == (0.0, 0.0)


@pytest.mark.parametrize("look", [1, 2])
def test_bounds_follow_from_the_replicates_by_hand(look):
    """Two findings of one family, a third of a budget of 30%: quantiles of the maxima, errors times t."""
    rng = np.random.default_rng(5)
    influences = rng.normal(size=(2, 21)), rng.normal(size=(1, 21))
    first = means([0.0, 1.5], influences[0], [0.5, 0.25])
    second = means([-2.0], influences[1], [0.4])
    family = [Judgeable(finding=first, low=-1.0, high=1.0), Judgeable(finding=second, low=-1.0, high=1.0)]
    one, other = bounds(family, budget=0.3, number=3, seed=4, look=look)
    largest = np.sort(maxima(influences, seed=4))
    shares = {1: 0.8, 2: 0.1, 3: 0.2 / 6}
    critical, following = (
        largest[int(np.ceil((1 - 0.1 * shares[at]) * (len(largest) - 1)))] for at in (look, look + 1)
    )
    for bound in (one, other):
        assert bound.critical == pytest.approx(critical, rel=1e-9)
        assert bound.next_critical == pytest.approx(following, rel=1e-9)
    np.testing.assert_allclose(one.high, [0.5 * critical, 1.5 + 0.25 * critical])
    np.testing.assert_allclose(one.low, [-0.5 * critical, 1.5 - 0.25 * critical])
    np.testing.assert_allclose(other.low, [-2.0 - 0.4 * critical])
    far = stats.t.isf(0.05 * shares[look], 20)
    np.testing.assert_allclose(one.pass_low, [-0.5 * far, 1.5 - 0.25 * far])
    np.testing.assert_allclose(other.pass_high, [-2.0 + 0.4 * far])
    np.testing.assert_allclose(one.p_value, stats.t.sf([-2.0, 2.0], 20))
    np.testing.assert_allclose(other.p_value, stats.t.sf([2.5], 20))
    for bound, place, outside in ((one, 1, 2.0), (other, 0, 2.5)):
        beyond = (1 + np.count_nonzero(largest >= outside)) / (1 + len(largest))
        wanted = 3 * min(beyond, 6 * stats.t.sf(outside, 20)) / shares[look]
        assert bound.p_adjusted[place] == pytest.approx(min(wanted, 1.0))
    assert one.p_adjusted[0] == 1.0


def test_far_in_the_tail_replicates_are_not_counted():
    """Of 40,000 replicates ten must lie beyond; a smaller level is shared among all components' sides."""
    influence = np.random.default_rng(6).normal(size=(3, 50))
    family = [Judgeable(finding=means([9.0] * 3, influence, [1.0] * 3), low=-1.0, high=1.0)]
    (bound,) = bounds(family, budget=10.4 / 40_000 / 0.8, number=1, seed=1)
    largest = np.sort(maxima([influence], seed=1))
    assert bound.critical in largest[-12:-8]
    (bound,) = bounds(family, budget=9.9 / 40_000 / 0.8, number=1, seed=1)
    assert bound.critical == pytest.approx(stats.t.isf(9.9 / 40_000 / 6, 49))
    assert bound.critical not in largest
    np.testing.assert_allclose(bound.p_adjusted, 6 * stats.t.sf(8.0, 49) / 0.8)


def test_bounds_of_quantiles_with_values_that_are_no_numbers():
    """These are on the bad side; p-values are binomial chances of so many values beyond the edge."""
    rows = np.array([np.r_[np.arange(1.0, 30.0), np.nan], np.r_[np.nan, np.nan, np.arange(28.0, 0, -1)]])
    q = np.array([0.3, 0.6])

    def found(sense, low, high):
        finding = QuantileFinding(
            id="a", quantity="", claim="", null="", reference="", n_trials=30, sense=sense, values=rows,
            quantile=q, estimate=np.zeros(2), standard_error=np.zeros(2),
        )  # fmt: skip
        item = Judgeable(finding=finding, low=low, high=high)
        return finding, bounds([item], budget=0.05, number=1, seed=1)[0]

    for sense, filled, low, high in (("at-least", -np.inf, 20.5, np.inf), ("at-most", np.inf, -np.inf, 9.5)):
        finding, bound = found(sense, low, high)
        values = np.where(np.isnan(rows), filled, rows)
        for k in range(2):
            at = order_statistic_bounds(values[k], q[k], 0.01)
            assert tuple(side[k] for side in bounds_at(finding, 0.01, 29)) == at
            assert (bound.pass_low[k], bound.pass_high[k]) == order_statistic_bounds(values[k], q[k], 0.04)
            below, above = np.sum(values[k] < low), np.sum(values[k] > high)
            wanted = min(stats.binom.sf(below - 1, 30, q[k]), stats.binom.sf(above - 1, 30, 1 - q[k]))
            assert bound.p_value[k] == pytest.approx(wanted)
    # Nothing beyond an edge is no evidence at all.
    assert found("two-sided", -1.0, np.inf)[1].p_value.tolist() == [1.0, 1.0]


def test_bounds_of_a_root_are_where_its_curve_is_off_by_its_error():
    place = np.array([0.0, 1.0, 2.0, 4.0])
    curve = np.array([[-0.6, -0.1, 0.3, 0.9], [-0.02, 0.0, 0.01, 0.02], [0.0, 0.1, 0.1, 0.3]])
    influence = np.random.default_rng(7).normal(scale=0.3, size=(3, 12))
    finding = RootFinding(
        id="a", quantity="", claim="", null="", reference="", n_trials=12, curve=curve, place=place,
        influence=influence, estimate=np.array([1.25, 1.0, 0.0]), standard_error=np.ones(3),
    )  # fmt: skip
    error = np.sqrt(((influence**2).sum(axis=1) + 10 / 12) / 22 / 12)
    tail = 0.03
    low, high = bounds_at(finding, tail, 11)
    reach = stats.t.isf(tail, 11) * error
    for k in range(3):
        inverse = np.interp([-reach[k], reach[k]], curve[k], place)
        assert low[k] == (-np.inf if -reach[k] <= curve[k, 0] else pytest.approx(inverse[0]))
        assert high[k] == (np.inf if reach[k] > curve[k, -1] else pytest.approx(inverse[1]))
    assert np.isinf(low[1:]).all()
    assert np.isfinite(low[0])
    assert np.isinf(high[1])
    assert np.isfinite(high[[0, 2]]).all()
    (bound,) = bounds([Judgeable(finding=finding, low=0.5, high=1.0)], budget=0.05, number=1, seed=1)
    # The curves at the edges, by the line between places: -0.35 and -0.1, -0.01 and 0, 0.05 and 0.1.
    outside = np.maximum(-np.array([-0.1, 0.0, 0.1]), [-0.35, -0.01, 0.05]) / error
    np.testing.assert_allclose(bound.p_value, stats.t.sf(outside, 11))


def test_pieces_of_trials_and_of_components_add_up(monkeypatch):
    """Blocks of two, pieces of seven trials and one left over: maxima of independent blocks."""
    rng = np.random.default_rng(8)
    shared = rng.normal(size=36)
    influence = np.stack([shared, 2 * shared, -shared, rng.normal(size=36), np.zeros(36)])
    whole = maxima([influence], seed=1)
    monkeypatch.setattr(module, "TRIALS", 7)
    np.testing.assert_allclose(maxima([influence[:2], influence[2:]], seed=1), whole, rtol=1e-3)
    monkeypatch.setattr(module, "BLOCK", 2)
    blocked = maxima([influence], seed=1)
    # Two equal ones, two almost independent, one that never varies: four t that share their chi2.
    z = np.abs(np.random.default_rng(9).standard_normal((200_000, 4))).max(axis=1)
    t = z / np.sqrt(np.random.default_rng(10).chisquare(35, 200_000) / 35)
    assert len(blocked) == 40_000
    for level in (0.5, 0.9, 0.99):
        assert np.quantile(blocked, level) == pytest.approx(np.quantile(t, level), rel=0.02)
