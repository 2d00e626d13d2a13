"""Train a flow for a simulator: simulate, fit features, optimise, write the model folder."""

from __future__ import annotations

import json
import os
import shutil
import time
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import torch

from gaugeblock.core.atomic import write_atomically
from gaugeblock.core.devices import torch_device
from gaugeblock.core.digest import digest
from gaugeblock.core.errors import InputError
from gaugeblock.core.executors import threads
from gaugeblock.core.trust import modules_in, only_named
from gaugeblock.estimators.npe.bank import (
    Bank,
    Progress,
    describe_simulator,
    exposures_of,
    fingerprint,
    stream,
)
from gaugeblock.estimators.npe.config import TrainingConfig, read_config
from gaugeblock.estimators.npe.estimator import NPE
from gaugeblock.estimators.npe.features import StandardFeatures, choose_kind
from gaugeblock.estimators.npe.laplace import train_laplace
from gaugeblock.estimators.npe.loop import train_default
from gaugeblock.estimators.npe.networks import NetworkShape, build_network
from gaugeblock.estimators.npe.storage import DESCRIPTION, load, save
from gaugeblock.simulators.from_function import as_simulator
from gaugeblock.simulators.prior import HasBijections, Prior, require_prior
from gaugeblock.simulators.protocol import HasLikelihood, Simulator

FEATURE_ROWS = 20_000
KEY = "key"
CURVE_POINTS = 100


def train(
    simulator: Simulator,
    config: TrainingConfig,
    *,
    folder: str | os.PathLike[str],
    replace: bool = False,
    progress: Progress | None = None,
    command: str | None = None,
) -> NPE:
    """Train as `config` says and leave the model folder; the same call after a crash goes on where it was.

    Simulations and checkpoints lie in ``folder/training`` until the end. A folder that holds a model, or the
    unfinished training of another, is left alone without `replace`. `progress` is called as
    ``progress(stage, done, total)``. With the same seed, versions and threads weights are the same bits.

    Raises
    ------
    InputError
        If the simulator's data cannot be trained on, training diverges, the folder cannot be written, or it
        holds a model already.
    """
    begun = time.monotonic()
    device = torch_device(config.training.device, where="training.device")
    # From here on its name: a training does not go on on another one unasked.
    config = config.replace({"training.device": device})
    place, options = Path(folder), config.training
    work = place / "training"
    if options.redraws and not (config.network.kind == "laplace" and isinstance(simulator, HasLikelihood)):
        raise InputError(
            'training.redraws needs network.kind = "laplace" and a simulator with a likelihood (its '
            "`log_likelihood`)"
        )
    if config.network.kind == "published" and exposures_of(simulator) is not None:
        raise InputError(
            'network.kind = "published" reads channels alone, and here the last entry is an exposure; '
            'take "laplace" or "default"'
        )
    require_prior(simulator.prior, HasBijections, "estimator npe")
    try:
        same = Prior.from_description(simulator.prior.describe()) == simulator.prior
    except InputError:
        same = False
    if not same:
        raise InputError(
            "estimator npe: its folder could not say what the prior is; give gaugeblock.Prior of "
            "distributions of gaugeblock or scipy.stats"
        )
    begin_training(
        place, work, digest([config.model_dump(mode="json"), describe_simulator(simulator)]), replace
    )
    # A package beside us may have switched gradients off for the whole process.
    with threads(options.threads), torch.enable_grad():
        network, shape, curve, fresh = _trained(simulator, config, work, progress)
    record = {
        "network": config.network.model_dump(mode="json"),
        "training": options.model_dump(mode="json"),
        "simulator": describe_simulator(simulator),
        "simulator_table": config.simulator.model_dump(mode="json"),
        "fresh_noise": fresh,
        "validation_loss": curve["best"],
        "curve": _thinned(curve),
        "wall_seconds": round(time.monotonic() - begun, 1),
        "versions": _versions(),
        "command": command,
    }
    save(place, network, shape, simulator.prior, record)
    _draw_curve(place / "training.png", record["curve"])
    clear_up(work)
    return load(place, simulator, device=device)


def _trained(
    simulator: Simulator, config: TrainingConfig, work: Path, progress: Progress | None
) -> tuple[Any, NetworkShape, dict[str, Any], bool]:
    """The network, its shape, its losses, and whether every step drew new noise."""
    options = config.training
    bank = Bank.simulate(
        simulator,
        options.simulations,
        seed=options.seed,
        folder=work,
        fresh=options.fresh_noise,
        progress=progress,
    )
    examples = bank.observe(slice(0, FEATURE_ROWS), stream(options.seed, "features"))
    exposures = exposures_of(simulator)
    kind = choose_kind(config.network.features, examples, exposed=exposures is not None)
    shape = NetworkShape(simulator.prior.size, examples.shape[1:], kind, exposures)
    if config.network.kind == "published":
        # Here, because it alone needs sbi, whose import takes two seconds.
        from gaugeblock.estimators.npe.published import train_published

        network, curve = train_published(bank, shape.data_shape, options)
    else:
        network = build_network(config.network, shape, seed=options.seed).to(options.device)
        if config.network.kind == "laplace" and not bank.fresh:
            raise InputError(
                'network.kind = "laplace" needs a simulator with expected counts (its `expected`) and '
                "training.fresh_noise"
            )
        for module in network.modules():
            if isinstance(module, StandardFeatures) and config.network.kind == "default":
                module.fit(examples)
        key = fingerprint(
            simulator.prior,
            [config.network.model_dump(), options.model_dump(), describe_simulator(simulator), FEATURE_ROWS],
        )
        if config.network.kind == "laplace":
            curve = train_laplace(network, bank, options, folder=work, key=key, progress=progress)
        else:
            curve = train_default(
                network, bank, options, checkpoint=work / "checkpoint.safetensors", key=key, progress=progress
            )
    return network, shape, curve, bank.fresh


def run_training(
    config_path: str | os.PathLike[str],
    *,
    out: str | os.PathLike[str] | None = None,
    overrides: Mapping[str, Any] | None = None,
    seed: int | None = None,
    replace: bool = False,
    allow_modules: Iterable[str] = (),
    progress: Progress | None = None,
) -> Path:
    """What ``gaugeblock train CONFIG.toml`` does; returns the model folder.

    `overrides` are keys such as ``training.steps``; `allow_modules` are modules that the file may name;
    `out` and `seed` go before what the file says; `replace` a model that is there.

    Raises
    ------
    InputError
        If the configuration cannot be used, names no folder for the model, or that one holds another.
    """
    changes = dict(overrides or {})
    if seed is not None:
        changes["training.seed"] = seed
    config = read_config(config_path, overrides=changes)
    target = out if out is not None else config.output
    if target is None:
        raise InputError(f'{config_path}: no folder for the model; set output = "..." or give --out')
    # json.dumps writes a value as TOML does, for the numbers, strings and lists that can stand here.
    settings = "".join(f" --set {name}={json.dumps(value)}" for name, value in changes.items())
    place = f" --out {out}" if out is not None else ""
    command = f"gaugeblock train {config_path}{place}{settings}"
    with only_named({*allow_modules, *modules_in(changes)}):
        simulator = as_simulator(config.simulator.table)
    train(simulator, config, folder=target, replace=replace, progress=progress, command=command)
    return Path(target)


def begin_training(place: Path, work: Path, key: str, replace: bool) -> None:
    """Claim the folder for one training; what else lies in `work` says itself what it is of."""
    stated = work / KEY
    try:
        if not (stated.is_file() and stated.read_text(encoding="ascii") == key):
            unfinished = work.exists() and (not work.is_dir() or any(work.iterdir()))
            if (unfinished or (place / DESCRIPTION).exists()) and not replace:
                what = "the unfinished training of another model" if unfinished else "a model"
                raise InputError(f"{place}: holds {what}; give --replace to replace it, or another folder")
            work.mkdir(parents=True, exist_ok=True)
            write_atomically(stated, key)
    except OSError as error:
        raise InputError(f"cannot write {place}: {error.strerror or error}") from None


def clear_up(work: Path) -> None:
    """Remove what a training went on from, its key at last: killed in between, it is known as its own."""
    for path in work.iterdir():
        if path.name == KEY:
            continue
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path, ignore_errors=True)
        else:
            path.unlink(missing_ok=True)
    shutil.rmtree(work, ignore_errors=True)


def _thinned(curve: Mapping[str, Any]) -> dict[str, Any]:
    """At most `CURVE_POINTS` points of each series, ends included, in six digits."""
    series = {name: values for name, values in curve.items() if isinstance(values, list)}
    length = len(next(iter(series.values())))
    chosen = np.unique(np.linspace(0, length - 1, min(length, CURVE_POINTS)).round().astype(int))
    # A loss that was not finite on the way is null: JSON knows no NaN.
    return {
        name: [round(values[i], 6) if np.isfinite(values[i]) else None for i in chosen]
        for name, values in series.items()
    }


def _versions() -> dict[str, str]:
    found = {}
    for package in ("gaugeblock", "sbi", "torch", "zuko", "numpy", "jaxspec"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def _draw_curve(path: Path, curve: Mapping[str, Any]) -> None:
    """A picture of the losses, where matplotlib is installed."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return
    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    abscissa = "step" if "step" in curve else "epoch"
    for name in ("training", "validation"):
        axes.plot(curve[abscissa], curve[name], label=name)
    axes.set(xlabel=abscissa, ylabel="mean -log q (normal scores)")
    axes.legend()
    figure.savefig(path, dpi=120)
