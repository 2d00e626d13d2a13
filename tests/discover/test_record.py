"""What a finished search says of itself: its keys, from its engine and its decision."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gaugeblock.discovery import Candidates, Sources, record
from gaugeblock.discovery.confirm.excess import Excess
from gaugeblock.discovery.counts import Counts
from gaugeblock.discovery.decision import Claim
from gaugeblock.discovery.record import LEFT, recorded, with_e_value, with_evidence
from gaugeblock.discovery.result import Estimate, Gap, Region, Sides, Withdrawn
from gaugeblock.discovery.workflow import search
from gaugeblock.simulators.effects import Effect

THETA = np.array([20_000.0, 1.5])


@pytest.fixture(scope="module")
def searched(power_law):
    """Engine and result of a search for edges and lines: where an edge is hidden, and where nothing is."""
    library = Candidates.of(power_law(), THETA[None], only=("edge", "line"))
    made = []
    for depth in (0.25, 0.0):
        true = library.simulator.with_effect(Effect("edge", {"energy": 2.4, "depth": depth}))
        sources = Sources.of(library.simulator, np.round(true.expected(THETA[None])))
        engine = Counts(sources, rng=np.random.default_rng(1), replicates=399, proposed=library)
        made.append((engine, search(engine)))
    return made


def test_an_excess_without_a_name_is_where_its_first_region_is_and_energies_are_in_keV(searched, monkeypatch):
    engine, found = searched[0]
    first = engine.regions()[0]
    assert first.unit == "keV"
    unnamed = Claim("unnamed", ("unnamed",), 30.0, True, 0.9, None)
    found = replace(found, decision=replace(found.decision, claims=(unnamed,)))
    for unit, place in (("keV", (first.lo, first.hi)), ("channel", (None, None))):
        monkeypatch.setattr(engine, "regions", lambda unit=unit: (replace(first, unit=unit),))
        monkeypatch.setattr(engine, "excess", lambda *_: None)
        made = recorded(engine, found)
        (said,) = made.statements
        assert (said.energy_lo_kev, said.energy_hi_kev) == place
        assert said.text.endswith("there are no counts of which one half could choose.")
        assert (said.parameters, made.amplitude) == ({}, found.amplitudes)


def test_an_excess_without_a_name_has_a_size_from_counts_that_did_not_choose_where(searched, monkeypatch):
    engine, found = searched[0]
    claims = (Claim("unnamed", ("unnamed",), 30.0, True, 0.9, None),)
    found = replace(found, amplitudes=(), decision=replace(found.decision, claims=claims, added=()))
    made = recorded(engine, found)
    (said,), measured = made.statements, engine.excess((), ())
    assert said.parameters == {"excess_counts": measured.size}
    assert (said.energy_lo_kev, said.energy_hi_kev) == (measured.lo, measured.hi)
    assert made.to_json()["amplitude"] == [
        {
            "effect": "unnamed", "parameter": "excess_counts", "value": measured.size.value,
            "interval": [measured.size.low, measured.size.high], "level": 0.9, "unit": "counts",
            "neutral": 0.0, "held_out": True, "standard_error": None, "beside_nuisances": None, "others": {},
        }
    ]  # fmt: skip
    told = Excess(Estimate(-412.3, -474.2, -350.1), 2.2, 2.41, "keV", "counts")
    words = (
        " At 2.2 to 2.41 keV, which one half of the counts chose, the other half has an excess of -412.3 "
        "counts (-474.2 to -350.1; 90%, as of all counts)."
    )
    bare = words.replace(" keV", "")
    for unit, spoken, place in (("keV", words, (2.2, 2.41)), ("channel", bare, (None, None))):
        monkeypatch.setattr(engine, "excess", lambda *_, unit=unit: replace(told, unit=unit))
        (said,) = recorded(engine, found).statements
        assert said.text.endswith(spoken)
        assert (said.energy_lo_kev, said.energy_hi_kev) == place


@pytest.mark.parametrize(
    ("added", "alike", "path"),
    [
        ((), ("unnamed", "edge"), ()),
        (("edge", "line"), ("unnamed",), ("edge", "line")),
        (("edge", "line"), ("unnamed", "edge"), ("line",)),
        (("edge", "line", "edge"), ("unnamed", "edge"), ("edge", "line")),
    ],
)
def test_what_has_no_name_stands_beside_the_effects_that_did_not_give_way_to_it(
    searched, monkeypatch, added, alike, path
):
    engine, found = searched[0]
    asked = []
    claims = (Claim("unnamed", alike, 30.0, True, 0.9, None),)
    found = replace(found, decision=replace(found.decision, claims=claims, added=added))
    monkeypatch.setattr(engine, "excess", lambda rounds, beside: asked.append((rounds, beside)))
    recorded(engine, found)
    assert asked == [(found.rounds, path)]


def test_only_a_name_that_did_not_hold_is_withdrawn(searched):
    for engine, found in searched:
        said = recorded(engine, found)
        assert found.decision.withdrawn is said.withdrawn is None
        assert "no name holds" not in repr(said)
    engine, found = searched[1]
    decision = replace(found.decision, withdrawn="line", why="a random shape does as well")
    said = recorded(engine, replace(found, decision=decision))
    assert said.withdrawn == Withdrawn("line", "a random shape does as well")
    assert said.remarks[0] == "a random shape does as well"
    assert "no name holds" in repr(said)


def test_what_was_found_is_told_with_its_model(searched):
    (engine, found), (_, nothing) = searched
    said, quiet = recorded(engine, found), recorded(*searched[1])
    assert (said.named, said.named_all) == ("edge", ("edge",))
    assert (said.model_before, said.model_after) == ("PowerLaw", "PowerLaw with edge")
    assert (quiet.named, quiet.named_all, quiet.model_after) == (None, (), "PowerLaw")
    best = found.rounds[0].best
    inside, outside = said.gap.in_sample, said.gap.held_out
    assert (inside.before, inside.after) == (engine.gap(None), engine.gap(best))
    assert inside.before > 5 * inside.after
    assert (outside.before, outside.after) == tuple(
        found.held_out.gap(name)[0] for name in ("before", best.label)
    )
    assert (quiet.gap.in_sample.before, quiet.gap.in_sample.after) == (searched[1][0].gap(None), None)
    assert quiet.gap.held_out.before is None
    assert {one.name for one in said.decoys} == set(found.held_out.names) - {"before", best.label}
    assert quiet.decoys == ()
    # The most promising candidate first; only what was fitted has a gain.
    edge, line = said.candidates
    assert (edge.effect, line.effect) == ("edge", "line")
    assert edge.gain == best.gain > (line.gain or 0.0)
    assert edge.parameters == best.values
    assert (edge.in_set, edge.cause, edge.amplitude) == (True, "absorption", "depth")
    assert [one.gain for one in quiet.candidates] == [None, None]
    assert (
        quiet.candidates[0].z >= quiet.candidates[1].z == nothing.first.tested(quiet.candidates[1].effect).z
    )
    # Scores are those of the look, held-out ones those of the model whose name ends in the effect.
    for one in (edge, line):
        tested, label = found.first.tested(one.effect), found.held_out.model_of(one.effect)
        assert (one.z, one.p_global, one.information_kept, one.smallest_detectable) == (
            tested.z, tested.p_global, tested.kept, tested.smallest_detectable,
        )  # fmt: skip
        assert one.held_out_model == label
        assert one.held_out == (None if label is None else found.held_out.gain(label))
        assert one.held_out_error == (None if label is None else found.held_out.error_of(label))
        assert one.in_set == (one.effect in said.indistinguishable)
    assert edge.held_out > 0
    assert (inside.before_error, inside.after_error) == (None, None)
    assert (outside.before_error, outside.after_error) == tuple(
        found.held_out.gap(name)[1] for name in ("before", best.label)
    )
    for one in said.decoys:
        at = found.held_out.names.index(one.name)
        assert (one.kind, one.deviance) == (found.held_out.kinds[at], found.held_out.deviance[at].mean())
        assert one.held_out == found.held_out.gain(one.name)
        assert one.held_out_error == found.held_out.error_of(one.name)
    shown = said.disagreement
    assert (shown.p_effects, shown.p_left, shown.replicates) == (
        found.first.p_effects, found.last.p_global, 399,
    )  # fmt: skip
    assert (shown.p_windows, shown.p_quantiles, shown.p_moments) == (*engine.located().values(), None)
    assert (shown.regions, said.data) == (engine.regions(), engine.data())
    assert (said.remarks, said.catalogue, said.e_value) == ((found.decision.why,), None, None)
    told = said.effects["line"]
    assert (told.cause, told.typical, told.origin, told.units) == (
        "emission",
        "1%",
        "source",
        {"energy": "keV"},
    )
    assert said.to_json()["effects"]["line"]["prior"] == {
        "odds": 1.0, "range": {"energy": [0.6, 7.5], "counts": list(engine.entries["line"].support)},
        "usual": {}, "limits": {"counts": [engine.entries["line"].support[1]]},
    }  # fmt: skip
    assert said.disagreement.p_global == found.first.p_global == pytest.approx(2 / 400)
    assert said.fit.before == engine.state(None)
    assert said.fit.after == engine.state(best)
    assert quiet.fit.after is None
    (statement,) = said.statements
    assert statement.effect == "edge"
    assert statement.parameters["depth"].value == pytest.approx(0.25, abs=0.05)
    assert statement.parameters["energy"].value == pytest.approx(2.4, abs=0.1)
    (size,) = said.amplitude
    assert list(statement.parameters) == ["energy", "depth"]
    depth = statement.parameters["depth"]
    assert (depth.value, depth.low, depth.high, depth.at_limit) == (size.value, *size.interval, False)
    assert statement.parameters["energy"] == size.others["energy"]
    assert (statement.energy_lo_kev, statement.energy_hi_kev) == engine.place(best, 0)
    assert f"It acts at {statement.energy_lo_kev:.4g} to {statement.energy_hi_kev:.4g} keV" in statement.text


def test_what_is_left_is_remarked_on(searched):
    engine, found = searched[0]
    assert LEFT not in recorded(engine, found).remarks
    assert LEFT in recorded(engine, replace(found, last=found.first)).remarks


def test_four_amplitudes_and_four_candidates_are_told_first(searched):
    said = recorded(*searched[0])
    (one,), first = said.amplitude, said.candidates[0]
    many = replace(
        said,
        amplitude=tuple(replace(one, effect=f"effect {k}") for k in range(6)),
        candidates=tuple(replace(first, effect=f"candidate {k}") for k in range(6)),
    )
    told = repr(many)
    assert [f"effect {k}: depth" in told for k in range(6)] == [True] * 4 + [False] * 2
    assert [f"candidate {k} (z" in told for k in range(6)] == [True] * 4 + [False] * 2


def test_a_discovery_is_a_few_rows_and_plain_data(searched):
    said = recorded(*searched[0])
    (one,), first = said.amplitude, said.candidates[0]
    region = Region(3, 9, 1.5, 2.25, "keV", -7.26, 0.001, -40.0)
    made = replace(
        said,
        model_before="m" * 89,
        data=replace(said.data, name="d" * 90),
        remarks=("because <so>", "and more"),
        disagreement=replace(said.disagreement, p_global=0.012345, regions=(region, replace(region, z=5.0))),
        gap=Gap("mean deviance", Sides(1.25678, 1.01), Sides(1.3, None)),
        amplitude=(replace(one, value=0.123456, interval=(0.1, 0.2), unit="keV"),),
        candidates=(replace(first, z=3.14), replace(first, effect="line", z=-1.0)),
        provenance={"seed": 3, 5: (float("nan"), float("inf"), np.float64(1.5))},
    )
    rows = [
        ("model", "m" * 89),
        ("because", "because <so>"),
        ("global p of a disagreement", "0.0123"),
        ("most at", "1.5 to 2.25 keV, z = -7.3"),
        ("held-out gap (mean deviance)", "1.3"),
        ("in-sample gap (mean deviance)", "1.257 before, 1.01 after"),
        ("edge: depth", "0.1235 keV (90% 0.1 to 0.2)"),
        ("candidates", "edge (z = 3.1), line (z = -1.0)"),
    ]
    name = "d" * 87 + "..."
    assert repr(made) == "\n".join([f"Discovery of {name}: edge", *(f"  {a}: {b}" for a, b in rows)])
    page = made._repr_html_()
    assert f">edge</strong> in {name}<table>" in page
    assert page.count("<tr>") == 8
    assert "because &lt;so&gt;" in page
    told = replace(made, named_all=("edge", "line")), replace(made, indistinguishable=("edge", "gain_slope"))
    words = [repr(one).split("\n")[0].split(": ")[1] for one in told]
    assert words == ["edge + line", "edge or gain slope"]
    longest = replace(made, remarks=("x" * 4000,))
    assert len(repr(longest)) == 1990
    data = made.to_json()
    assert data["provenance"] == {"seed": 3, "5": [None, None, 1.5]}
    assert data["disagreement"]["regions"][0] == {
        "start": 3, "stop": 9, "lo": 1.5, "hi": 2.25, "unit": "keV", "z": -7.26, "p_global": 0.001,
        "excess": -40.0, "energy_lo_kev": 1.5, "energy_hi_kev": 2.25,
    }  # fmt: skip
    assert "energy_lo_kev" not in replace(region, unit="channel").to_json()
    assert "tree" not in data
    assert json.loads(json.dumps(data, allow_nan=False)) == data


def test_evidence_is_asked_of_the_first_name_on_the_counts(searched, monkeypatch):
    engine, found = searched[0]
    asked = []

    def taken(simulator, entry, counts, *, rng, with_entry):
        asked.append((simulator, entry, counts, rng, with_entry))
        curve = SimpleNamespace(factors=[0.5, 2.0], value=[11.5, 9.0], lower_bound=[False, True])
        return SimpleNamespace(value=12.5, error=0.25, sensitivity=curve)

    monkeypatch.setattr(record, "delta_log_evidence", taken)
    rng = np.random.default_rng(5)
    said = with_evidence(recorded(engine, found), engine, found, rng=rng).gap.delta_log_evidence
    best = found.rounds[0].best.candidate
    ((simulator, entry, counts, stream, extended),) = asked
    assert simulator is engine.sources.simulator
    assert (entry.name, entry) == ("edge", best.entry)
    assert extended is best.simulator
    assert stream is rng
    np.testing.assert_array_equal(counts, engine.sources.counts[0])
    assert (said.value, said.error) == (12.5, 0.25)
    widths = [(one.prior, one.value, one.lower_bound) for one in said.sensitivity]
    assert widths == [(0.5, 11.5, False), (2.0, 9.0, True)]


@pytest.mark.parametrize(("own", "p"), [(-3.0, 1.0), (5.0, 2.0 * np.exp(-5.0))])
def test_an_e_value_pays_for_the_choice_among_two_effects_and_is_no_p_value_above_one(
    searched, monkeypatch, own, p
):
    engine, found = searched[0]
    asked, rng = [], np.random.default_rng(5)

    def ratio(sources, simulator, *, rng, splits):
        asked.append((sources, simulator, rng, splits))
        return SimpleNamespace(log_e_value=own)

    monkeypatch.setattr(record, "split_likelihood_ratio", ratio)
    said = with_e_value(recorded(engine, found), engine, found, rng=rng).e_value
    assert asked == [(engine.sources, found.rounds[-1].best.candidate.simulator, rng, 5)]
    assert (said.log_own, said.paths) == (own, 2.0)
    assert (said.log, said.p) == (pytest.approx(own - np.log(2.0)), pytest.approx(p))


def test_evidence_that_cannot_be_had_is_listed_with_its_reason(searched):
    engine, found = searched[0]
    longer = SimpleNamespace(sources=replace(engine.sources, scale=np.array([2.0])))
    said = with_evidence(recorded(engine, found), longer, found, rng=np.random.default_rng(5))
    assert said.gap.delta_log_evidence.value is None
    told = {one.id: one.why for one in said.not_checked}
    assert "the simulator's exposure is not the spectrum's" in told["evidence.delta"]
