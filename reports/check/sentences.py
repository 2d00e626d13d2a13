"""What a check found, in sentences."""

from __future__ import annotations

from gaugeblock.reports.words import count, listed, number, p_equals, short
from gaugeblock.validate import Outcome
from gaugeblock.validate.observation.along import Along
from gaugeblock.validate.observation.answer import Answer
from gaugeblock.validate.observation.generic import Tried
from gaugeblock.validate.observation.ladder import Seen
from gaugeblock.validate.observation.tables import DATA
from gaugeblock.validate.observation.where import Place

HEADLINES = {
    Outcome.PASS: "The simulator could have made this",
    Outcome.FAIL: "The simulator could not have made this",
    Outcome.INCONCLUSIVE: "Nothing was seen, and little would have been",
}
EFFECTS = {
    "shift": "an offset of {} spreads",
    "gain": "a factor of 1 + {}",
    "drift": "a multiplicative drift of {} along the last axis",
    "noise": "extra noise of {} spreads",
    "outliers": "outliers of {} spreads",
    "component": "a bump {} spreads high over some 15% of each axis",
    "stretch": "the last axis stretched by {}",
}
PLACES = 3
# Residuals, standard normal in simulations, beyond which a place is not in doubt.
CERTAIN = 5.0


def check_lines(answer: Answer) -> list[str]:
    """The verdict with its p-value, then a line each for where, what would have been seen and what it is."""
    lines = [
        f"{answer.outcome.value} {p_equals(answer.p_value)}: {HEADLINES[answer.outcome].lower()} "
        f"({count(answer.fresh, 'fresh simulation' if answer.observations == 1 else 'random group')} ranked)"
    ]
    if answer.outcome is Outcome.FAIL:
        lines += [oddest(answer), *([where(answer)] if answer.where.astray else []), name(answer)]
        lines += [along(answer.along)] if answer.along is not None else []
    else:
        lines.append(would_see(answer))
    return lines


def oddest(answer: Answer) -> str:
    """The view that says most."""
    view = answer.views[0]
    return f"seen by {view.name}: {view.says}"


def where(answer: Answer) -> str:
    """Which coordinates disagree, in words."""
    astray = answer.where.astray
    if not astray and answer.outcome is not Outcome.FAIL:
        return "no coordinate departs farther than somewhere in simulations"
    if not astray:
        return "no single coordinate stands out: the disagreement is spread over many"
    said = f"where: {listed([place_words(place) for place in astray], most=PLACES)}"
    instead = [place.name for place in next_in_line(answer)]
    return f"{said}; it might be {listed(instead, last='or')} instead" if instead else said


def next_in_line(answer: Answer) -> tuple[Place, ...]:
    """Places of the data that are not astray but would explain most in place of those that are.

    None where a place departs so far that nothing else could.
    """
    if any(abs(place.departure) > CERTAIN for place in answer.where.astray):
        return ()
    rest = [place for place in answer.where.places if place.family == DATA and not place.astray]
    return tuple(rest[: max(0, PLACES - len(answer.where.astray))])


def along(one: Along) -> str:
    """Which part of a disagreement parameters absorb, and what that does to them."""
    parameter, pull = one.farthest
    return (
        f"{one.share:.0%} of the disagreement lies along directions that parameters can absorb: "
        f"it moves {parameter} by {number(pull, 1, sign=True)} sd"
        + (", the others by less" if len(one.pulls) > 1 else "")
    )


def place_words(place: Place) -> str:
    """A place with what was seen and expected there."""
    if place.family != DATA:
        side = "above" if place.departure > 0 else "below"
        return f"{place.name} ({side} what is left after fitting elsewhere)"
    low, _, high = place.expected
    return f"{place.name} ({short(place.observed)}, expected {short(low)} to {short(high)})"


def seen_words(seen: Seen) -> str:
    """The smallest discrepancy of a kind that is detected."""
    if seen.smallest is None:
        return f"{seen.kind} of no size"
    return f"{seen.kind} of {short(seen.smallest)}"


def would_see(answer: Answer) -> str:
    """What would have been detected with 90% power, and what a PASS lacks."""
    said = f"would have seen with 90% power: {listed([seen_words(seen) for seen in answer.ladder])}"
    if answer.unseen:
        lacking = listed([f"{kind} of {short(answer.sees[kind])}" for kind in answer.unseen])
        return f"{said}; a PASS needs {lacking}"
    return said


def effect_words(one: Tried) -> str:
    """A generic effect with its amplitude."""
    return EFFECTS[one.name].format(short(one.amplitude))


def name(answer: Answer) -> str:
    """The generic effects that explain what was observed."""
    if not answer.effects:
        return "no generic effect was tried"
    if not answer.alike:
        return "no generic effect explains it: it is something of its own"
    if len(answer.alike) == 1:
        return f"looks like {effect_words(answer.alike[0])}"
    said = listed([effect_words(one) for one in answer.alike], last="or")
    return f"looks like {said}: these cannot be told apart"
