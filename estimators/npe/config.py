"""The configuration of a training run, as in the TOML of ``gaugeblock train``."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from gaugeblock.core.errors import InputError
from gaugeblock.core.settings import apply_settings
from gaugeblock.core.tables import Named, Table, checked, read_toml

Count = Annotated[int, Field(gt=0)]


class NetworkTable(Table):
    """The network; the sizes belong to the default kind and to "laplace", the published one is fixed.

    "laplace" is for counts whose simulator gives expected counts: a flow around a Gaussian that an emulator
    of the expected counts finds. `emulator` are its hidden layers, `groups` the most channels it works on.
    """

    kind: Literal["default", "published", "laplace"] = "default"
    features: Literal["auto", "counts", "standard"] = "auto"
    embedding: tuple[Count, ...] = (256, 256)
    embedding_output: Count = 32
    transforms: Count = 3
    hidden: tuple[Count, ...] = (128, 128)
    bins: Annotated[int, Field(ge=2)] = 10
    emulator: tuple[Count, Count] = (128, 128)
    groups: Count = 128


class TrainingTable(Table):
    """How to train. `epochs` and `patience` belong to the published network, `steps` to the others.

    `fresh_noise` draws new noise at every step, where the simulator can; `keep` says which weights the
    default network ends with: those of the smallest validation loss, or the last, as a training without a
    validation set would. The emulator of a "laplace" network trains `emulator_steps`; with `redraws` its flow
    trains a second time, as many steps, on so many posterior draws beside every row's own parameters.
    `device` is where torch trains: "cpu", "cuda", "cuda:1" or "auto"; by default what the variable
    GAUGEBLOCK_DEVICE says, or the CPU. `threads` is how many of the processor's take part in a step: by
    default one, so that weights are the same bits on any number of cores; several wait more than they compute
    where networks are small or cores are shared.
    """

    simulations: Annotated[int, Field(ge=20)] = 50_000
    validation: Annotated[float, Field(gt=0.0, lt=0.5)] = 0.05
    batch: Count = 1024
    learning_rate: Annotated[float, Field(gt=0.0, le=1.0)] = 2e-3
    steps: Count = 4000
    emulator_steps: Count = 12_000
    epochs: Count = 150
    patience: Count = 20
    weight_decay: Annotated[float, Field(ge=0.0)] = 1e-5
    clip: Annotated[float, Field(gt=0.0)] = 5.0
    average: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.99
    fresh_noise: bool = True
    redraws: Annotated[int, Field(ge=0)] = 0
    keep: Literal["best", "last"] = "best"
    checkpoint: Count = 500
    seed: Annotated[int, Field(ge=0)] = 0
    device: str | None = None
    threads: Count = 1

    @model_validator(mode="after")
    def _batch_fits(self) -> TrainingTable:
        if self.batch > self.simulations:
            raise ValueError(f"batch {self.batch} is larger than simulations {self.simulations}")
        return self


class TrainingConfig(Table):
    """A whole training run: ``[simulator] [network] [training]`` and where the model folder goes.

    >>> TrainingConfig.build({"simulator": {"name": "linear_gaussian", "data": 4}}).simulator.options
    {'data': 4}
    """

    simulator: Named
    network: NetworkTable = NetworkTable()
    training: TrainingTable = TrainingTable()
    output: str | None = None

    @classmethod
    def build(cls, values: Mapping[str, Any], *, where: str = "training configuration") -> TrainingConfig:
        """Check plain data, as TOML gives it.

        Raises
        ------
        InputError
            One line that names the first key that is unknown or whose value cannot be used.
        """
        return checked(cls, values, where=where)

    def replace(
        self, overrides: Mapping[str, Any], *, where: str = "training configuration"
    ) -> TrainingConfig:
        """Copy with some keys exchanged, given as ``{"training.steps": 100}``.

        Raises
        ------
        InputError
            If a key or its value cannot be used.
        """
        values = self.model_dump(mode="json", exclude_unset=True)
        try:
            changed = apply_settings(values, overrides)
        except InputError as error:
            raise InputError(f"{where}: {error}") from None
        return type(self).build(changed, where=where)


def read_config(
    path: str | os.PathLike[str], *, overrides: Mapping[str, Any] | None = None
) -> TrainingConfig:
    """Read the TOML of a training run; `overrides` are keys such as ``training.steps``.

    Raises
    ------
    InputError
        If the file cannot be read, is no TOML, or holds an unknown key or an impossible value.
    """
    config = TrainingConfig.build(read_toml(path), where=str(path))
    return config.replace(overrides, where=str(path)) if overrides else config
