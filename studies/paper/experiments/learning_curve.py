"""How far the study's network is trained by 10,000, 25,000 and 50,000 spectra: its learning curve, thrice.

As the study drew it: of the smaller model, an absorbed power law on EPIC-pn at medium counts, each point one
training. Here each point is several, told by the same new spectra.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array
from studies.kit.resume import Pieces, stream
from studies.paper.calibration import correlations
from studies.paper.experiment import Experiment, Setting
from studies.paper.paper_flow import Variant, paper_flow
from studies.paper.paper_flow.variants import SEED

IN_ITS_OUTPUTS = {
    10_000: {"epochs": 69, "loss": -11.586, "r": (0.1296, 0.9839, 0.9899)},
    25_000: {"epochs": 121, "loss": -12.407, "r": (0.8096, 0.9899, 0.9989)},
    50_000: {"epochs": 55, "loss": -12.320, "r": (0.7942, 0.9899, 0.9981)},
}
"""By spectra: epochs, smallest validation loss, and correlations of truth and median in 200 spectra."""


def variant_of(spectra: int, seed: int, cap: int) -> Variant:
    """One training; which of its spectra the study took for a shorter one is not told, so all are new."""
    return Variant(
        response="epic-pn", level="medium", base=True, simulations=spectra, cap=cap,
        data_seed=seed, torch_seed=seed,
    )  # fmt: skip


def run(sizes: Mapping[str, Any], pieces: Pieces, seed: int) -> xr.Dataset:
    """By number of spectra and training: epochs, smallest loss, correlations of truth and median."""
    from studies.paper.paper_flow.__main__ import train
    from studies.paper.paper_flow.simulations import simulator_of

    spectra, seeds = list(sizes["spectra"]), list(sizes["seeds"])
    variants = [variant_of(number, each, sizes["cap"]) for number in spectra for each in seeds]
    simulator, rng = simulator_of(variants[0]), np.random.default_rng(stream(seed, "learning_curve", "test"))
    theta = simulator.prior.sample(sizes["test"], rng)
    counts = rng.poisson(simulator.expected(theta))

    def learned(index: int, rng: np.random.Generator) -> Mapping[str, Any]:
        with tempfile.TemporaryDirectory() as folder:
            train({"learned": variants[index]}, Path(folder), work=pieces.place / "trainings")
            flow = paper_flow("learned", Path(folder))
        median = np.median(flow.raw(counts, sizes["draws"], rng)[0], axis=1)
        losses = flow.record["validation"]
        return {"epochs": len(losses), "loss": min(losses), "r": correlations(theta, median)}

    found = pieces.each("training", len(variants), learned, seed)
    points = ("spectra", "training")

    def values(name: str) -> Array:
        return np.array([one[name] for one in found]).reshape(len(spectra), len(seeds), -1)

    return xr.Dataset(
        {
            "epochs": (points, values("epochs")[..., 0]),
            "loss": (points, values("loss")[..., 0]),
            "r": ((*points, "parameter"), values("r")),
        },
        coords={"spectra": spectra, "training": seeds, "parameter": list(simulator.prior.names)},
    )


EXPERIMENT = Experiment(
    name="learning_curve",
    says="how far the study's network is trained by 10,000 to 50,000 spectra of its smaller model",
    sizes={
        Setting.FULL: {
            **{"spectra": [10_000, 25_000, 50_000], "seeds": [SEED, 101, 202]},
            **{"cap": 120, "test": 2000, "draws": 1000},
        },
        Setting.TWIN: {
            **{"spectra": [1000, 2000], "seeds": [SEED, 101]},
            **{"cap": 2, "test": 100, "draws": 50},
        },
    },
    run=run,
    extra="xray",
)
