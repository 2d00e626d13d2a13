"""A flow trained anew with the effects in the simulator: they are nuisance, marginalised by training."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from gaugeblock.discovery.extend.composition import Addition, extended

if TYPE_CHECKING:
    from gaugeblock.estimators.npe import NPE, TrainingConfig


def retrain(
    simulator: Any,
    effects: Addition | Iterable[Addition],
    config: TrainingConfig,
    *,
    folder: str | os.PathLike[str],
    progress: Callable[[str, int, int], None] | None = None,
) -> NPE:
    """Train a flow for the simulator with the effects in it, and leave its model folder.

    Simulations draw the effects' free parameters from their priors with all others, so the flow's posterior
    of the model's own parameters is marginal over them: leave the effects' columns of its draws out. The
    same as ``gaugeblock train`` with ``effects`` in its ``[simulator]``.

    Raises
    ------
    InputError
        If the effects do not fit the simulator, or it cannot be trained on.
    MissingExtraError
        If sbi is not installed.
    """
    from gaugeblock.estimators.npe import train

    return train(extended(simulator, effects), config, folder=folder, progress=progress)
