"""What may cause each symptom, and its cure: draws do not tell the causes of one symptom apart."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Cause(NamedTuple):
    """A cause in the estimator's own making, and its cure."""

    cause: str
    cure: str


# Standard deviations of data beyond which, or beyond the inverse of which, networks learn little from them.
UNSCALED = 100.0
# Symptoms of a network that data do not reach: `few_distinct` where its draws go to the ends of what can be
# drawn, `other` where it learned something that no repair mends.
UNREACHED = ("ignored_parameter", "unused", "scale too wide", "x_noise too wide", "few_distinct", "other")

CAUSES: Mapping[str, tuple[Cause, ...]] = {
    "shift": (
        Cause("training stopped early or at a poor optimum", "train longer, or from another seed"),
        Cause("trained on simulations of another simulator or version", "simulate anew and retrain"),
        Cause("an offset in a transform of the parameters", "check the transform between network and theta"),
    ),
    "scale too narrow": (
        Cause("overfitted", "simulate more, stop on held-out loss, or use an ensemble"),
        Cause("trained with less noise than the data have", "train on the simulator's own noise"),
        Cause("a factor in the widths (variance for standard deviation, temperature)", "check the sampler"),
    ),
    "scale too wide": (
        Cause("undertrained", "train longer, with a lower learning rate at the end, or on more simulations"),
        Cause("information lost in the embedding or summaries", "a larger embedding, or better summaries"),
        Cause("trained with more noise than the data have", "train on the simulator's own noise"),
        Cause("a factor in the widths (standard deviation for variance, temperature)", "check the sampler"),
    ),
    "skew": (
        Cause("a density family without skewness", "a flow, or more transforms of it"),
        Cause("undertrained", "train longer, or on more simulations"),
    ),
    "outliers": (
        Cause("a flow whose tails or inverse go astray", "double precision, or other transforms"),
        Cause("failed draws that are kept", "reject draws that are outside the prior or did not converge"),
    ),
    "clipped_tails": (
        Cause("draws are clipped or rejected too early", "widen the limits of the sampler"),
        Cause("a transform with bounded support", "let its tails be linear, or widen its bounds"),
    ),
    "few_distinct": (
        Cause("resampled from few weighted draws", "draw more before resampling"),
        Cause("a chain that hardly moves", "run it longer, or with another step"),
    ),
    "autocorrelated": (Cause("draws of a Markov chain", "thin it, or run it longer"),),
    "columns": (Cause("parameters in another order", "reorder the columns, or [estimator.parameters]"),),
    "unit": (Cause("another unit", "convert, or [estimator.parameters] with unit"),),
    "log": (Cause("drawn in logarithms, or the other way round", "transform back before returning draws"),),
    "sign": (Cause("another sign or direction", "flip it, or [estimator.parameters] with unit = -1"),),
    "ignored_parameter": (
        Cause(
            "the data do not reach the network",
            "look at scales of x and at the embedding",
        ),
        Cause("the prior is returned", "check that the posterior, not the proposal, is sampled"),
        Cause("undertrained, or not trained at all", "train longer, or load the trained weights"),
        Cause(
            "an autoregressive flow that shows no data to the parameter it begins with (sbi's maf, maf_rqs)",
            "another seed, more transforms, or zuko_maf or nsf",
        ),
    ),
    "correlations": (
        Cause("parameters estimated one by one", "estimate them jointly"),
        Cause("too few transforms", "a deeper flow, or another order of parameters"),
        Cause("undertrained", "train longer, or on more simulations"),
    ),
    "missing_mode": (
        Cause("a sampler that stays in one mode", "more chains or live points, started apart"),
        Cause("a density family with one mode", "a flow with more transforms, or a mixture"),
    ),
    "mode_weights": (
        Cause("modes weighted by how easily they are found", "nested sampling, or importance weights"),
        Cause("undertrained", "train longer, or on more simulations"),
    ),
    "other_prior": (
        Cause("trained on another prior", "retrain on the prior in use, or reweight draws by the ratio"),
        Cause("sequential proposals without correction", "a loss that corrects for the proposal"),
    ),
    "truncated_prior": (Cause("trained on a part of the prior", "simulate from all of it and retrain"),),
    "leakage": (Cause("a flow that does not know the prior's bounds", "reject draws outside it"),),
    "x_scale": (
        Cause("called with data in another unit than in training", "scale x as in training, in sample()"),
        Cause("trained on data that were not scaled", "standardise x, and retrain"),
    ),
    "x_shift": (Cause("called with another zero than in training", "subtract what training subtracted"),),
    "x_order": (Cause("called with data in another order than in training", "reorder x as in training"),),
    "x_channel": (Cause("channels are exchanged", "reorder the channels as in training"),),
    "x_noise too narrow": (
        Cause("trained with less noise than the data have", "train on the simulator's own noise"),
        Cause("overfitted", "simulate more, stop on held-out loss, or use an ensemble"),
    ),
    "x_noise too wide": (
        Cause("trained with more noise than the data have", "train on the simulator's own noise"),
        Cause("information lost in the embedding or summaries", "a larger embedding, or better summaries"),
        Cause("undertrained", "train longer, with a lower learning rate at the end, or on more simulations"),
    ),
    "region": (
        Cause("few simulations there", "simulate more of them, or weight them in training"),
        Cause("data there beyond what the network can follow", "transform x, or use a larger embedding"),
    ),
    "knows_truth": (
        Cause("the estimator has seen the truths, or draws them again from the seed", "use a fresh seed"),
        Cause("draws are stored, or made for other data than they are called with", "draw afresh for each x"),
    ),
    "fixed_seed": (Cause("a seed is set inside sample()", "use the generator that sample() is given"),),
    "log_q": (
        Cause("a missing Jacobian", "add the log determinant of every transform"),
        Cause("a density that is not normalised", "divide by the mass inside the prior"),
        Cause("another likelihood or prior than the simulator's", "compare the two at the same theta and x"),
    ),
    "unused": (  # what the data say beyond the draws, where nothing takes it away
        Cause("information lost in the embedding or summaries", "a larger embedding, or better summaries"),
        Cause("undertrained", "train longer, with a lower learning rate at the end, or on more simulations"),
    ),
    "other": (),
}


def causes(
    symptom: str, *, wide: bool = False, spread: tuple[float, float] | None = None
) -> tuple[Cause, ...]:
    """Causes of a symptom; of `scale` and `x_noise` those of too wide or too narrow draws.

    `spread` is the least and the largest standard deviation of the data's channels: data that no network
    likes to see as they are stand first among what may keep them from reaching it.
    """
    if f"{symptom} too wide" in CAUSES:
        symptom = f"{symptom} too {'wide' if wide else 'narrow'}"
    found = CAUSES.get(symptom, ())
    if symptom in UNREACHED and spread is not None and max(spread[1], 1 / spread[0]) > UNSCALED:
        low, high = spread
        said = f"x is not scaled: its standard deviations are {low:.3g} to {high:.3g}"
        return (Cause(said, "standardise x, in training and in sample(), where the network does not"), *found)
    return found
