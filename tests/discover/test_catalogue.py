"""The workflow on many sources that share an instrument."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.core.executors import threads
from gaugeblock.discovery import Sources, blocks, discover_catalogue
from gaugeblock.discovery.catalogue import CatalogueCounts, shared_nuisances
from gaugeblock.discovery.held_out import HeldOut
from gaugeblock.discovery.name.shared import Term
from gaugeblock.simulators import Uniform
from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.library import LibraryEffect


def catalogue(power_law, hidden, *, number=60, seed=1, counts=10_000.0):
    rng = np.random.default_rng(seed)
    plain = power_law()
    true = plain if hidden is None else plain.with_effect(hidden)
    theta = np.stack([counts * np.exp(rng.uniform(-1, 1, number)), rng.uniform(0.5, 2.5, number)], axis=1)
    return Sources.of(plain, true.simulate(theta, rng), redshift=rng.uniform(0.0, 2.0, number))


@pytest.fixture(scope="module")
def dip(power_law):
    """Sixty sources behind an area that is 12% too small around 1.7 keV."""
    return discover_catalogue(
        [catalogue(power_law, Effect("dip", {"energy": 1.7, "depth": -0.12}))], replicates=199
    )


def test_names_what_all_sources_share(dip):
    assert dip.named == "dip"
    gap = dip.to_json()["gap"]["held_out"]
    assert gap["after"] < gap["before"]
    low, high = dip.to_json()["amplitude"][0]["interval"]
    assert low < -0.12 < high or abs(dip.to_json()["amplitude"][0]["value"] + 0.12) < 0.02
    assert dip.candidate("dip").z > 5


def test_says_that_it_stays_with_the_detector(power_law, dip):
    """The claim in numbers, and on which sources it hangs: by the information of each at the energy."""
    sources = catalogue(power_law, Effect("dip", {"energy": 1.7, "depth": -0.12}))
    said, table = dip.to_json()["catalogue"], dip.tree["catalogue"]
    assert (said["n"], said["fixed_to"]) == (60, "detector")
    assert said["statement"] == table.attrs["statement"]
    assert "stays at its recorded energy" in said["statement"]
    assert table["source"].values.tolist() == list(sources.names)
    np.testing.assert_array_equal(table["redshift"], sources.redshift)
    np.testing.assert_array_equal(table["detector_lo"][1:], table["detector_hi"][:-1])
    strongest = int(np.nanargmin(table["detector_z"].values))
    assert table["detector_lo"][strongest] < 1.8
    assert table["detector_hi"][strongest] > 1.6
    assert table["detector_z"][strongest] < np.nanmin(table["rest_z"]) < 0
    assert table.attrs["p_detector"] == pytest.approx(1 / 200)
    assert 0 < table.attrs["p_rest"] <= 1
    at = np.sqrt(sources.edges.prod(axis=1))
    bell = np.exp(-0.5 * ((at - np.geomspace(0.7, 7.0, 36)[14]) / 0.4) ** 2)
    own, known = np.stack([np.ones(60), np.log(at)], axis=1), []
    for counts in sources.counts:
        root = np.sqrt(np.maximum(counts, 1.0))
        shape = root * bell
        basis = np.linalg.qr(root[:, None] * own)[0]
        known.append(((shape - basis @ (basis.T @ shape)) ** 2).sum())
    share = np.array(known) / np.sum(known)
    assert said["effective_sources"] == pytest.approx(1 / (share**2).sum(), rel=0.1)
    # Of z, which grows as the root of the information, a source makes half of its share.
    influence = table["influence"].values
    assert influence.mean() == pytest.approx(said["z"] / 120, rel=0.1)
    assert np.corrcoef(influence, share)[0, 1] < -0.8
    error = dip.to_json()["amplitude"][0]["standard_error"]
    assert said["sandwich_error"] == pytest.approx(error, rel=0.4)
    assert (said["z_beside_nuisances"], said["floor"]) == (pytest.approx(said["z"]), 0.0)
    assert (table["amplitude"] == dip.to_json()["amplitude"][0]["value"]).all()


def test_fewer_replicates_than_the_library_needs_are_refused(power_law):
    sources = catalogue(power_law, None, number=2)
    with pytest.raises(InputError, match=r"needs at least 99 replicates, got 98: .* global p of 0\.01$"):
        discover_catalogue([sources], replicates=98)


def test_what_has_no_name_is_measured_on_the_half_of_the_sources_that_did_not_choose_where(power_law):
    effect = Effect("dip", {"energy": 1.7, "depth": -0.12})
    rng, told = np.random.default_rng(3).spawn(2)
    engine = CatalogueCounts([catalogue(power_law, effect)], rng=rng, told=told, replicates=99)
    found = engine.excess((), ())
    assert found.lo < 1.7 < found.hi
    assert found.size.low < found.size.value < found.size.high < 0.0
    assert (found.halves, found) == ("sources", engine.excess((), ()))
    term = Term(engine.entries["dip"], {"energy": 1.7})
    one = SimpleNamespace(key="dip", term=term, amplitude=SimpleNamespace(value=-0.12))
    rounds = [SimpleNamespace(best=SimpleNamespace(chain=(one,)))]
    left = engine.excess(rounds, ("dip",))
    assert left.size.low < 0.0 < left.size.high
    assert engine.excess(rounds, ()) == found


def test_an_error_of_the_amplitude_that_falls_with_the_number(dip):
    """Nothing is floated here: as one over the root of the number, at 60 sources as the profile says."""
    error, number = (dip.tree["catalogue"][name].values for name in ("amplitude_error", "number"))
    said = dip.tree["catalogue"].attrs
    assert (said["effect"], said["neutral"], said["floor"]) == ("dip", 0.0, 0.0)
    np.testing.assert_allclose(error * np.sqrt(number), error[0] * np.sqrt(number[0]), rtol=1e-9)
    stated = dip.to_json()["amplitude"][0]
    assert error[0] * np.sqrt(number[0] / 60) == pytest.approx(stated["standard_error"], rel=0.2)
    low, high = stated["interval"]
    assert high - low == pytest.approx(2 * 1.645 * stated["standard_error"], rel=0.05)
    # The score's z is of the same error: a dip of 0.12 has moved 60 sources by some 50 of them.
    z = (stated["value"] - stated["neutral"]) / stated["standard_error"]
    assert dip.to_json()["catalogue"]["z"] == pytest.approx(z, rel=0.2)


@pytest.fixture(scope="module")
def bumps(power_law):
    """The same dip, where every area may be off by broad bumps of 2%, held as nuisances that all share."""
    area = LibraryEffect(
        name="effective_area",
        parameters={"energy": Uniform(0.6, 7.5), "width": Uniform(0.1, 5.0), "area": Uniform(-0.5, 0.5)},
        amplitude="area",
        neutral=0.0,
        step=0.02,
        scanned={"energy": np.geomspace(0.7, 7.0, 8), "width": np.array([3.0])},
        cause="area",
        typical="2%",
        origin="instrument",
    )
    sources = catalogue(power_law, Effect("dip", {"energy": 1.7, "depth": -0.12}))
    return discover_catalogue([sources], effects={"effective_area": area}, replicates=99)


def test_an_error_beside_nuisances_that_all_share(bumps):
    """Information added up source by source, the prior of bumps once: at the node, without the dip, what is
    foretold for other numbers of sources; at the truth, what the profile states.
    """
    rng = np.random.default_rng(1)
    theta = np.stack([1e4 * np.exp(rng.uniform(-1, 1, 60)), rng.uniform(0.5, 2.5, 60)], axis=1)
    edges = np.geomspace(0.5, 8.0, 61)
    at = np.sqrt(edges[1:] * edges[:-1])
    centres = np.geomspace(0.7, 7.0, 8)
    areas = [np.exp(-0.5 * ((at - c) / (0.6 * np.log(10) / 7 * c)) ** 2) for c in centres]

    def informed(energy, depth):
        scale = 1 + depth * np.exp(-0.5 * ((at - energy) / 0.4) ** 2)
        shapes = np.stack([np.exp(-0.5 * ((at - energy) / 0.4) ** 2) / scale, *areas], axis=1)
        told = np.zeros((9, 9))
        for norm, index in theta:
            mean = norm * at**-index * np.diff(edges) * scale
            own = np.stack([np.ones(60), np.log(at)], axis=1)
            of, cross = own.T @ (mean[:, None] * own), own.T @ (mean[:, None] * shapes)
            told += shapes.T @ (mean[:, None] * shapes) - cross.T @ np.linalg.solve(of, cross)
        return told

    def error(number, energy, depth):
        prior = np.diag([0.0, *[0.02**-2] * 8])
        return np.sqrt(np.linalg.inv(number / 60 * informed(energy, depth) + prior)[0, 0])

    assert bumps.named == "dip"
    table = bumps.tree["catalogue"]
    node = np.geomspace(0.7, 7.0, 36)[14]
    foretold = [error(number, node, 0.0) for number in table["number"].values]
    np.testing.assert_allclose(table["amplitude_error"].values, foretold, rtol=0.05)
    # What bumps of 2% that nobody models would pass for, and what is left of z beside those that are.
    told = informed(node, 0.0)
    said = bumps.to_json()["catalogue"]
    assert said["floor"] == pytest.approx(0.02 * np.linalg.norm(told[0, 1:]) / told[0, 0], rel=0.05)
    assert table.attrs["floor"] == said["floor"]
    beside = bumps.to_json()["amplitude"][0]["beside_nuisances"]
    assert beside["nuisances"] == ["effective_area (sd 0.02)"] * 8
    assert abs(said["z_beside_nuisances"]) < 0.5 * abs(said["z"])
    low, high = bumps.to_json()["amplitude"][0]["beside_nuisances"]["interval"]
    assert (low + high) / 2 == pytest.approx(beside["value"])
    assert (high - low) / (2 * 1.645) == pytest.approx(error(60, 1.7, -0.12), rel=0.1)


def test_sources_of_two_responses_are_searched_at_the_same_energies(power_law):
    """The second one's library scans elsewhere and has no area; what the first one's says holds for both."""

    class Second(power_law):
        def effect_library(self, theta):
            made = super().effect_library(theta)
            return {"line": replace(made["line"], scanned={"energy": np.array([1.0, 5.0])})}

        def not_in_library(self):
            return {"dip": "its area is not known", "line": "never said: the search has it"}

    line = Effect("line", {"energy": 2.5, "counts": 200.0})
    first, second = (
        Sources.of(simulator, catalogue(power_law, line, number=20, seed=seed).counts)
        for simulator, seed in ((power_law(), 1), (Second(), 2))
    )
    found = discover_catalogue([first, second], replicates=199)
    assert found.named == "line"
    assert found.candidate("line").parameters["energy"] == pytest.approx(2.5, abs=0.05)
    assert [(one.id, one.why) for one in found.not_checked if one.id in ("dip", "line")] == [
        ("dip", "its area is not known")
    ]
    assert [one.effect for one in found.candidates] == ["line", "edge"]


def test_nothing_shared_is_nothing_named(power_law):
    # p <= 0.01 is asked for: three or more of twenty would happen in 0.1%.
    named = [
        discover_catalogue([catalogue(power_law, None, number=20, seed=seed)], replicates=199).named
        for seed in range(20)
    ]
    assert sum(name is not None for name in named) < 3


def test_whoever_asks_the_blocks_the_same_seed_gives_the_same_answer(power_law, dip, monkeypatch):
    """All that is done source by source is asked through `each`, and nothing besides."""
    asked = []

    def elsewhere(ask, *columns):
        for row in zip(*columns, strict=True):
            asked.append(ask)
            with threads(1):
                answer = ask(*row)
            yield {name: np.array(values, order="C") for name, values in answer.items()}

    monkeypatch.setattr(blocks, "settled", None)
    hidden = catalogue(power_law, Effect("dip", {"energy": 1.7, "depth": -0.12}))
    again = discover_catalogue([hidden], replicates=199, each=elsewhere)
    assert again.to_json() == dip.to_json()
    assert len(asked) > 20


def test_where_the_summed_sources_disagree(dip):
    windows, quantiles = dip.tree["windows"], dip.tree["quantiles"]
    first = dip.to_json()["disagreement"]["regions"][0]
    assert first["energy_lo_kev"] < 1.7 < first["energy_hi_kev"]
    assert first["z"] < -5
    assert windows.attrs["p_global"] == dip.to_json()["disagreement"]["p_windows"] <= 0.01
    assert windows["strongest"].shape == quantiles["difference"].shape == (60,)


def test_residuals_know_that_sources_were_fitted(dip):
    # Sixty fits of two parameters take more than a channel's share each: Pearson's z would be too narrow.
    after = dip.tree["spectrum"]["residual_after"].values
    assert 0.6 < np.sqrt(np.mean(after**2)) < 1.4
    assert np.abs(dip.tree["spectrum"]["residual_before"].values).max() > 5


def test_an_effect_between_two_scanned_energies_is_one_effect(dip):
    scanned = np.geomspace(0.7, 7.0, 36)
    assert np.abs(scanned - 1.7).min() > 0.05
    assert dip.to_json()["named_all"] == ["dip"]
    assert dip.to_json()["disagreement"]["p_left"] > 0.05
    assert dip.candidate("dip").parameters["energy"] == pytest.approx(1.7, abs=0.02)


def test_a_second_effect_has_to_hold_on_sources_that_did_not_choose_it(power_law):
    # One source in sixty has a line of its own: what all share seems to have two effects.
    sources = catalogue(power_law, Effect("dip", {"energy": 1.7, "depth": -0.12}))
    own = power_law().with_effect(Effect("line", {"energy": 5.0, "counts": 20_000.0}))
    counts = sources.counts.copy()
    counts[7] = own.simulate(np.array([[1e4, 1.5]]), np.random.default_rng(3))[0]
    found = discover_catalogue([replace(sources, counts=counts)], replicates=199)
    assert found.to_json()["disagreement"]["p_left"] <= 0.01
    assert found.to_json()["named_all"] == ["dip"]
    assert found.to_json()["indistinguishable"] == ["dip", "unnamed"]
    assert "beside it does not hold" in found.to_json()["remarks"][0]


def test_two_effects_that_all_share_are_both_named(power_law):
    rng = np.random.default_rng(5)
    true = power_law().with_effect(Effect("dip", {"energy": 1.7, "depth": -0.12}))
    true = true.with_effect(Effect("dip", {"energy": 4.5, "depth": 0.2}))
    theta = np.stack([1e4 * np.exp(rng.uniform(-1, 1, 60)), rng.uniform(0.5, 2.5, 60)], axis=1)
    found = discover_catalogue([Sources.of(power_law(), true.simulate(theta, rng))], replicates=199)
    assert found.to_json()["named_all"] == ["dip", "dip"]
    assert found.to_json()["indistinguishable"] == ["dip", "unnamed"]
    assert found.to_json()["amplitude"][0]["value"] == pytest.approx(0.2, abs=0.06)
    assert found.to_json()["amplitude"][1]["value"] == pytest.approx(-0.12, abs=0.03)


def test_candidates_say_what_model_their_held_out_score_is_of(dip):
    best = dip.candidate("dip")
    assert best.held_out_model == "dip"
    assert dip.candidate("edge").held_out_model == "edge"
    assert best.held_out > 0


def test_of_several_models_with_an_effect_the_one_that_says_most_of_it_is_told():
    def told(*names):
        return HeldOut(names, (), np.zeros((0, 0)), np.zeros(0), np.zeros((0, 0))).model_of("dip")

    assert told("before", "line + dip", "edge", "dip") == "dip"
    assert told("before", "dip + line", "line + dip") == "line + dip"
    assert told("before", "edge") is None


def test_an_amplitude_at_the_edge_of_its_prior_is_said(power_law):
    narrow = power_law().effect_library(np.array([[1000.0, 2.0]]))["dip"]
    narrow = replace(narrow, parameters={**narrow.parameters, "depth": Uniform(-0.06, 0.06)}, step=0.02)
    sources = catalogue(power_law, Effect("dip", {"energy": 1.7, "depth": -0.12}))
    found = discover_catalogue([sources], effects={"dip": narrow}, only=("dip",), replicates=99)
    assert found.named == "dip"
    assert any("edge of its prior" in remark for remark in found.to_json()["remarks"])


def test_an_amplitude_inside_its_prior_is_not_remarked_on(dip):
    assert not any("edge of its prior" in remark for remark in dip.to_json()["remarks"])


@pytest.fixture(scope="module")
def engine(power_law):
    """Six sources behind the dip, in two groups of one response."""
    sources = catalogue(power_law, Effect("dip", {"energy": 1.7, "depth": -0.12}), number=6)
    groups = [sources.select(slice(0, 2)), sources.select(slice(2, 6))]
    rng, told = np.random.default_rng(1).spawn(2)
    return CatalogueCounts(groups, rng=rng, told=told, replicates=99)


def test_rivals_are_compared_as_in_the_linear_model(engine):
    """With z_r^2 twice the rival's gain, of which templates that correlate by rho share rho^2."""
    seen = engine.look()
    dip, edge = engine.fitted(seen, ["dip", "edge"], None)
    assert (dip.path, dip.size, edge.values["depth"]) == (("dip",), 2, edge.amplitude.value)
    edge = replace(edge, size=3, gain=dip.gain - 7.0)
    first, second = engine.compared([edge, dip], seen)
    assert (first.model.path, first.lead, first.z) == (("dip",), 0.0, 0.0)
    gram = seen.state.found.gram
    alike = gram[dip.template, edge.template] ** 2
    alike /= gram[dip.template, dip.template] * gram[edge.template, edge.template]
    variance = 2.0 * edge.gain * (1.0 - alike)
    # Parameters are taken for half a nat each, chance for as much of the variance.
    lead = 7.0 + 0.5
    assert second.lead == pytest.approx(lead)
    assert second.z == pytest.approx((lead + variance / 2.0) / np.sqrt(variance + 2.5))
    correlation = engine.likeness(seen, [dip.template, edge.template])
    np.testing.assert_allclose(np.diag(correlation), 1.0)
    assert correlation[0, 1] ** 2 == pytest.approx(alike)


def test_a_state_of_many_sources_is_their_quantiles_and_a_gap_their_mean_deviance(engine):
    (dip,) = engine.fitted(engine.look(), ["dip"], None)
    counts = np.concatenate([group.counts for group in engine.blocks])
    for model, fits in ((None, engine.fits), (dip, dip.amplitude.fits)):
        mean = np.concatenate([one.expected for one in fits])
        total = 2.0 * (mean - counts + counts * np.log(np.maximum(counts, 1e-300) / mean)).sum()
        state = engine.state(model)
        assert (state.statistic, state.bins) == (pytest.approx(total, rel=1e-6), 360)
        assert engine.gap(model) == pytest.approx(total / 360)
        index = np.sort(np.concatenate([one.theta[:, 1] for one in fits]))
        said = state.parameters["index"]
        # Of six, sorted: between the third and the fourth, and 0.8 of the way from one end to the next.
        assert said.value == pytest.approx(index[2:4].mean())
        assert said.low == pytest.approx(0.2 * index[0] + 0.8 * index[1])
        assert said.high == pytest.approx(0.2 * index[5] + 0.8 * index[4])
    assert state.parameters["dip_1.depth"].value == dip.amplitude.value
    data = engine.data()
    assert (data.name, data.n_sources, data.n_channels, data.counts) == ("6 sources", 6, 60, counts.sum())


def test_every_instrument_s_gain_is_free_but_for_what_is_named():
    def made(name):
        return LibraryEffect(
            name=name, parameters={"size": Uniform(-0.1, 0.1)}, amplitude="size", neutral=0.0, step=0.01,
            cause="", typical="",
        )  # fmt: skip

    entries = {name: made(name) for name in ("gain_offset", "gain_slope", "line")}
    told = [(one.entry.name, one.sd, one.values) for one in shared_nuisances(entries, "line")]
    assert told == [("gain_slope", 0.01, {}), ("gain_offset", 0.01, {})]
    assert [one.entry.name for one in shared_nuisances(entries, "gain_slope")] == ["gain_offset"]
    assert shared_nuisances({"line": made("line")}, "line") == ()
    # And an area in eight bumps from the first to the last energy that is scanned, each as wide as told.
    entries["effective_area"] = LibraryEffect(
        name="effective_area", amplitude="area", neutral=0.0, step=0.02, cause="", typical="",
        parameters={"energy": Uniform(0.1, 99.0), "width": Uniform(0.1, 99.0), "area": Uniform(-0.5, 0.5)},
        scanned={"energy": [64.0, 0.5, 3.0], "width": [1.0]},
    )  # fmt: skip
    found = shared_nuisances(entries, "line")
    assert [one.entry.name for one in found] == ["gain_slope", "gain_offset", *["effective_area"] * 8]
    for k, one in enumerate(found[2:]):
        assert one.values["energy"] == pytest.approx(0.5 * 2.0**k)
        assert one.values["width"] == pytest.approx(0.6 * np.log(2.0) * 0.5 * 2.0**k)
        assert one.sd == 0.02
    assert len(shared_nuisances(entries, "effective_area")) == 2
