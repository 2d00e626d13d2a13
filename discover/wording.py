"""Effects, and what is claimed of them, in words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gaugeblock.discovery.held_out import UNNAMED
from gaugeblock.discovery.result import Estimate, Identification, Region

_PHRASES = {
    "gain_slope": "a gain slope (channel energies off by a factor)",
    "gain_offset": "a gain offset (channel energies off by a constant)",
    "gain_curve": "a gain that bends with energy",
    "effective_area": "an error of the effective area",
    "resolution": "a wrong energy resolution",
    "background": "a background that the model lacks",
    "pileup": "pile-up",
    "partial_covering": "partial covering",
    "ionised_absorber": "an ionised absorber",
    "reflection": "reflection",
    "thermal_continuum": "a thermal continuum",
    "soft_excess": "a soft excess",
    UNNAMED: "something that no effect of the library explains",
}


LISTED, SHOWN = 7, 5
"""Names of a set that a sentence lists; of a longer set it gives so many and the number of the others."""


def effect_phrase(name: str) -> str:
    """An effect with its article.

    >>> effect_phrase("emission_line"), effect_phrase("time_bin"), effect_phrase("pileup[acis]")
    ('an emission line', 'a time bin', 'pile-up of acis')
    """
    name, instrument = _of_instrument(name)
    if name in _PHRASES:
        return f"{_PHRASES[name]}{instrument}"
    words = name.replace("_", " ")
    return f"{'an' if words[:1].lower() in 'aeiou' else 'a'} {words}{instrument}"


def effect_words(name: str) -> str:
    """An effect's name as words.

    >>> effect_words("gain_offset"), effect_words("gain_offset[fpm_b]")
    ('gain offset', 'gain offset of fpm_b')
    """
    name, instrument = _of_instrument(name)
    return name.replace("_", " ") + instrument


def _of_instrument(name: str) -> tuple[str, str]:
    """The effect of a name like ``pileup[pn]``, and whose it is in words."""
    effect, bracket, instrument = name.partition("[")
    return (effect, f" of {instrument[:-1]}") if bracket and name.endswith("]") else (name, "")


def sentence(
    alike: Sequence[str],
    *,
    evidence: float,
    certain: bool,
    probability: float,
    parameters: Mapping[str, Estimate],
    units: Mapping[str, str],
    place: tuple[float, float] | None,
    region: Region | None,
    limits: Sequence[str],
    beyond: bool,
    known: Sequence[Identification] = (),
    near: Sequence[Identification] = (),
    corrected: bool = False,
) -> str:
    """One claim in a sentence or two: what, how sure, how large, where.

    `region` is where something without a name stands out most; `beyond` says
    that other claims came before it; `near` are what it may be if the gain is off; `corrected` says that the
    model has a gain beside it, so that its energies are not those recorded.
    """
    many = len(alike) > 1
    nameless = alike[0] == UNNAMED
    # What has no name comes last in a list, also where it is what is claimed.
    *others, final = map(effect_phrase, [*alike[1:], UNNAMED] if nameless else alike)
    if len(alike) > LISTED:
        others, final = others[:SHOWN], f"one of {len(alike) - SHOWN} other effects"
    what = f"{', '.join(others)} or {final}" if others else final
    word = "certain" if certain else "likely"
    sure = f"{word} ({probability:.3g}; {evidence:.3g} nats)"
    if nameless and beyond:
        said = f"Beyond that, something remains that nothing here explains: {sure}"
    elif many:
        # What is certain is the excess; the probability is that one of the names is right.
        said = (
            f"That something is there is {word} ({evidence:.3g} nats): {what}, one of them with a "
            f"probability of {probability:.3g}; which of them these data do not say"
        )
    else:
        said = f"{_start(what)} is {sure}"
    if nameless:
        where = _most_at(region, place)
        so = "" if not where else "; it stands out" if many and not beyond else ","
        return f"{said}{so}{where}."
    said += "."
    shown = ", ".join(_amount(name, one, units.get(name, "")) for name, one in parameters.items())
    if shown:
        whose = f"As {effect_phrase(alike[0])}:" if many else "With"
        said += (
            f" {whose} {shown} (90%, energies {'with that gain put right' if corrected else 'as recorded'})."
        )
    if place is not None:
        said += f" It acts at {place[0]:.4g} to {place[1]:.4g} keV."
    for one in known[:1]:
        where = "At rest" if one.frame == "source" else "As recorded"
        said += f" {where} it would be {one.name} ({one.energy_kev:.5g} keV; chance {one.chance:.2g})."
    if near:
        said += f" At rest, {_shifts(near, parameters.get('energy'))}."
    for name in limits:
        said += f" Its {name} stands at its limit: something larger, or of another kind, may be behind it."
    return said


def _most_at(region: Region | None, place: tuple[float, float] | None) -> str:
    """Where something without a name stands out most; nothing where nobody knows."""
    if region is not None:
        unit = f" {region.unit}" if region.unit != "channel" else ""
        return f" most at {region.lo:.4g} to {region.hi:.4g}{unit}, z = {region.z:+.1f}"
    return "" if place is None else f" most at {place[0]:.4g} to {place[1]:.4g} keV"


def _shifts(near: Sequence[Identification], energy: Estimate | None) -> str:
    """What known lines are away, and what that would take."""
    told, away = [], False
    low, high = (None, None) if energy is None else (energy.low, energy.high)
    for one in near:
        at = None if energy is None else energy.value - one.shift_ev / 1000.0
        inside = at is not None and low is not None and high is not None and low <= at <= high
        shift = "lies within that interval" if inside else f"would need {one.shift_ev:+.0f} eV"
        away |= not inside
        told.append(f"{one.name} ({one.energy_kev:.5g} keV) {shift}")
    either = any(one.frame == "source" for one in near)
    how = ", by gain or by motion, which these data do not separate" if either else ", by gain"
    return " and ".join(told) + (how if away else "")


def _start(words: str) -> str:
    return words[:1].upper() + words[1:]


def _amount(name: str, one: Estimate, unit: str) -> str:
    if one.low is None or one.high is None:
        return f"{name} {one.value:.3g} {unit}".rstrip()
    # Two digits of the interval's width: what is beyond them the data do not say.
    ends = (one.value, one.low, one.high)
    size, width = max(map(abs, ends)), abs(one.high - one.low)
    digits = 2 + math.floor(math.log10(size)) - math.floor(math.log10(width)) if width > 0.0 else 5
    value, low, high = (f"{end:.{min(max(digits, 2), 8)}g}" for end in ends)
    return f"{name} {value} ({low} to {high}) {unit}".rstrip()
