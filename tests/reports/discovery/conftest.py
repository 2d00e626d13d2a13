"""Discoveries as the schema describes them, of made-up numbers: every ending, and a catalogue."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
import xarray as xr

HOSTILE = "<script>alert('x')</script>&\"|`*_[a](b)"


def axis(channels: int, *, unit: str = "keV", background: bool = False) -> dict[str, Any]:
    sides = np.geomspace(0.5, 8.0, channels + 1) if unit == "keV" else np.arange(channels + 1.0)
    parts = [("pn", "source"), ("pn background", "background")] if background else [("pn", "source")]
    repeat = len(parts)
    return {
        "energy_lo": ("channel", np.tile(sides[:-1], repeat)),
        "energy_hi": ("channel", np.tile(sides[1:], repeat)),
        "segment": ("channel", np.repeat([name for name, _ in parts], channels)),
        "unit": ("channel", np.full(channels * repeat, unit)),
        "role": ("channel", np.repeat([role for _, role in parts], channels)),
    }


def single_tree(*, channels: int = 200, unit: str = "keV", background: bool = False) -> xr.DataTree:
    rng = np.random.default_rng(3)
    places = axis(channels, unit=unit, background=background)
    energy = (places["energy_lo"][1] + places["energy_hi"][1]) / 2
    before = 400.0 / (1 + energy)
    centre = 6.4 if unit == "keV" else 0.6 * channels
    bump = np.exp(-0.5 * ((energy - centre) / (0.05 * centre)) ** 2)
    after = before * (1 + 0.8 * bump)
    counts = rng.poisson(after).astype(float)
    size = len(energy)
    effects = ["emission_line", "partial_covering", "gain_slope"]
    scanned = np.geomspace(0.6, 7.5, 30)
    models = ["before", "emission_line", "partial_covering", "unnamed", "random 1"]
    groups = {
        "spectrum": xr.Dataset(
            places
            | {
                "counts": ("channel", counts),
                "before": ("channel", before),
                "after": ("channel", after),
                "residual_before": ("channel", (counts - before) / np.sqrt(before)),
                "residual_after": ("channel", (counts - after) / np.sqrt(after)),
                "components": (("component", "channel"), np.stack([before, after - before])),
            },
            coords={"component": ["powerlaw", "line"]},
        ),
        "windows": xr.Dataset(
            {
                "energy_lo": ("window", [0.95 * centre, 0.3 * centre]),
                "energy_hi": ("window", [1.05 * centre, 0.4 * centre]),
                "segment": ("window", ["pn", "pn"]),
                "unit": ("window", [unit, unit]),
                "z": ("window", [8.7, -4.2]),
                "p_global": ("window", [0.001, 0.03]),
                "excess": ("window", [81.0, -40.0]),
                "strongest": ("channel", np.where(places["role"][1] == "source", 8.7 * bump - 1, np.nan)),
                "null_maximum": ("replicate", rng.gumbel(3.2, 0.3, 999)),
                "channel_lo": places["energy_lo"],
                "channel_hi": places["energy_hi"],
                "channel_segment": places["segment"],
                "channel_unit": places["unit"],
            },
            attrs={"p_global": 0.001, "replicates": 999},
        ),
        "quantiles": xr.Dataset(
            places
            | {
                "expected": ("channel", np.linspace(0, 1, size)),
                "difference": ("channel", np.cumsum(counts - before) / np.sqrt(before.sum())),
                "low": ("channel", np.full(size, -1.3)),
                "high": ("channel", np.full(size, 1.3)),
            },
            attrs={"p_global": 0.004},
        ),
        "candidates": xr.Dataset(
            {"correlation": (("effect", "rival"), [[1, 0.9, 0.1], [0.9, 1, 0.2], [0.1, 0.2, 1]])},
            coords={"effect": effects, "rival": effects},
        ),
        "scan": xr.Dataset(
            {
                "effect": ("node", np.repeat("emission_line", 30)),
                "parameter": ("node", np.repeat("energy", 30)),
                "value": ("node", scanned),
                "unit": ("node", np.repeat("keV", 30)),
                "z": ("node", 8 * np.exp(-0.5 * ((scanned - 6.4) / 0.4) ** 2) - 0.5),
            },
            attrs={"threshold": 3.4},
        ),
        "held_out": xr.Dataset(
            {
                "model": ("model", models),
                "kind": ("model", ["before", "named", "rival", "unnamed", "random"]),
                "deviance": ("model", [1.42, 1.02, 1.03, 1.05, 1.38]),
                "deviance_error": ("model", [0.02, 0.02, 0.02, 0.02, 0.03]),
                "log_score": ("model", [0.0, 36.5, 35.9, 33.0, 2.1]),
                "log_score_error": ("model", [0.0, 7.1, 7.0, 8.0, 2.0]),
                "before": ("fold", [1.5, 1.4, 1.36]),
                "after": ("fold", [1.0, 1.1, 0.96]),
            },
            attrs={"scheme": "Poisson thinning, 3 folds"},
        ),
        "shape": xr.Dataset(
            places
            | {
                "factor": ("channel", 1 + 0.7 * bump),
                "low": ("channel", 0.9 + 0.7 * bump),
                "high": ("channel", 1.1 + 0.7 * bump),
            }
        ),
    }
    return xr.DataTree.from_dict(groups)


def catalogue_tree() -> xr.DataTree:
    rng = np.random.default_rng(5)
    sides = np.geomspace(0.5, 16.0, 41)
    number = np.array([10, 20, 50, 100, 200, 500])
    made = single_tree()
    made["catalogue"] = xr.DataTree(
        xr.Dataset(
            {
                "detector_lo": ("detector_bin", sides[:-1]),
                "detector_hi": ("detector_bin", sides[1:]),
                "detector_z": ("detector_bin", np.r_[rng.normal(size=35), np.full(5, np.nan)]),
                "rest_lo": ("rest_bin", sides[:-1]),
                "rest_hi": ("rest_bin", sides[1:]),
                "rest_z": ("rest_bin", rng.normal(size=40)),
                "source": ("source", [f"src{i}" for i in range(500)]),
                "redshift": ("source", rng.uniform(0, 1, 500)),
                "influence": ("source", rng.normal(0, 0.05, 500)),
                "number": ("size", number),
                "amplitude": ("size", 1.03 + 0.02 * rng.normal(size=6) / np.sqrt(number / 10)),
                "amplitude_error": ("size", 0.03 / np.sqrt(number / 10) + 0.002),
            },
            attrs={
                "effect": "gain_slope", "unit": "", "neutral": 1.0, "floor": 0.002, "p_detector": 0.001,
                "p_rest": 0.4, "fixed_to": "detector",
                "statement": "the disagreement is fixed to the detector",
            },
        )
    )  # fmt: skip
    return made


def candidate(effect: str, **given: Any) -> dict[str, Any]:
    return {
        "effect": effect, "parameters": {"energy": 6.41, "norm": 1.2e-4}, "z": 8.4, "p_global": 0.001,
        "information_kept": 0.82, "smallest_detectable": 7e-5, "amplitude": "norm", "unit": "photons/cm2/s",
        "held_out": 36.5, "held_out_error": 7.1, "in_set": False, **given,
    }  # fmt: skip


def named_summary() -> dict[str, Any]:
    return {
        "disagreement": {
            "p_global": 0.001,
            "replicates": 999,
            "regions": [{"lo": 6.08, "hi": 6.72, "unit": "keV", "z": 8.7, "p_global": 0.001}],
        },
        "candidates": [
            candidate("emission_line", in_set=True),
            candidate("partial_covering", z=7.9, held_out=12.2, held_out_error=5.0),
            candidate("gain_slope", z=1.2, p_global=0.9, held_out=None, held_out_error=None),
        ],
        "statements": [
            {"effect": "emission_line", "text": "An emission line is certain (0.99)."}
        ],
        "fit": {
            "before": {"parameters": {"powerlaw_1.alpha": {"value": 1.7, "low": 1.65, "high": 1.75}},
                       "statistic": 284.0, "bins": 200},
            "after": {"parameters": {"powerlaw_1.alpha": {"value": 1.8, "low": None, "high": None}},
                      "statistic": 204.0, "bins": 200},
        },
        "named": "emission_line",
        "named_all": ["emission_line"],
        "indistinguishable": ["emission_line"],
        "model_before": "tbabs*powerlaw",
        "model_after": "tbabs*powerlaw with emission_line",
        "gap": {
            "in_sample": {"before": 1.4, "after": 1.0},
            "held_out": {"before": 1.42, "after": 1.02},
            "delta_log_evidence": {
                "value": 28.3,
                "error": 0.2,
                "sensitivity": [{"prior": "ten times as wide", "value": 26.0}],
            },
        },
        "decoys": [{"name": "random 1", "kind": "random", "held_out": 2.1}],
        "amplitude": [{
            "effect": "emission_line", "parameter": "norm", "value": 1.18e-4, "interval": [0.9e-4, 1.5e-4],
            "level": 0.9, "unit": "photons/cm2/s", "neutral": 0.0, "held_out": True,
        }],
        "e_value": {"log": 30.2, "p": 7.6e-14, "log_own": 32.8, "paths": 13.0},
        "not_checked": [{"id": "pileup", "why": "the file names no frame time"}],
        "effects": {
            "emission_line": {
                "cause": "Atoms shine.", "typical": "50 eV", "units": {"energy": "keV", "sigma": "keV"},
                "prior": {
                    "odds": 1.0, "range": {"energy": [0.5, 8.0]},
                    "usual": {"equivalent width": [0.0, 0.3], "energy": [2.0, 7.0]},
                    "limits": {"norm": [0.0125], "sigma": [1.0]},
                },
            }
        },
        "data": {"name": "src.pha", "n_sources": 1, "n_channels": 200, "counts": 30000},
        "provenance": {"seed": 7, "sha256": {"src.pha": "ab" * 32}, "not a number": float("nan")},
    }  # fmt: skip


def ended(named: str | None, **given: Any) -> dict[str, Any]:
    return {
        **named_summary(),
        "named": named,
        "named_all": [],
        "indistinguishable": [],
        "amplitude": [],
        **given,
    }


@pytest.fixture
def tree():
    return single_tree()


@pytest.fixture
def summary():
    return named_summary()


ENDINGS = {
    "named": named_summary(),
    "set": {**named_summary(), "indistinguishable": ["emission_line", "partial_covering"]},
    "two": {**named_summary(), "named_all": ["emission_line", "gain_slope"]},
    "unnamed": ended("unnamed", indistinguishable=["unnamed", "emission_line"]),
    "withdrawn": ended(None, withdrawn={"effect": "emission_line", "why": "a random shape does as well"}),
    "nothing": ended(None, disagreement={"p_global": 0.43, "replicates": 999, "regions": []}),
}


@pytest.fixture(params=sorted(ENDINGS))
def ending(request):
    return request.param, copy.deepcopy(ENDINGS[request.param])


@pytest.fixture
def endings():
    return copy.deepcopy(ENDINGS)


@pytest.fixture
def make_tree():
    return single_tree


@pytest.fixture
def catalogue():
    return catalogue_tree()


@pytest.fixture
def hostile():
    return HOSTILE
