"""The chapters of a check's page."""

from __future__ import annotations

from markupsafe import Markup, escape

from gaugeblock.reports.check.effect_code import effect_code
from gaugeblock.reports.check.figures import panels
from gaugeblock.reports.check.sentences import along, effect_words, name, next_in_line, where
from gaugeblock.reports.discovery.chapter import Chapter, Heading, RowGroup, RowTable
from gaugeblock.reports.section import Panel
from gaugeblock.reports.words import NOTHING, number, probability, short
from gaugeblock.validate import Outcome
from gaugeblock.validate.observation.answer import Answer
from gaugeblock.validate.observation.tables import DATA
from gaugeblock.validate.observation.where import Place

SHOWN = 8


def chapters(answer: Answer) -> list[Chapter]:
    """Where, what was looked at, what would have been seen, what it is, what it does to the posterior."""
    made = [_where(answer), _views(answer), _ladder(answer)]
    if answer.outcome is Outcome.FAIL:
        made += [
            _effects(answer),
            *([_posterior(answer)] if answer.moved or answer.along is not None else []),
        ]
    return made


def _where(answer: Answer) -> Chapter:
    astray = answer.where.astray
    rows = tuple(_place(place) for place in (astray or answer.where.places[:PLACES_BESIDE])[:SHOWN])
    instead = tuple(_place(place) for place in next_in_line(answer)) if astray else ()
    table = RowTable(
        "Places",
        (Heading("Where", number=False), Heading("Seen in", number=False), Heading("Observed"),
         Heading("Expected"), Heading("Departure"), Heading("p, over all places")),
        (RowGroup("" if astray else "The farthest ones, none of them beyond what simulations do", rows),
         *([RowGroup("Where it might lie instead", instead)] if instead else [])),
        "Every next place is judged with those above it as expected. In simulations departures are "
        "standard normal.",
    )  # fmt: skip
    lead = where(answer).removeprefix("where: ")
    return Chapter(
        "where", "Where", "Which part of the data disagrees" if astray else "No part of the data stands out",
        f"At {lead}." if astray else f"{lead[:1].upper()}{lead[1:]}.", panels(answer), (table,),
        layout="full", pictures_first=True,
    )  # fmt: skip


PLACES_BESIDE = 3


def _place(place: Place) -> tuple[str, ...]:
    low, _, high = place.expected
    ours = place.family == DATA
    return (
        place.name,
        place.family,
        short(place.observed),
        f"{short(low)} to {short(high)}" if ours else NOTHING,
        number(place.departure, 1, sign=True),
        probability(place.p_value),
    )


def _views(answer: Answer) -> Chapter:
    rows = tuple(
        (view.name, view.says, probability(view.p_value), probability(view.p_adjusted))
        for view in answer.views
    )
    table = RowTable(
        "Views",
        (Heading("View", number=False), Heading("What it looks at", number=False), Heading("p alone"),
         Heading("p, for that there are several")),
        (RowGroup("", rows),),
        f"The p-value above, {probability(answer.p_value)}, is the observation's rank among all "
        "fresh simulations in the weighted harmonic mean of p alone: small where one view is sure, or "
        "several agree.",
    )  # fmt: skip
    return Chapter(
        "views", "Views", "In how many ways it was looked at",
        f"Views were learned on {answer.learned:,} simulations; {answer.fresh:,} others were ranked.", (),
        (table,),
    )  # fmt: skip


def _ladder(answer: Answer) -> Chapter:
    rows = []
    for seen in answer.ladder:
        needed = answer.sees.get(seen.kind)
        wanted = (
            NOTHING if needed is None else f"{short(needed)}{' (not seen)' * (seen.kind in answer.unseen)}"
        )
        smallest = "none of the sizes tried" if seen.smallest is None else short(seen.smallest)
        rows.append((seen.kind, seen.says, smallest, wanted))
    table = RowTable(
        "Ladder",
        (Heading("Discrepancy", number=False), Heading("What it is", number=False),
         Heading("Smallest seen in 90% of cases"), Heading("A PASS needs")),
        (RowGroup("", tuple(rows)),),
        "A spread is half the central 68% of a number over the simulations.",
    )  # fmt: skip
    return Chapter(
        "would-see", "Would see", "How large a discrepancy this check would have seen",
        "Each was planted into fresh simulations, which went through the same views.", (), (table,),
    )  # fmt: skip


def _effects(answer: Answer) -> Chapter:
    rows = tuple(
        (effect_words(one), number(one.gain, 1, sign=True), probability(one.p_value))
        for one in answer.effects
    )
    table = RowTable(
        "Effects",
        (Heading("Effect at its best amplitude", number=False), Heading("Likelier than without, nats"),
         Heading("p of the observation with it")),
        (RowGroup("", rows),),
        "A hint, by the likelihood of learned summaries under a Gaussian. Within 2 nats of the best nothing "
        "is told apart; an effect counts as an explanation where the observation is no longer odd with it.",
    )  # fmt: skip
    first = answer.effects[0].name if answer.effects else "shift"
    code = Markup('<pre style="overflow-x:auto;font-size:0.8125rem;line-height:1.45">{}</pre>').format(
        escape(_code(first, answer))
    )
    on = (
        "This simulator takes effects: gb.discover(simulator, x) searches its library. "
        if answer.has_effects
        else ""
    )
    panel = Panel(
        "The lines that turn the best guess into an Effect, and search for it", "change what is wrong", code
    )
    lead = name(answer)
    return Chapter(
        "effects", "What it may be", "What every array can suffer, tried",
        f"{on}{lead[:1].upper()}{lead[1:]}.", (panel,), (table,), layout="full",
    )  # fmt: skip


def _code(name: str, answer: Answer) -> str:
    """With the place that departs most as the middle of a bump."""
    length = answer.shape[-1] if answer.shape else 1
    steps = answer.grid[-1] if answer.grid else 1
    place = answer.where.places[0].coordinate % steps
    return effect_code(name, answer.codes, centre=place * length // steps, length=length)


def _posterior(answer: Answer) -> Chapter:
    tables = []
    if answer.along is not None:
        pulls = sorted(answer.along.pulls.items(), key=lambda one: -abs(one[1]))
        pulled = tuple((name, number(pull, 2, sign=True)) for name, pull in pulls[:SHOWN])
        tables.append(
            RowTable(
                "Along parameters",
                (Heading("Parameter", number=False), Heading("Moved by what disagrees, in sd")),
                (RowGroup("", pulled),),
                "By a regression on simulations near the observation without what disagrees.",
            )
        )
    if answer.moved:
        rows = tuple(
            (one.parameter, f"{short(one.before[0])} ± {short(one.before[1])}",
             f"{short(one.after[0])} ± {short(one.after[1])}", number(one.shift, 2, sign=True))
            for one in answer.moved
        )  # fmt: skip
        tables.append(
            RowTable(
                "Posterior",
                (Heading("Parameter", number=False), Heading("As observed"),
                 Heading("Without what disagrees"), Heading("Moved, in sd")),
                (RowGroup("", rows),),
                "Disagreeing places are replaced by what the others lead one to expect.",
            )
        )  # fmt: skip
    lead = "A parameter that moves little can be used with the part left out; one that moves far rests on it."
    if answer.along is not None:
        said = along(answer.along)
        lead = f"{said[:1].upper()}{said[1:]}; what is left, parameters cannot explain. {lead}"
    return Chapter(
        "posterior", "Posterior", "What the disagreeing part does to the posterior", lead, (), tuple(tables)
    )
