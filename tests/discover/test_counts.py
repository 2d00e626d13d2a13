"""The workflow on counts in which the effect is known: named, told apart, unnamed, or nothing to name."""

from dataclasses import dataclass, replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binom, norm

from gaugeblock.core.errors import InputError
from gaugeblock.discovery import Candidates, Sources, discover_source
from gaugeblock.discovery.counts import Counts
from gaugeblock.discovery.engine import Comparison, Round
from gaugeblock.simulators import Prior, Uniform
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.library import Known

THETA = np.array([20_000.0, 1.5])


@pytest.fixture(scope="module")
def library(power_law):
    simulator = power_law()
    return Candidates.of(simulator, THETA[None])


def run(library, hidden, data_seed, **options):
    """Search data of the library's simulator with effects hidden in it."""
    true = library.simulator
    for effect in hidden:
        true = true.with_effect(effect)
    counts = true.simulate(THETA[None], np.random.default_rng(data_seed))
    return discover_source(Sources.of(library.simulator, counts), library=library, replicates=399, **options)


@pytest.mark.parametrize(
    ("effect", "amplitude"),
    [
        (Effect("line", {"energy": 3.3, "counts": 900.0}), 900.0),
        (Effect("dip", {"energy": 1.7, "depth": 0.12}), 0.12),
        (Effect("dip", {"energy": 1.7, "depth": -0.12}), -0.12),
        (Effect("edge", {"energy": 2.4, "depth": 0.25}), 0.25),
    ],
    ids=["line", "dip up", "dip down", "edge"],
)
def test_names_what_is_hidden(library, effect, amplitude):
    found = run(library, [effect], 11)
    assert found.named == effect.name
    assert found.named_all == (effect.name,)
    gap = found.to_json()["gap"]
    assert gap["in_sample"]["after"] < gap["in_sample"]["before"]
    assert gap["held_out"]["after"] < gap["held_out"]["before"]
    assert found.candidate(effect.name).p_global == pytest.approx(1 / 400)
    measured = found.to_json()["amplitude"][0]
    low, high = measured["interval"]
    assert low - 0.5 * (high - low) < amplitude < high + 0.5 * (high - low)
    assert measured["held_out"]


def test_what_a_wrong_model_drags_along_does_not_float(library, monkeypatch):
    """A line beside a gap that nothing in the library explains: smooth curves of the area would fill it."""
    from gaugeblock.discovery import counts
    from gaugeblock.discovery.confirm import floated

    hidden = [
        Effect("line", {"energy": 3.3, "counts": 8000.0}),
        Effect("dip", {"energy": 1.0, "depth": -0.5}),
    ]
    lines = Candidates.of(library.simulator, THETA[None], only=("line",))

    def amplitude():
        return run(lines, hidden, 12).to_json()["amplitude"][0]["value"]

    said = amplitude()
    monkeypatch.setattr(floated, "FAR", np.inf)
    dragged = amplitude()
    monkeypatch.setattr(counts, "floated", lambda simulator, *_, **__: (simulator, _[-1]))
    assert said == pytest.approx(amplitude(), rel=1e-4) != pytest.approx(dragged, rel=1e-2)


def test_what_is_stored_follows_from_counts_and_fits(library):
    """Curve, gaps and places of a discovery, computed again from the counts and expectations in its tree."""
    found = run(library, [Effect("line", {"energy": 3.3, "counts": 900.0})], 11)
    spectrum, curve, scored = (found.tree[name] for name in ("spectrum", "quantiles", "held_out"))
    counts, before = spectrum["counts"].values, spectrum["before"].values
    total = before.sum()
    np.testing.assert_allclose(curve["expected"], np.cumsum(before) / total)
    np.testing.assert_allclose(curve["difference"], np.cumsum(counts - before) / np.sqrt(total), atol=1e-6)
    gap = found.to_json()["gap"]["held_out"]
    stored = dict(zip(scored["kind"].values, scored["deviance"].values, strict=True))
    assert stored["before"] == pytest.approx(gap["before"])
    assert stored["named"] == pytest.approx(gap["after"])
    (said,) = [one for one in found.to_json()["statements"] if one["effect"] == "line"]
    assert 2.8 < said["energy_lo_kev"] < 3.3 < said["energy_hi_kev"] < 3.8


def test_w_stands_beside_the_statistic_where_a_background_was_measured(power_law):
    class Beside(power_law):
        role = "background"

        def with_effect(self, effect):
            more = super().with_effect(effect)
            return Beside(more.effects, more.prior)

        def segments(self):
            (source,) = super().segments()
            return (replace(source, stop=40, edges=source.edges[:40]),
                    replace(source, start=40, edges=source.edges[40:], role=self.role))  # fmt: skip

        def w_statistic(self, theta, x, scale):
            return scale * (np.asarray(theta)[:, 1] + np.asarray(x).sum(axis=1))

    simulator = Beside()
    counts = np.round(simulator.expected(THETA[None]))
    library = Candidates.of(simulator, THETA[None], only=("edge",))
    sources = Sources.of(simulator, counts, scale=0.5)
    engine = Counts(sources, rng=np.random.default_rng(1), replicates=399, proposed=library)
    said = engine.state(None)
    assert said.w_statistic == pytest.approx(0.5 * (engine.base.theta[0, 1] + counts.sum()))
    assert (said.w_bins, said.bins) == (40, 60)
    (edge,) = engine.fitted(engine.look(), ["edge"], None)
    assert engine.state(edge).w_statistic == pytest.approx(0.5 * (edge.fit.theta[0, 1] + counts.sum()))
    simulator.role = "source"
    assert (engine.state(None).w_statistic, engine.state(None).w_bins) == (None, None)


def test_nothing_hidden_is_nothing_named(library):
    # Global p of 0.01 is asked for: of 60 quiet sources 0.6 would be named; 4 or more happen in 0.3%.
    named = [run(library, [], seed).named for seed in range(60)]
    assert sum(name is not None for name in named) < 4


def test_two_effects_are_both_named(library):
    hidden = [Effect("line", {"energy": 5.0, "counts": 700.0}), Effect("edge", {"energy": 1.2, "depth": 0.2})]
    found = run(library, hidden, 12)
    assert set(found.named_all) == {"line", "edge"}
    assert {one["effect"] for one in found.to_json()["amplitude"]} == {"line", "edge"}
    # Two in a row may also be how one shape is eaten up that no library has: the first does not stand alone.
    # Of the edge an area known to 2% leaves too little to be certain.
    assert [one.certain for one in found.statements if one.effect in ("edge", "line")].count(True) == 1
    assert found.indistinguishable[0] == found.named == "line"
    assert "unnamed" in found.indistinguishable


def test_of_equal_fits_the_order_that_was_tried_first_stands(library):
    counts = library.simulator.simulate(THETA[None], np.random.default_rng(16))
    sources = Sources.of(library.simulator, counts)
    engine = Counts(sources, rng=np.random.default_rng(17), replicates=399, proposed=library)
    (one,) = engine.fitted(engine.look(), ["line"], None)
    forth = replace(one, path=("line", "edge"))
    back = replace(one, path=("edge", "line"))
    assert (
        engine.compared([forth, replace(back, gain=one.gain + 0.5)], engine.look())[0].model.path
        == forth.path
    )
    assert (
        engine.compared([forth, replace(back, gain=one.gain + 5.0)], engine.look())[0].model.path == back.path
    )


def noise_free(library, *hidden):
    """An engine on the rounded mean of the library's simulator with effects, and that mean."""
    true = library.simulator
    for effect in hidden:
        true = true.with_effect(effect)
    counts = np.round(true.expected(THETA[None]))
    sources = Sources.of(library.simulator, counts)
    return Counts(sources, rng=np.random.default_rng(1), replicates=399, proposed=library), counts[0]


def rounds_of(seen, *models):
    """A round of some models, the best first."""
    return Round(seen, tuple(Comparison(one, 0.0, 0.0) for one in models))


def promised(simulator, change, floating, size):
    """Nats that a change of the expected counts ``(channel,)`` wins to second order, theta free and some
    columns of the mean's logarithm ``(channel, column)`` free with a standard deviation of `size`.
    """
    mean = simulator.expected(THETA[None])[0]
    step = np.diag(1e-4 * THETA)
    slopes = (simulator.expected(THETA + step) - simulator.expected(THETA - step)) / 2e-4
    root = np.sqrt(mean)
    # Theta as if its prior were a thousand times as wide as its values; all in standard errors.
    columns = np.concatenate([1e3 * slopes, size * (floating * mean[:, None]).T]) / root
    told = change / root
    return 0.5 * told @ np.linalg.solve(np.eye(60) + columns.T @ columns, told)


def test_what_an_area_known_to_two_per_cent_wins_instead_of_an_effect_of_the_source(library):
    """By second-order marginal likelihoods of noise-free counts, which share no code with the fits."""
    from gaugeblock.discovery.confirm.floated import AREA, BUMPS
    from gaugeblock.discovery.name.unnamed import curves

    smooth = curves(library.simulator, 60, most=BUMPS)
    without = library.simulator.expected(THETA[None])[0]

    def wins(counts):
        change = counts - without
        return np.subtract(*(promised(library.simulator, change, smooth, size) for size in (0.0, AREA)))

    edge, line = (
        Effect("edge", {"energy": 1.7, "depth": 0.1}),
        Effect("line", {"energy": 5.0, "counts": 700.0}),
    )
    alone = []
    for effect in (edge, line):
        engine, counts = noise_free(library, effect)
        seen = engine.look()
        (model,) = engine.fitted(seen, [effect.name], None)
        alone.append(wins(counts))
        assert engine.taken([rounds_of(seen, model)]) == pytest.approx([alone[-1]] * 2, rel=0.15)
    # Of both, each by what the area can do beside the other; and of both together.
    engine, counts = noise_free(library, edge, line)
    seen = engine.look()
    one, other = engine.fitted(seen, ["edge", "line"], None)
    (both,) = engine.fitted(engine.after(one), ["line"], one)
    made = [rounds_of(seen, one, other), rounds_of(engine.after(one), both)]
    assert engine.taken(made) == pytest.approx([*alone, wins(counts)], rel=0.3)
    # More than fits that end a thousandth of a nat apart could make.
    assert all(value > 0.5 for value in alone)
    # Of an instrument's effect nothing is taken.
    own = replace(both, entries=(replace(both.entries[0], origin="instrument"), both.entries[1]))
    assert engine.taken([made[0], rounds_of(seen, own)])[0] == 0.0
    dip, *_ = engine.fitted(seen, ["dip"], None)
    assert engine.taken([rounds_of(seen, dip)]) == (0.0, 0.0)


def test_an_engine_says_what_each_effect_is_worth_and_where_it_is(library):
    engine, counts = noise_free(
        library,
        Effect("line", {"energy": 5.0, "counts": 700.0}),
        Effect("edge", {"energy": 1.2, "depth": 0.2}),
    )
    seen, located = engine.look(), engine.located()
    assert seen.p_rest == pytest.approx(2.0 * min(located.values())) == 0.005
    signs = {np.sign(one.z) for one in engine.regions() if one.lo < 5.0 < one.hi}
    assert signs == {np.sign(one.excess) for one in engine.regions() if one.lo < 5.0 < one.hi} == {1.0}
    edge, line = engine.fitted(seen, ["edge", "line"], None)
    (both,) = engine.fitted(engine.after(edge), ["line"], edge)
    alone = [rounds_of(seen, *some) for some in ([edge, line], [edge])]
    last = rounds_of(engine.after(edge), both)
    assert engine.worth(alone[:1]) == (edge.merit,)
    assert engine.worth([alone[0], last]) == pytest.approx([both.merit - line.merit, both.merit - edge.merit])
    # What was not fitted alone is fitted now; of two of a kind each is worth what it won when it was added.
    assert engine.worth([alone[1], last]) == pytest.approx(engine.worth([alone[0], last]), abs=0.5)
    twice = rounds_of(seen, replace(both, path=("edge", "edge")))
    assert engine.worth([alone[0], twice]) == pytest.approx([edge.merit, both.merit - edge.merit])
    # All that is not fitted again is as in the fit: the expected counts with the line, and without.
    theta = both.fit.theta.copy()
    theta[0, -1] = 0.0
    mean = both.fit.expected[0]
    told = (mean - both.candidate.simulator.expected(theta)[0]) ** 2 / mean
    inside = next(k for k in range(60) if told[: k + 1].sum() >= 0.1 * told.sum())
    outside = next(k for k in range(60) if told[: k + 1].sum() >= 0.9 * told.sum())
    assert engine.place(both, 1) == pytest.approx(
        (engine.sources.edges[inside, 0], engine.sources.edges[outside, 1])
    )
    # Energies are those of a source's channels alone.
    (part,), edges = engine.sources.segments, engine.sources.edges
    for other in (replace(part, unit="channel"), replace(part, role="background")):
        elsewhere = SimpleNamespace(sources=SimpleNamespace(segments=(other,), edges=edges))
        assert Counts.place(elsewhere, both, 1) is None
    for model, fitted in ((None, engine.base), (both, both.fit)):
        safe, mean = np.maximum(counts, 1e-300), fitted.expected[0]
        total = 2.0 * (mean - counts + counts * np.log(safe / mean)).sum()
        state = engine.state(model)
        assert (state.statistic, 60 * engine.gap(model)) == pytest.approx((total, total), rel=1e-6)
    assert engine.data().counts == counts.sum()


def test_an_effect_at_the_end_of_its_prior_costs_25_nats_beside_its_odds(library):
    entry = library["dip"].entry
    depth = Uniform(-0.2, 0.2)
    entry = replace(entry, parameters={**entry.parameters, "depth": depth}, odds=0.5)
    narrow = Candidates(library.simulator, {"dip": entry})
    engine, _ = noise_free(narrow, Effect("dip", {"energy": 2.0, "depth": 0.3}))
    (one,) = engine.fitted(engine.look(), ["dip"], None)
    assert one.limits == [("dip", "depth")]
    assert one.cost == pytest.approx(25.0 + np.log(2.0))
    assert one.merit == pytest.approx(one.gain - 2.0 - one.cost)
    assert engine.at_edge([Round(engine.look(), (Comparison(one, 0.0, 0.0),))]) == [("dip", "depth")]
    (two,) = engine.fitted(engine.after(one), ["dip"], one)
    assert (two.path, two.size, len(two.added)) == (("dip", "dip"), 4, 2)
    stopped = [bool(entry.at_limit(values)) for values in two.added]
    assert two.limits == [("dip", "depth")] * sum(stopped)
    assert two.cost == pytest.approx(25.0 * sum(stopped) + 2 * np.log(2.0))
    objective = engine.base.objective[0] - two.fit.objective[0]
    assert two.gain == pytest.approx(objective)
    wide, _ = noise_free(library, Effect("dip", {"energy": 2.0, "depth": 0.3}))
    (inside,) = wide.fitted(wide.look(), ["dip"], None)
    assert (inside.limits, inside.cost) == ([], 0.0)


def test_behind_an_effect_templates_are_those_of_the_model_with_it(library):
    """A dip changes every channel by the same share of what is there, with a line or without."""
    engine, _ = noise_free(library, Effect("line", {"energy": 5.0, "counts": 2000.0}))
    (line,) = engine.fitted(engine.look(), ["line"], None)
    found = engine.after(line).state.templates
    rows, nodes = found.values[0, found.owner == "dip"], library["dip"].entry.nodes[:, 0]
    bell = np.exp(-0.5 * ((np.sqrt(engine.sources.edges.prod(axis=1)) - nodes[:, None]) / 0.4) ** 2)
    np.testing.assert_allclose(rows / line.fit.expected[0], bell, atol=1e-3)


def test_a_quiet_engine_doubles_the_rarer_p_of_its_looks_up_to_one(library):
    engine, _ = noise_free(library)
    assert engine.look().p_rest == 1.0


def test_a_first_effect_gives_way_only_beyond_two_paired_errors(library):
    engine, counts = noise_free(library, Effect("line", {"energy": 3.3, "counts": 900.0}))
    line, dip = engine.fitted(engine.look(), ["line", "dip"], None)
    error = np.sqrt((counts * np.log(line.fit.expected[0] / dip.fit.expected[0]) ** 2).sum())
    for lead, best in ((1.9, "dip"), (2.1, "line")):
        ahead = replace(line, gain=dip.merit + line.gain - line.merit + lead * error)
        made = engine.compared([ahead, dip], engine.look(), first="dip")
        assert made[0].model.path == (best,)
        assert engine.compared([ahead, dip], engine.look())[0].model.path == ("line",)


def test_what_the_library_lacks_has_no_name(power_law, library):
    # Waves of five per cent over the whole band: no line, dip or edge.
    wavy = library.simulator.expected(THETA) * (1.0 + 0.05 * np.sin(np.arange(60) * 0.5))
    counts = np.random.default_rng(13).poisson(wavy * 10)
    found = discover_source(Sources.of(library.simulator, counts), library=library, replicates=399)
    assert found.named == "unnamed"
    assert found.named_all == ()
    assert found.p_global < 0.01
    (said,) = [one for one in found.to_json()["statements"] if one["effect"] == "unnamed"]
    size = said["parameters"]["excess_counts"]
    assert said["certain"]
    assert size["low"] < size["value"] < size["high"]
    assert not size["low"] < 0.0 < size["high"]
    assert (said["energy_lo_kev"], said["energy_hi_kev"]) != (None, None)
    assert [one["parameter"] for one in found.to_json()["amplitude"]] == ["excess_counts"]
    factor = found.tree["shape"]["factor"].values
    assert np.corrcoef(factor[8:-8], np.sin(np.arange(60) * 0.5)[8:-8])[0, 1] > 0.8


@pytest.mark.parametrize(
    ("certain", "beside"),
    [
        ((), {"line": ("edge", "line"), "edge": ("edge", "line")}),
        ({1}, {"line": ("line",), "edge": ("edge", "line")}),
        ({0}, {"line": ("edge", "line"), "edge": ("edge",)}),
        ({0, 1}, {"line": ("edge", "line"), "edge": ("edge", "line")}),
    ],
)
def test_what_is_certain_is_measured_beside_nothing_that_is_not(library, monkeypatch, certain, beside):
    engine, _ = noise_free(
        library,
        Effect("line", {"energy": 5.0, "counts": 700.0}),
        Effect("edge", {"energy": 1.2, "depth": 0.2}),
    )
    (edge,) = engine.fitted(engine.look(), ["edge"], None)
    (both,) = engine.fitted(engine.after(edge), ["line"], edge)
    measured, halves = {}, []

    def held_out(place, sources, start, *, rng):
        names = place.simulator.prior.names
        assert place.entry.amplitude in names[place.index]
        # Energies have no error of the fit where the amplitude comes from.
        kept = [name for name in ("edge", "line") if any(own.startswith(name) for own in names)]
        assert place.key not in measured, "measured twice"
        measured[place.key] = (tuple(kept), start)
        halves.append(rng)
        return SimpleAmplitude(place.key, {})

    monkeypatch.setattr("gaugeblock.discovery.counts.held_out_amplitude", held_out)
    monkeypatch.setattr("gaugeblock.discovery.counts.profiled_energies", lambda *_: {})
    rounds = [Round(engine.look(), (Comparison(both, 0.0, 0.0),))]
    assert [one.effect for one in engine.amplitudes(rounds, certain)] == ["edge", "line"]
    assert {key: kept for key, (kept, _) in measured.items()} == beside
    assert halves[0] is not halves[1]
    for kept, start in measured.values():
        # Where the fit of that very model is, beside what floats of an instrument.
        model = both if len(kept) == 2 else engine.fitted(engine.look(), list(kept), None)[0]
        own = model.fit.theta[0]
        assert start[0, : len(own)] == pytest.approx(own, rel=0.2)


@dataclass(frozen=True)
class SimpleAmplitude:
    effect: str
    others: dict


def test_an_excess_beside_effects_is_what_they_leave(library):
    """Beside an edge the line is left, and nothing beside both."""
    edge, line = (
        Effect("edge", {"energy": 1.2, "depth": 0.3}), Effect("line", {"energy": 5.0, "counts": 1500.0}),
    )  # fmt: skip
    engine, counts = noise_free(library, edge, line)
    (one,) = engine.fitted(engine.look(), ["edge"], None)
    (both,) = engine.fitted(engine.after(one), ["line"], one)
    rounds = [Round(engine.look(), (Comparison(both, 0.0, 0.0),))]
    left, whole, bare = (engine.excess(rounds, path) for path in (("edge",), ("edge", "line"), ()))
    assert left.lo < 5.0 < left.hi
    inside = (engine.sources.edges[:, 0] >= left.lo - 1e-9) & (engine.sources.edges[:, 1] <= left.hi + 1e-9)
    truth = (counts - library.simulator.with_effect(edge).expected(THETA))[inside].sum()
    assert 0.0 < left.size.low < truth < left.size.high
    assert whole.size.low < 0.0 < whole.size.high
    assert engine.excess(rounds, ("edge",)) == left != bare


def test_neighbours_that_data_cannot_tell_apart_are_a_set(library):
    # An upward dip of 0.4 keV and a line of 0.15 keV are much alike while they are faint.
    found = run(library, [Effect("line", {"energy": 3.3, "counts": 900.0})], 11)
    assert {"line", "dip"} <= set(found.indistinguishable)


def test_the_same_seed_gives_the_same_answer(library):
    effect = Effect("line", {"energy": 3.3, "counts": 900.0})
    first, again = (run(library, [effect], 11, seed=3) for _ in range(2))
    assert first.to_json() == again.to_json()
    assert first.tree.identical(again.tree)


def test_only_restricts_the_search(power_law):
    simulator = power_law()
    counts = simulator.simulate(THETA[None], np.random.default_rng(15))
    found = discover_source(Sources.of(simulator, counts), only=("dip",), replicates=399)
    assert [one["effect"] for one in found.to_json()["candidates"]] == ["dip"]
    with pytest.raises(InputError, match="no effect glow; there are line, dip, edge"):
        discover_source(Sources.of(simulator, counts), only=("glow",))


@pytest.mark.parametrize(
    ("counts", "message"),
    [
        (np.zeros(60), "holds no counts"),
        (np.full(60, 0.5), "channel 0 holds 0.5; discovery needs raw counts"),
        (np.full(60, np.nan), "whole numbers of at least 0"),
        (np.full(60, -1.0), "whole numbers of at least 0"),
    ],
    ids=["empty", "fraction", "nan", "negative"],
)
def test_bad_counts_are_refused(power_law, counts, message):
    with pytest.raises(InputError, match=message):
        Sources.of(power_law(), counts)


def test_fewer_replicates_than_every_look_needs_are_refused(power_law):
    sources = Sources.of(power_law(), power_law().expected(THETA).round())
    with pytest.raises(InputError, match=r"needs at least 399 replicates, got 398: .* global p of 0\.01$"):
        discover_source(sources, replicates=398)


def test_with_the_fewest_replicates_what_only_a_window_sees_is_found(library):
    # One channel alone: narrower than a line or an edge of the library.
    counts = library.simulator.expected(THETA * np.array([5.0, 1.0]))
    counts[30] *= 1.3
    found = discover_source(Sources.of(library.simulator, counts.round()), library=library, replicates=399)
    assert found.disagreement.p_windows == 1 / 400
    assert found.p_global <= 0.01


def test_one_trial_is_paid_for_an_energy_that_was_stated_before_the_scan(power_law):
    simulator, theta = power_law(), np.array([20_000.0, 1.5])
    mean = simulator.with_effect(Effect("line", {"energy": 3.3, "counts": 200.0})).expected(theta)
    sources = Sources.of(simulator, np.round(mean)[None], redshift=np.array([1.0]))
    search = partial(discover_source, sources, only=("line",), replicates=999)
    stated, scanned = search(energy=6.6).candidate("line"), search().candidate("line")
    # At rest, so half of it as recorded; one standard normal against the largest of thirty-six.
    assert stated.parameters["energy"] == pytest.approx(3.3, rel=0.01)
    expected = norm.sf(stated.z)
    assert 0.02 < expected < 0.1
    low, high = binom.interval(0.999, 999, expected)
    assert low <= 1000 * stated.p_global <= high + 1
    assert scanned.p_global > 5 * stated.p_global
    with pytest.raises(InputError, match="no effect that is searched for has one"):
        discover_source(sources, only=("dip",), energy=6.6)
    with pytest.raises(InputError, match=r"from 0\.6 to 7\.5 keV can be stated, got 8"):
        search(energy=16.0)


def test_a_fit_does_not_leave_an_energy_that_was_stated(power_law):
    simulator, theta = power_law(), np.array([20_000.0, 1.5])
    mean = simulator.with_effect(Effect("line", {"energy": 3.3, "counts": 9_000.0})).expected(theta)
    found = discover_source(Sources.of(simulator, np.round(mean)[None]), energy=3.2, replicates=399)
    assert 3.168 <= found.candidate("line").parameters["energy"] <= 3.232
    assert [one.effect for one in found.candidates] == ["line"]
    above = discover_source(Sources.of(simulator, np.round(mean)[None]), energy=3.4, replicates=399)
    assert 3.366 <= above.candidate("line").parameters["energy"] <= 3.434


def test_a_line_is_told_by_its_name_where_that_is_no_chance(power_law):
    simulator, theta = power_law(), np.array([200_000.0, 1.5])
    known = (Known("toy alpha", 6.6, 0), Known("toy beta", 9.0, 1))
    line = replace(simulator.effect_library(theta[None])["line"], known=known)
    mean = simulator.with_effect(Effect("line", {"energy": 3.3, "counts": 60_000.0})).expected(theta)
    sources = Sources.of(simulator, np.round(mean)[None], redshift=np.array([1.0]))
    found = discover_source(sources, effects={"line": line}, only=("line",), replicates=399)
    (said,) = found.statements[:1]
    assert [one.name for one in said.identification] == ["toy alpha"]
    # Along the band at rest, 1 to 16 keV; a line of the second rank weighs half.
    away = abs(2.0 * found.fit.after.parameters["line_1.energy"].value - 6.6)
    assert said.identification[0].chance == pytest.approx(2 * 1.5 * away / 15.0, rel=1e-6)
    assert "At rest it would be toy alpha (6.6 keV; chance" in said.text
    assert found.to_json()["statements"][0]["identification"][0]["energy_kev"] == 6.6
    # Where it is recorded nothing known is: the energy at rest counts.
    here = replace(sources, redshift=np.array([0.0]))
    assert (
        discover_source(here, effects={"line": line}, only=("line",), replicates=399)
        .statements[0]
        .identification
        == ()
    )
    faint = simulator.with_effect(Effect("line", {"energy": 3.3, "counts": 2_050.0})).expected(theta)
    unsure = discover_source(
        replace(sources, counts=np.round(faint)[None]), effects={"line": line}, only=("line",)
    )
    assert (unsure.statements[0].effect, unsure.statements[0].certain) == ("line", False)
    assert unsure.statements[0].identification == ()


@pytest.mark.parametrize(("also", "ranges"), [(0, 4), (10, 4), (11, 3), (14, 3), (22, 2)])
def test_the_first_fit_begins_in_every_range_and_compiles_no_derivative(library, power_law, also, ranges):
    """From the likeliest 16 of 16,384 draws and those of each range: 64 rows at most."""
    asked = []

    class Many(power_law):
        def expected(self, theta):
            asked.append(len(theta))
            return super().expected(np.asarray(theta)[..., :2])

        def jacobian(self, theta):
            raise AssertionError("a derivative is asked for")

    nothing = {f"p{i}": Uniform(0.0, 1.0) for i in range(also)}
    simulator = Many(prior=power_law().prior * Prior(nothing) if also else None)
    counts = power_law().simulate(THETA[None], np.random.default_rng(3))
    sources = Sources.of(simulator, counts)
    Counts(sources, rng=np.random.default_rng(1), replicates=399, proposed=library)
    assert asked[:2] == [16384, 16 + ranges * (2 + also)]
    assert asked[1] <= 64
