"""sbi: posterior draws for each simulated data set, with sbi's own calls."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array, plain
from gaugeblock.core.errors import InputError, blamed, require
from gaugeblock.core.global_state import SEEDS, seeded_globals
from gaugeblock.core.streams import generator
from gaugeblock.validate import make_trials

SOURCE = "trials_from_sbi"


def trials_from_sbi(
    posterior: Any,
    theta: Any,
    x: Any,
    *,
    draws: int = 250,
    names: Sequence[str] | None = None,
    seed: int = 0,
    densities: bool = False,
    autocorrelated: bool | None = None,
) -> xr.Dataset:
    """Trials from an sbi posterior: `draws` for each data set of `x`, beside the `theta` that made it.

    `theta` ``(trial, parameter)`` are fresh draws of the prior and `x` ``(trial, ...)`` their simulations,
    torch or NumPy, none of them seen in training. ``sample_batched`` draws where the posterior has it, else
    ``sample`` trial by trial. `densities` adds log q at draws and truths, where it is normalised: more checks
    need it. Draws of an ``MCMCPosterior`` count as `autocorrelated` unless that is given. `seed` is
    torch's and NumPy's while this runs; both are put back.

    Raises
    ------
    MissingExtraError
        If torch is not installed.
    InputError
        If theta and x do not fit together, or the posterior cannot draw; the line says for which trials.
    """
    require("torch", "sbi")
    truths, data = plain(theta, what=f"{SOURCE}: theta"), plain(x, what=f"{SOURCE}: x")
    truths = truths[:, None] if truths.ndim == 1 else truths
    if truths.ndim != 2 or data.ndim < 1 or len(data) != len(truths):
        raise InputError(
            f"{SOURCE}: theta has the shape {truths.shape}, x {data.shape}; "
            "expected (trial, parameter) and (trial, ...), with as many trials"
        )
    kind = type(posterior).__name__
    if not hasattr(posterior, "sample"):
        raise InputError(f"{SOURCE}: {kind} has no method sample; give what build_posterior() returns")
    # The code that asks sbi in a stranger's sandbox too.
    model = import_module("gaugeblock.stranger.child.formats.sbi_posterior").Posterior(posterior, {})
    if densities and not hasattr(model, "log_prob"):
        raise InputError(f"{SOURCE}: the density of {kind} is not normalised; leave densities=False")
    sampled: list[Array] = []
    log_q: list[Array] = []
    length = model.at_once(draws)
    with seeded_globals(seed):
        for start in range(0, len(truths), length):
            known, given = truths[start : start + length], data[start : start + length]
            with blamed(f"{SOURCE}: {kind}", range(start, start + len(known))):
                rng = generator(seed, SOURCE, start)
                drawn = plain(model.sample(given, draws, int(rng.integers(SEEDS))), what=f"{SOURCE}: draws")
                expected = (len(known), draws, known.shape[1])
                if drawn.shape != expected:
                    raise InputError(
                        f"{SOURCE}: {kind} gave draws of the shape {drawn.shape}; "
                        f"expected {expected} for (trial, draw, parameter)"
                    )
                sampled.append(drawn)
                if densities:
                    log_q.append(model.log_prob(np.concatenate([known[:, None], drawn], axis=1), given))
    density = np.concatenate(log_q) if densities else None
    number = truths.shape[1]
    own = ["theta"] if number == 1 else [f"theta[{index}]" for index in range(number)]
    return make_trials(
        truths,
        np.concatenate(sampled),
        own if names is None else names,
        x=data,
        log_q=None if density is None else density[:, 1:],
        log_q_true=None if density is None else density[:, 0],
        autocorrelated=bool(model.chains()) if autocorrelated is None else autocorrelated,
    )
