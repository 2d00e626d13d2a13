"""How named effects change an X-ray spectrum; docs/effects.md tabulates parameters, units and signs.

A file a family: `emission` adds components inside the absorber, `absorption`, `reflection` and `ionised` hold
factors on the photon flux, `instrument` those on the area and what acts on recorded energies, `published` the
study's own versions, `own` makes one of a user's function. `kinds` says what a kind of effect is and works
effects into an `Assembly`.

XSPEC's ``gain fit`` says E' = E / slope - intercept, E being the energy of the channel. A physical gain of
(slope, offset) here is XSPEC's (slope, intercept = offset / slope); a published gain of `factor` is XSPEC's
slope = 1 / factor, except that XSPEC looks the effective area up anew, and the paper moves it along.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from gaugeblock.simulators.effects import Effect
from gaugeblock.simulators.xray.effects.absorption import ABSORPTION
from gaugeblock.simulators.xray.effects.assembly import Assembly, Bound, Source
from gaugeblock.simulators.xray.effects.emission import EMISSION
from gaugeblock.simulators.xray.effects.instrument import INSTRUMENT
from gaugeblock.simulators.xray.effects.ionised import IONISED
from gaugeblock.simulators.xray.effects.kinds import EffectKind, extended
from gaugeblock.simulators.xray.effects.own import factor_effect
from gaugeblock.simulators.xray.effects.published import PUBLISHED
from gaugeblock.simulators.xray.effects.reflection import REFLECTION

EFFECTS: Mapping[str, EffectKind] = EMISSION | ABSORPTION | REFLECTION | IONISED | INSTRUMENT | PUBLISHED
"""Every effect that X-ray spectra know by name."""


def extend(assembly: Assembly, effects: Iterable[Effect]) -> Assembly:
    """Work effects in, in order; see `kinds.extended`."""
    return extended(assembly, effects, EFFECTS)


__all__ = ["EFFECTS", "Assembly", "Bound", "EffectKind", "Source", "extend", "factor_effect"]
