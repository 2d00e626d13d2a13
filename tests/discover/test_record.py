"""What a finished search says of itself: its keys, from its engine and its decision."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gaugeblock.discovery import Candidates, Sources, record
from gaugeblock.discovery.counts import Counts
from gaugeblock.discovery.record import LEFT, recorded, with_evidence
from gaugeblock.discovery.result import Withdrawn
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
        engine = Counts(sources, rng=np.random.default_rng(1), replicates=249, proposed=library)
        made.append((engine, search(engine)))
    return made


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
    assert said.disagreement.p_global == found.first.p_global == pytest.approx(2 / 250)
    assert said.fit.before == engine.state(None)
    assert said.fit.after == engine.state(best)
    assert quiet.fit.after is None
    (statement,) = said.statements
    assert statement.effect == "edge"
    assert statement.parameters["depth"].value == pytest.approx(0.25, abs=0.05)
    assert statement.parameters["energy"].value == pytest.approx(2.4, abs=0.1)


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


def test_evidence_that_cannot_be_had_is_listed_with_its_reason(searched):
    engine, found = searched[0]
    longer = SimpleNamespace(sources=replace(engine.sources, scale=np.array([2.0])))
    said = with_evidence(recorded(engine, found), longer, found, rng=np.random.default_rng(5))
    assert said.gap.delta_log_evidence.value is None
    told = {one.id: one.why for one in said.not_checked}
    assert "the simulator's exposure is not the spectrum's" in told["evidence.delta"]
