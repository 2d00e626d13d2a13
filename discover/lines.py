"""What is said of certain lines beyond their own names: their families, and what several are together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from scipy.constants import speed_of_light

from gaugeblock.discovery.name.identified import CHANCE
from gaugeblock.discovery.name.shifted import CAUSES, Measured, harmonics, shifted, together
from gaugeblock.discovery.result import (
    HALF_OF_90,
    FamilySaid,
    FollowerSaid,
    Identification,
    Shifted,
    Statement,
)
from gaugeblock.simulators.library import Known

ABSORBED = "absorption_line"
"""The effect of which cyclotron lines are."""


@dataclass(frozen=True)
class Line:
    """What a statement's line or edge may be: `energy` in keV as recorded, `at` its place in the model."""

    at: int
    energy: float
    known: tuple[Known, ...]


def explained(
    statements: Sequence[Statement],
    lines: Sequence[Line | None],
    *,
    band: tuple[float, float],
    stretch: float,
    reach: float,
    family: Callable[[int, Known], FamilySaid | None],
) -> tuple[Statement, ...]:
    """Statements, those of certain `lines` with what comes with them, and with what they are together.

    `band` in keV as recorded, `stretch` 1 + z, `reach` the share by which a gain may move energies, 0 where
    the model has one; `family` fits what comes with an effect if it is a known line.
    """
    made = list(statements)
    measured = _measured(made, lines, band, stretch)
    for i, line in enumerate(lines):
        if line is not None:
            _with_family(made, i, line, measured, family)
    alone = [i for i in measured if made[i].shifted is None]
    found = shifted([measured[i] for i in alone], reach) if reach > 0.0 and len(alone) > 1 else None
    if found is not None:
        _with_shift(made, [alone[at] for at in found[0]], found[1], measured)
    _with_harmonics(made, measured)
    return tuple(made)


def _measured(
    made: Sequence[Statement], lines: Sequence[Line | None], band: tuple[float, float], stretch: float
) -> dict[int, Measured]:
    """Lines whose energies have an error."""
    found = {}
    for i, line in enumerate(lines):
        size = made[i].parameters.get("energy")
        if line is not None and size is not None and size.low is not None and size.high is not None:
            error = (size.high - size.low) / (2.0 * HALF_OF_90)
            found[i] = Measured(line.energy, error, line.known, band, stretch)
    return found


def _with_family(
    made: list[Statement],
    i: int,
    line: Line,
    measured: Mapping[int, Measured],
    family: Callable[[int, Known], FamilySaid | None],
) -> None:
    """A line that others come with gets its name by them as well: by the chance that a line lies as near, and
    that one which could be its follower is where that should be.
    """
    may_be = {one.name: one for one in (*made[i].within_gain, *made[i].identification)}
    for one in line.known:
        said = family(line.at, one) if one.family and one.name in may_be else None
        if said is None:
            continue
        made[i] = replace(made[i], family=said, text=f"{made[i].text} {_family(said)}")
        if said.chance is None or made[i].identification:
            continue
        chance = may_be[one.name].chance * said.chance
        if chance > CHANCE:
            continue
        members, names = [i], [one]
        for follower in said.followers:
            known = [other for other in line.known if other.name == follower.name]
            near = [j for j, there in measured.items() if j != i and follower.name in _names(made[j])]
            if follower.seen and known and near:
                members, names = [*members, near[0]], [*names, known[0]]
        if all(j in measured for j in members):
            together_ = together([measured[j] for j in members], names, CAUSES, chance)
            _with_shift(made, members, together_, measured)


def _names(one: Statement) -> set[str]:
    return {name.name for name in (*one.identification, *one.within_gain)}


def _with_shift(
    made: list[Statement], places: Sequence[int], said: Shifted, measured: Mapping[int, Measured]
) -> None:
    for i, name in zip(places, said.lines, strict=True):
        others = [measured[j].energy for j in places if j != i]
        text = f"{made[i].text} {_shifted(said, others)}"
        names = made[i].identification or (name,)
        made[i] = replace(made[i], identification=names, shifted=said, text=text)


def _with_harmonics(made: list[Statement], measured: Mapping[int, Measured]) -> None:
    places = [i for i in measured if made[i].effect == ABSORBED and made[i].shifted is None]
    several = harmonics([measured[i] for i in places])
    if several is None:
        return
    fundamental, multiples, chance = several
    for i, multiple in zip(places, multiples, strict=True):
        name = f"cyclotron line, {multiple} times {fundamental:.4g} keV"
        away = 1000.0 * (measured[i].energy - multiple * fundamental)
        one = Identification(name, multiple * fundamental, chance, away)
        text = f"{made[i].text} {_harmonics(fundamental, multiples, chance)}"
        made[i] = replace(made[i], identification=made[i].identification or (one,), text=text)


def _family(said: FamilySaid) -> str:
    """What comes with a line, in a sentence."""
    first, last = said.stages[0], said.stages[-1]
    ions = first if first == last else f"{first} to {last}"
    return f"If it is {said.line} ({ions}): {', '.join(map(_follower, said.followers))}."


def _follower(one: FollowerSaid) -> str:
    size = f"{one.ratio:.2g} +- {one.error:.2g}"
    if one.expected is None or one.power is None:
        most = f"{one.name} below {max(one.ratio, 0.0) + HALF_OF_90 * one.error:.2g}"
        return f"{one.name} {size}" if one.seen else most
    if one.seen:
        return f"{one.name} is there, {size} of it ({one.expected:g} expected)"
    power = f"{one.expected:g} of it would stand out by {one.power:.2g} standard errors"
    if one.seen is None:
        return f"whether {one.name} follows these data cannot tell ({size}; {power})"
    return f"{one.name} does not follow ({size}; {power})"


def _shifted(said: Shifted, others: Sequence[float]) -> str:
    """What several lines are together, in a sentence or two."""
    names = " and ".join(f"{one.name} ({one.energy_kev:.5g} keV)" for one in said.lines)
    beside = (
        f"With what is at {' and '.join(f'{energy:.4g}' for energy in others)} keV it is"
        if others
        else "It is"
    )
    factor = f"{said.factor:.4f} ({said.low:.4f} to {said.high:.4f}; 90%)"
    if said.low <= 1.0 <= said.high:
        return f"{beside} {names} (chance {said.chance:.2g}), where they should be: by a factor of {factor}."
    moves = f"a motion of {1e-3 * speed_of_light * (1.0 / said.factor - 1.0):+.0f} km/s"
    text = f"{beside} {names} (chance {said.chance:.2g}), off by a factor of {factor}:"
    if len(said.causes) > 1:
        return (
            f"{text} a gain slope or {moves}, which only what is at rest in the detector, or an interstellar "
            "edge, would tell apart."
        )
    cause = "a gain slope" if said.causes[0] == "gain" else moves
    return f"{text} {cause}, as what is at rest beside them says."


def _harmonics(fundamental: float, multiples: Sequence[int], chance: float) -> str:
    told = ", ".join(map(str, multiples))
    return (
        f"These absorption lines are at {told} times {fundamental:.4g} keV (chance {chance:.2g}), as those "
        "of a cyclotron are."
    )
