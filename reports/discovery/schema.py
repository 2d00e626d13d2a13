"""What discovery.nc and discovery.json hold, as the report reads them.

The tree (`xarray.DataTree`, written to discovery.nc)
    One group for each thing that was looked at, all of them optional: a section whose group or variable is
    missing is left out, and the report says why. `GROUPS` below names every group and variable. The root
    holds no dimension. Text variables are plain strings. Where a variable lies along `channel`, the group
    holds the axis too: ``energy_lo energy_hi`` in `unit` (float; channel numbers where the unit is
    ``"channel"``), ``segment unit role`` (text: `Segment.name`, `.unit`, `.role` of every channel).
    For a catalogue, counts and expectations are sums over the sources.

    Dimensions: `channel` of the data vector, `window` found, `replicate` simulated, `effect` of the library,
    `node` of a scan, `model` compared, `fold` held out, `source` of a catalogue, `detector_bin` and
    `rest_bin` of stacked residuals, `size` of a growing catalogue, `component` of the model.

The summary (discovery.json)
    The contract's keys, and these further ones, each optional::

        "amplitude": [{"effect", "parameter", "value", "interval": [lo, hi], "level", "unit", "neutral",
                       "held_out": bool, "standard_error",
                       "beside_nuisances": {"value", "interval", "nuisances": [text]}}]
                                                    of every named effect, and excess_counts of "unnamed"
                                                    (in counts, in its statement's parameters too)
        "candidates": [{..., "held_out", "held_out_error", "held_out_model", "in_set": bool, "amplitude",
                        "unit", "gain", "cause"}]
                                                    held_out: gain in log score over the model before, nats,
                                                    of held_out_model: after several rounds effects are
                                                    scored together with those found before
        "decoys": [{"name", "kind", "held_out", "held_out_error", "deviance"}]
        "gap": {"measure", "held_out": {..., "before_error", "after_error"},
                "delta_log_evidence": {"value", "error", "sensitivity": [{"prior", "value"}]}}
        "statements": [{"effect", "indistinguishable", "certain", "probability", "evidence", "identification",
                        "parameters": {name: {"value", "low", "high", "at_limit"}}, "energy_lo_kev",
                        "energy_hi_kev", "text", "within_gain", "family", "shifted"}]
                                                    what is claimed, in order
        "fit": {"before": {"parameters": {name: {"value", "low", "high", "at_limit"}}, "statistic", "bins",
                           "w_statistic", "w_bins"},
                "after"}
                                                    of many sources their median, 16 and 84%; W over the
                                                    source's bins where it has a measured background
        "e_value": {"log", "p", "log_own", "paths"} split likelihood ratio, natural log: log_own of the named
                                                    effects, log with the choice among all paid for
        "disagreement": {..., "p_effects", "p_windows", "p_quantiles", "p_moments", "p_left", "replicates",
                         "regions": [{..., "start", "stop", "lo", "hi", "unit", "excess"}]}
                                                    energy_lo_kev, energy_hi_kev where the unit is keV
        "catalogue": {"n", "fixed_to", "statement", "floor", "sandwich_error", "effective_sources", "z",
                      "z_beside_nuisances"}
        "withdrawn": {"effect", "why"}              a name that was found and did not hold
        "remarks": [text]                           said under the headline, why it was decided first
        "not_checked": [{"id", "why"}]
        "data": {"name", "n_sources", "n_channels", "counts"}
        "effects": {name: {"cause", "typical", "origin", "units",
                           "prior": {"odds", "range", "usual", "limits"}}}    the last three by parameter
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

Variables = Mapping[str, tuple[str, ...]]

CHANNEL = ("channel",)
AXIS: Variables = dict.fromkeys(("energy_lo", "energy_hi", "segment", "unit", "role"), CHANNEL)


@dataclass(frozen=True)
class Group:
    """A group of the tree: what it is for, and the dimensions of each of its variables and attributes."""

    purpose: str
    required: Variables
    optional: Variables = field(default_factory=dict)
    attributes: tuple[str, ...] = ()


def _along(dimension: str, names: str) -> Variables:
    return dict.fromkeys(names.split(), (dimension,))


GROUPS: Mapping[str, Group] = {
    "spectrum": Group(
        "Counts with the expected counts before and after; residuals are z corrected for fitted parameters.",
        {**AXIS, **_along("channel", "counts before residual_before")},
        {**_along("channel", "after residual_after"), "components": ("component", "channel")},
    ),
    "windows": Group(
        "Where they disagree: non-overlapping windows, and for each channel the strongest z of all windows "
        "that hold it; `null_maximum` is the largest |z| of each data set simulated from the fitted model.",
        _along("window", "energy_lo energy_hi segment unit z p_global"),
        {
            **_along("window", "excess"),
            **_along("channel", "strongest"),
            "null_maximum": ("replicate",),
            **{f"channel_{name}": CHANNEL for name in ("lo", "hi", "segment", "unit")},
        },
        ("p_global", "replicates", "scan"),
    ),
    "quantiles": Group(
        "Cumulative observed minus expected counts of each segment, over the root of its total, with a band "
        "that holds 95% of whole simulated curves; `expected` is the cumulative share expected.",
        {**AXIS, **_along("channel", "expected difference low high")},
        attributes=("p_global",),
    ),
    "candidates": Group(
        "How alike the candidates' templates are after projection; numbers of single candidates are in the "
        "summary. `rival` repeats the names of `effect`.",
        {"effect": ("effect",), "rival": ("rival",), "correlation": ("effect", "rival")},
    ),
    "scan": Group(
        "z at every node of every effect that has something to scan. `parameter` is the one that goes on the "
        "horizontal axis (an energy where there is one); where others vary too, the largest |z| is drawn. "
        "`threshold` is the |z| that 5% of effect-free data reach somewhere.",
        _along("node", "effect parameter value unit z"),
        attributes=("threshold",),
    ),
    "held_out": Group(
        "Models scored on data held out of their fits: mean Poisson deviance per channel, and gain in log "
        "score (nats) over the model before, with standard errors. `kind` is one of before, named, rival, "
        "unnamed, random.",
        _along("model", "model kind deviance"),
        {
            **_along("model", "deviance_error log_score log_score_error"),
            **_along("fold", "before after"),
        },
        ("scheme", "measure"),
    ),
    "moments": Group(
        "Of data sets that can only be simulated: z of every coordinate's mean and square, and moments "
        "orthogonal to all that was fitted, before and after.",
        {"z": ("moment",), "before": ("direction",)},
        {"after": ("direction",)},
    ),
    "null": Group(
        "Of each simulated catalogue the largest z of the library, the largest moment, their mean square.",
        _along("replicate", "largest moment square"),
    ),
    "shape": Group(
        "For a disagreement that has no name: smooth correction factor of the expected counts with its "
        "pointwise 90% band.",
        {**AXIS, **_along("channel", "factor low high")},
    ),
    "catalogue": Group(
        "Residuals stacked in the detector's and in the sources' frame (keV), what single sources add, and "
        "the amplitude from growing numbers of sources. `influence` is the change of Z when a source is left "
        "out; `floor` is the error that remains for infinitely many sources.",
        {},
        {
            **_along("detector_bin", "detector_lo detector_hi detector_z"),
            **_along("rest_bin", "rest_lo rest_hi rest_z"),
            **_along("source", "source redshift influence"),
            **_along("size", "number amplitude amplitude_error"),
        },
        ("effect", "unit", "neutral", "floor", "fixed_to", "p_detector", "p_rest", "statement"),
    ),
}
