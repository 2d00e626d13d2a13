"""Training as the published study did: sbi's own NPE trainer, Adam, early stopping."""

from __future__ import annotations

import contextlib
import io
import warnings
from typing import Any

import numpy as np
import torch
from sbi.inference import NPE

from gaugeblock.core.errors import InputError
from gaugeblock.estimators.npe.bank import Bank, stream
from gaugeblock.estimators.npe.config import NetworkTable, TrainingTable
from gaugeblock.estimators.npe.networks import NetworkShape, builder


class _Silent:
    """An sbi tracker that keeps nothing: the default one leaves a folder of TensorBoard logs behind."""

    log_dir = None

    def log_metric(self, name: str, value: float, step: int | None = None) -> None:
        """Drop the number."""

    def log_metrics(self, metrics: Any, step: int | None = None) -> None:
        """Drop the numbers."""

    def log_params(self, params: Any) -> None:
        """Drop the settings."""

    def add_figure(self, name: str, figure: Any, step: int | None = None) -> None:
        """Drop the figure."""

    def flush(self) -> None:
        """Nothing is held back."""


def train_published(
    bank: Bank, network: NetworkTable, shape: NetworkShape, options: TrainingTable
) -> tuple[Any, dict[str, Any]]:
    """Density estimator and training curve.

    Two things differ from the study on purpose: parameters are in the prior's normal scores, so that no draw
    leaves the prior, and the weights are the best seen, also when `epochs` runs out first.

    Raises
    ------
    InputError
        If the data are no spectra of at least four channels, or hold negative values.
    """
    x = bank.observe(slice(None), stream(options.seed, "noise"))
    if (np.asarray(x) < 0).any():
        raise InputError(
            "the published network takes the logarithm of counts, and the data hold negative values; "
            'take network.kind = "default"'
        )
    with contextlib.ExitStack() as stack:
        stack.enter_context(torch.random.fork_rng(devices=[]))
        stack.enter_context(contextlib.redirect_stdout(io.StringIO()))
        stack.enter_context(warnings.catch_warnings())
        warnings.simplefilter("ignore")
        torch.manual_seed(options.seed)
        build = builder(network, shape)  # here, because the embedding's first weights are random
        trainer = NPE(density_estimator=build, show_progress_bars=False, tracker=_Silent())
        trainer.append_simulations(
            torch.from_numpy(bank.scores), torch.from_numpy(np.asarray(x, dtype=np.float32))
        )
        estimator = trainer.train(
            training_batch_size=options.batch,
            learning_rate=options.learning_rate,
            validation_fraction=options.validation,
            stop_after_epochs=options.patience,
            max_num_epochs=options.epochs - 1,  # sbi counts from 0 and runs one more
            clip_max_norm=options.clip,
        )
    summary = trainer.summary
    curve = {
        "epoch": list(range(1, len(summary["validation_loss"]) + 1)),
        "training": [float(v) for v in summary["training_loss"]],
        "validation": [float(v) for v in summary["validation_loss"]],
        "best": float(min(summary["validation_loss"])),
    }
    return estimator, curve
