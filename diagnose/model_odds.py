"""What is wrong with posterior probabilities of models: prior odds of other simulations, or a temperature."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from gaugeblock.diagnosis.causes import Cause
from gaugeblock.validate.evidence.models import PROBABILITY, answers, exponent
from gaugeblock.validate.prepared import Prepared

# Standard errors from which something is named, and of a 90% interval.
SEEN, WITHIN = 3.0, 1.645
CAUSES: Mapping[str, tuple[Cause, ...]] = {
    "prior_odds": (
        Cause("trained with other prior odds", "draw the models as often as the trials do, or reweight"),
        Cause("undertrained", "train longer, or on more simulations"),
    ),
    "too_flat": (
        Cause(
            "a temperature, smoothed labels, or an average of ensembles", "raise to that power, on other data"
        ),
        Cause("undertrained", "train longer, or on more simulations"),
    ),
    "too_sharp": (
        Cause("overfitted", "simulate more, stop on held-out loss, or raise to that power, on other data"),
        Cause("evidences whose errors are larger than stated", "more live points, or repeated runs"),
    ),
}


def model_odds(prepared: Prepared) -> dict[str, Any]:
    """What a diagnosis says of trials with model probabilities: `named`, `text`, `causes`, `parameters`.

    Either a model is true more or less often than is stated on average, or all are stated too flatly or too
    sharply: what stands out more, in standard errors, is named.
    """
    probability, true, names = answers(prepared)
    happened = true[:, None] == np.arange(len(names))
    miss = happened - probability
    error = np.maximum(miss.std(axis=0) / math.sqrt(len(true)), np.finfo(float).tiny)
    worst = int(np.argmax(np.abs(miss.mean(axis=0)) / error))
    gap = (float(miss[:, worst].mean()), float(error[worst]))
    power, influence = exponent(probability, true)
    spread = float(influence.std()) / math.sqrt(len(true))
    off = [abs(gap[0]) / gap[1], abs(power - 1) / max(spread, np.finfo(float).tiny)]
    named, size = None, (0.0, 0.0)
    text = "no prior odds and no power of the probabilities would mend what gates say, if they say anything."
    if max(off) > SEEN and off[0] > off[1]:
        named, size = "prior_odds", gap
        stated, share = float(probability[:, worst].mean()), float(happened[:, worst].mean())
        text = f"{names[worst]} is true in {share:.1%} of the trials and stated with {stated:.1%} on average."
    elif max(off) > SEEN:
        named, size = "too_flat" if power > 1 else "too_sharp", (power, spread)
        text = (
            f"the probabilities are {named.replace('_', ' ')}: raised to the power {power:.2f} "
            f"(90%: {power - WITHIN * spread:.2f} to {power + WITHIN * spread:.2f}) they would fit best."
        )
    known = () if named is None else CAUSES[named]
    cures = "; ".join(f"{each.cause}: {each.cure}" for each in known)
    return {
        "named": named,
        "named_all": () if named is None else (named,),
        "text": f"{text} Possible causes: {cures}." if known else text,
        "causes": known,
        "parameters": {}
        if named is None
        else {named: (size[0], size[0] - WITHIN * size[1], size[0] + WITHIN * size[1])},
    }


def of_models(prepared: Prepared) -> bool:
    """Whether the trials are of model probabilities."""
    return PROBABILITY in prepared.main
