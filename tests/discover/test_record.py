"""What a finished search says of itself: its keys, from its engine and its decision."""

from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.discovery import Candidates, Sources
from gaugeblock.discovery.counts import Counts
from gaugeblock.discovery.record import LEFT, recorded
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
