"""The model confidence set: which effects the data cannot tell from the best."""

from __future__ import annotations

import numpy as np

from gaugeblock.discovery.engine import Comparison
from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.name.profiles import Profile
from gaugeblock.discovery.sources import Sources

HOPELESS = 12.0
"""Gain in log likelihood of the best over another beyond which that one is out whatever their distance.

Between models a distance D^2 / 2 apart the log ratio has mean -D^2 / 2 and standard deviation D under the
other, so a ratio r is at least sqrt(2 r) standard deviations away.
"""


def compare(best: Profile, rival: Profile, sources: Sources) -> Comparison:
    """Cox's test of a rival against the best: were the rival true, how unusual would the best's lead be?

    The lead's mean and variance under the rival come from a fit of the best to the rival's noise-free counts.

    References
    ----------
    Cox (1961), Proc. 4th Berkeley Symp. 1, 105; Hansen, Lunde & Nason (2011), Econometrica 79, 453.
    """
    lead = best.gain - rival.gain - (best.size - rival.size) / 2.0
    if lead > HOPELESS:
        return Comparison(rival, lead, float(np.sqrt(2.0 * lead)))
    truth = rival.fit.expected
    start = np.stack([best.fit.theta], axis=1)
    mimic = fit(best.candidate.simulator, truth, scale=sources.scale, start=start).expected
    log_ratio = np.log(truth / mimic)
    distance = float((truth * log_ratio - (truth - mimic)).sum())
    variance = float((truth * log_ratio**2).sum()) + (best.size + rival.size) / 2.0
    return Comparison(rival, lead, (lead + distance) / np.sqrt(variance))


def confidence_set(ranked: list[Profile], sources: Sources) -> list[Comparison]:
    """Every profile against the first one, which comes first with lead and z of 0; then by lead."""
    rest = [compare(ranked[0], rival, sources) for rival in ranked[1:]]
    return [Comparison(ranked[0], 0.0, 0.0), *sorted(rest, key=lambda one: one.lead)]
