"""The network of the published study, built and trained by sbi."""

from __future__ import annotations

import contextlib
import io
import warnings
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d

from gaugeblock.core.devices import torch_device
from gaugeblock.core.errors import InputError, require
from gaugeblock.estimators.npe.bank import Bank, stream
from gaugeblock.estimators.npe.config import TrainingTable

require("sbi", "sbi")

from sbi.inference import NPE as Inference  # noqa: E402
from sbi.neural_nets import posterior_nn  # noqa: E402


class Convolution(nn.Conv1d):
    """A convolution with five weights, its output as long as its input: `torch.nn.Conv1d`'s, in less time.

    The features of a channel lie side by side in memory, as oneDNN computes them; in torch's usual order, a
    feature's channels side by side, it would take every spectrum apart and put it together again.
    """

    def __init__(self, features: int, made: int):
        super().__init__(features, made, 5, padding=2)

    def forward(self, x: Tensor) -> Tensor:
        """From ``(n, feature, channel)`` to as many channels of other features."""
        image, weight = (part.unsqueeze(2).to(memory_format=torch.channels_last) for part in (x, self.weight))
        return conv2d(image, weight, self.bias, padding=(0, 2)).squeeze(2)


class _Larger(torch.autograd.Function):
    """The larger of every two neighbours: what ``max_pool1d(x, 2)`` gives, in less time.

    Values and gradients are the same bits, at ties, too, where the first of two has the gradient.
    """

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        first, second = _neighbours(x)
        ctx.first_is, ctx.shape, ctx.stride = first >= second, x.shape, x.stride()
        return torch.maximum(first, second)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        made = gradient.new_empty_strided(ctx.shape, ctx.stride)
        made[..., 2 * gradient.shape[-1] :] = 0.0
        first, second = _neighbours(made)
        torch.mul(gradient, ctx.first_is, out=first)
        torch.sub(gradient, first, out=second)
        return made


def _neighbours(x: Tensor) -> tuple[Tensor, Tensor]:
    """Every first and every second entry of the last axis; an odd one out is left."""
    even = x.shape[-1] // 2 * 2
    return x[..., :even:2], x[..., 1:even:2]


class Halved(nn.Module):
    """Half as many channels: of every two the larger."""

    def forward(self, x: Tensor) -> Tensor:
        """From ``(..., channel)`` to ``(..., channel // 2)``."""
        larger: Tensor = _Larger.apply(x)
        return larger


class PublishedEmbedding(nn.Module):
    """log(1+x), two convolutions with pooling, two dense layers: 20 summaries of one spectrum, or others."""

    def __init__(self, channels: int, summaries: int = 20):
        super().__init__()
        # The study takes the larger after ReLU; before, it is the same, of half as many numbers.
        self.convolutions = nn.Sequential(
            Convolution(1, 16), Halved(), nn.ReLU(),
            Convolution(16, 32), Halved(), nn.ReLU(),
        )  # fmt: skip
        self.dense = nn.Sequential(nn.Linear(32 * (channels // 4), 64), nn.ReLU(), nn.Linear(64, summaries))

    def forward(self, x: Tensor) -> Tensor:
        """Spectra ``(n, channel)`` to summaries ``(n, summary)``."""
        logged = torch.log1p(x).to(torch.float32)
        # A GPU would convolve with ten bits: cuDNN's default, TensorFloat-32.
        with torch.backends.cudnn.flags(enabled=True, allow_tf32=False):
            return self.dense(self.convolutions(logged.unsqueeze(-2)).flatten(start_dim=-2))


def builder(data_shape: tuple[int, ...], *, z_score_theta: str = "none", summaries: int = 20) -> Any:
    """The function (theta, x) -> density estimator that sbi's trainers take.

    `z_score_theta` as sbi's: "none" for coordinates that are standardised already.

    Raises
    ------
    InputError
        If the data are no spectra of at least four channels.
    """
    if len(data_shape) != 1 or data_shape[0] < 4:
        raise InputError(
            f"the published network reads spectra of at least 4 channels, not data of shape {data_shape}; "
            'take network.kind = "default"'
        )
    return posterior_nn(
        "nsf",
        z_score_theta=z_score_theta,
        z_score_x="none",
        num_transforms=5,
        hidden_features=50,
        num_bins=10,
        embedding_net=PublishedEmbedding(data_shape[0], summaries),
    )


def build_published(parameters: int, data_shape: tuple[int, ...]) -> Any:
    """An untrained density estimator; weights by torch's global generator."""
    build = builder(data_shape)
    return build(torch.randn(2, parameters), torch.arange(2.0 * data_shape[0]).reshape(2, -1))


class _Silent:
    """An sbi tracker that keeps nothing: the default one leaves a folder of TensorBoard logs behind."""

    log_dir = None

    def _drop(self, *_: Any, **__: Any) -> None:
        """What would be written down is dropped."""

    log_metric = log_metrics = log_params = add_figure = flush = _drop


def train_published(
    bank: Bank, data_shape: tuple[int, ...], options: TrainingTable
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
        torch.default_generator.manual_seed(options.seed)
        build = builder(data_shape)  # here, because the embedding's first weights are random
        trainer = Inference(
            density_estimator=build,
            device=torch_device(options.device),
            show_progress_bars=False,
            tracker=_Silent(),
        )
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
