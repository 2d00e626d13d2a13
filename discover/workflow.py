"""Locate, name, extend, confirm: the workflow, whatever explains the data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gaugeblock.discovery.decision import Decision, decide
from gaugeblock.discovery.engine import Engine, Look, Round, promising
from gaugeblock.discovery.held_out import HeldOut
from gaugeblock.discovery.result import Amplitude

Step = Callable[[str], None]
"""Told, in words, what begins."""


def quiet(_: str) -> None:
    """Report no progress."""


@dataclass(frozen=True, eq=False)
class Searched:
    """All that was found: `first` is the look at the model as it was given, `rounds` the effects added one
    after the other, `last` the look at what they leave; `held_out` scores them, their rivals and decoys.
    """

    first: Look
    rounds: tuple[Round, ...]
    last: Look
    held_out: HeldOut | None
    amplitudes: tuple[Amplitude, ...]
    decision: Decision


def search(engine: Engine, *, step: Step = quiet) -> Searched:
    """Look, add effects while something is left, put the result to the test, and decide."""
    thresholds = engine.thresholds
    step("locating where model and data disagree")
    first = engine.look()
    if first.p_global > thresholds.level:
        return Searched(first, (), first, None, (), decide(thresholds, first, (), first, None))
    rounds, last = _rounds(engine, first, step)
    step(f"scoring on held-out {engine.held}")
    taken_back, scored = None, engine.scored(rounds)
    while len(rounds) > 1 and not engine.holds(rounds, scored):
        taken_back, last, rounds = rounds[-1].best.path[-1], rounds[-1].seen, rounds[:-1]
        scored = engine.scored(rounds)
    worth, taken, lost = (
        (engine.worth(rounds), engine.taken(rounds), engine.lost(rounds)) if rounds else ((), (), None)
    )
    decision = decide(
        thresholds, first, rounds, last, scored,
        worth=worth, taken=taken, lost=lost, held=engine.held, taken_back=taken_back,
    )  # fmt: skip
    if decision.added:
        step("measuring the amplitude")
    sure = {claim.at for claim in decision.claims if claim.certain and claim.at is not None}
    amplitudes = engine.amplitudes(rounds, sure) if decision.added else ()
    return Searched(first, rounds, last, scored, amplitudes, decision)


def _rounds(engine: Engine, first: Look, step: Step) -> tuple[tuple[Round, ...], Look]:
    """Add effects while something is left that one of the library explains.

    Two effects that hide each other are not found one after the other: the second is looked for behind each
    of the few best first ones.
    """
    thresholds = engine.thresholds
    rounds: list[Round] = []
    last = first
    while (
        last.p_effects <= thresholds.level
        and last.p_global <= thresholds.further
        and len(rounds) < thresholds.most
    ):
        step(f"fitting the candidates for effect {len(rounds) + 1}")
        looks, beam = [last], [rounds[-1].best if rounds else None]
        if len(rounds) == 1:
            best = rounds[0].best
            near = [one for one in rounds[0].models[1:] if one.gain >= 0.5 * best.gain]
            near = near[: thresholds.beam - 1]
            # An instrument's one parameter says most with least: it stands in pairs even where shapes that
            # can take any form are ahead of it alone.
            alone = [one for one in rounds[0].models[1:] if engine.simple(one) and one not in near]
            beam += near + [one for one in alone[:1] if best.size > 1 and one.gain >= 0.3 * best.gain]
            looks += [engine.after(one) for one in beam[1:]]
        models = [
            model
            for seen, behind in zip(looks, beam, strict=True)
            for model in engine.fitted(seen, promising(seen, thresholds, behind), behind)
        ]
        begun = rounds[0].best.path[0] if rounds else None
        rounds.append(Round(last, engine.compared(models, last, first=begun)))
        last = engine.after(rounds[-1].best)
    return tuple(rounds), last
