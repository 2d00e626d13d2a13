"""The model folder: ``model.safetensors`` and ``model.json``. Weights are never a pickle."""

from __future__ import annotations

import hashlib
import json
import math
import os
from itertools import pairwise
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as save_tensors

from gaugeblock.core.atomic import discard_unfinished, write_atomically
from gaugeblock.core.errors import InputError
from gaugeblock.core.foreign import WEIGHTS as MOST
from gaugeblock.core.foreign import read_bytes, read_json
from gaugeblock.estimators.npe.bank import exposures_of
from gaugeblock.estimators.npe.config import NetworkTable
from gaugeblock.estimators.npe.estimator import NPE
from gaugeblock.estimators.npe.networks import NetworkShape, build_network
from gaugeblock.estimators.npe.shipped import reference_model_path
from gaugeblock.simulators.prior import Prior
from gaugeblock.simulators.protocol import Simulator

FORMAT = 1
SHIPPED = "shipped:"
WEIGHTS, DESCRIPTION = "model.safetensors", "model.json"
# Values of one data set.
LARGEST = 10_000_000
REMEDY = f"a model folder holds {WEIGHTS} and {DESCRIPTION}"


def weights_of(network: Any) -> bytes:
    """The network's tensors, feature statistics included, as safetensors."""
    tensors = {name: value.detach().clone().contiguous() for name, value in network.state_dict().items()}
    return bytes(save_tensors(tensors))


def save(
    folder: str | os.PathLike[str], network: Any, shape: NetworkShape, prior: Prior, record: dict[str, Any]
) -> None:
    """Write the model folder; `record` is what else ``model.json`` should say.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    place, weights = Path(folder), weights_of(network)
    place.mkdir(parents=True, exist_ok=True)
    description = {
        "format": FORMAT,
        "estimator": "npe",
        "sha256": hashlib.sha256(weights).hexdigest(),
        "parameters": list(prior.names),
        "prior": prior.describe(),
        "data_shape": list(shape.data_shape),
        "features": shape.features,
        **({} if shape.exposures is None else {"exposures": list(shape.exposures)}),
        **record,
    }
    write_atomically(place / WEIGHTS, weights)
    # Last, because it holds the checksum: a folder cut off in between is refused by `load`.
    write_atomically(place / DESCRIPTION, json.dumps(description, indent=1, allow_nan=False) + "\n")
    discard_unfinished(place, (WEIGHTS, DESCRIPTION))


def load(
    path: str | os.PathLike[str], simulator: Simulator | None = None, *, device: str | None = None
) -> NPE:
    """Read a model folder; with a simulator, insist that the flow was trained for its prior and data.

    A flow for many exposures comes back as one for the simulator's, where that has a single one (`NPE.at`).
    ``shipped:NAME`` stands for the folder of a flow that comes with the package. `device` is where it
    computes, as in `NPE`.

    Raises
    ------
    InputError
        If a file is missing, truncated or edited, or the simulator is not the one it was trained for; or
        there is no such device.
    """
    folder = model_folder(path)
    description = _read_description(folder / DESCRIPTION)
    weights = read_bytes(folder / WEIGHTS, most=MOST, remedy=REMEDY)
    if hashlib.sha256(weights).hexdigest() != description["sha256"]:
        raise InputError(
            f"{folder / WEIGHTS} is not the file {DESCRIPTION} describes (sha256 differs): truncated, "
            "edited, or of another training; copy the folder again or train anew"
        )
    try:
        prior = Prior.from_description(description["prior"])
        exposures = _ends(description["exposures"]) if "exposures" in description else None
        shape = NetworkShape(
            prior.size, tuple(description["data_shape"]), str(description["features"]), exposures
        )
        table = NetworkTable.model_validate(description["network"])
        _check_size(table, shape, len(weights))
        network = build_network(table, shape)
        network.load_state_dict(load_tensors(weights))
    except (SafetensorError, RuntimeError, LookupError, TypeError, ValueError) as error:
        first = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise InputError(f"{folder}: {DESCRIPTION} and {WEIGHTS} do not fit together: {first}") from None
    estimator = NPE(
        network,
        prior,
        data_shape=shape.data_shape,
        counts=shape.features == "counts",
        exposures=shape.exposures,
        record=description,
        device=device,
    )
    return estimator if simulator is None else for_simulator(estimator, simulator, where=str(folder))


def model_folder(path: str | os.PathLike[str]) -> Path:
    """The folder itself, or that of ``shipped:NAME``."""
    name = str(path)
    return reference_model_path(name.removeprefix(SHIPPED)) if name.startswith(SHIPPED) else Path(path)


def for_simulator(estimator: NPE, simulator: Simulator, *, where: str) -> NPE:
    """The flow for the data of a simulator, if prior, exposures and data shape are those it was trained for.

    Raises
    ------
    InputError
        If they are not.
    """
    trained, asked = estimator.prior, simulator.prior
    if trained.names != asked.names:
        raise InputError(
            f"{where}: trained for the parameters {', '.join(trained.names)}, but the simulator has "
            f"{', '.join(asked.names)}; give the simulator it was trained for"
        )
    for name, marginal in trained.marginals.items():
        if marginal.describe() != asked.marginals[name].describe():
            raise InputError(
                f"{where}: trained under the prior {marginal} of {name}, but the simulator has "
                f"{asked.marginals[name]}; give the simulator it was trained for, or train anew"
            )
    if estimator.exposures is not None:
        asked_for, one = exposures_of(simulator), getattr(simulator, "exposure", None)
        if asked_for is not None:
            estimator.check_exposures(*asked_for)
        elif one is not None:
            estimator = estimator.at(one)
    shape = getattr(simulator, "data_shape", None)
    if shape is not None and tuple(shape) != estimator.data_shape:
        raise InputError(
            f"{where}: trained on data of shape {estimator.data_shape}, "
            f"but the simulator makes {tuple(shape)}"
        )
    return estimator


def _ends(values: Any) -> tuple[float, float]:
    low, high = map(float, values)
    return low, high


def _check_size(table: NetworkTable, shape: NetworkShape, weights: int) -> None:
    """A network that its description makes larger than its weights is not built."""
    if math.prod(shape.data_shape) > LARGEST or min(shape.data_shape, default=0) < 0:
        raise ValueError(f"data of shape {shape.data_shape}")
    if table.kind == "published":
        return
    hidden = (*table.hidden, table.bins)
    layers = [*pairwise((*table.embedding, table.embedding_output)), *pairwise(hidden)]
    layers += [table.emulator] if table.kind == "laplace" else []
    values = max(one * other for one, other in layers) * 4, table.transforms * table.hidden[0] * 4
    if max(values) > weights:
        raise ValueError("the network is larger than its weights")


def _read_description(path: Path) -> dict[str, Any]:
    description = read_json(path, remedy=REMEDY)
    needed = ("format", "sha256", "prior", "data_shape", "features", "network")
    missing = [key for key in needed if not isinstance(description, dict) or key not in description]
    if missing:
        raise InputError(f"{path} is no description of a trained flow: it lacks {', '.join(missing)}")
    if description["format"] != FORMAT:
        raise InputError(f"{path}: format {description['format']}, but this version reads format {FORMAT}")
    return dict(description)
