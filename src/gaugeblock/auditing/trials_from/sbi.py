"""sbi: posterior draws for each simulated data set, with sbi's own calls."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import xarray as xr

from gaugeblock.core.arrays import Array, plain
from gaugeblock.core.errors import InputError, blamed, require
from gaugeblock.core.global_state import seeded_globals
from gaugeblock.validate import make_trials

SOURCE = "trials_from_sbi"
# These know the posterior density but for a factor.
UNNORMALISED = {"MCMCPosterior", "RejectionPosterior", "ImportanceSamplingPosterior"}
# Draws in one call: sbi warns above twice this many. Part of what makes the draws repeatable to the bit.
AT_ONCE = 1 << 20
# So many draws sbi takes for each data set to see how much of its density lies outside the prior.
LEAKAGE_DRAWS = 10_000
# Chains in one call, for posteriors that are sampled by MCMC; sbi warns above this.
CHAINS_AT_ONCE = 100


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
    ``sample`` trial by trial. `densities` adds log q at draws and truths (``log_prob_batched``), which more
    checks need. Draws of an ``MCMCPosterior`` count as `autocorrelated` unless that is given. `seed` is
    torch's and NumPy's while this runs; both are put back.

    Raises
    ------
    MissingExtraError
        If torch is not installed.
    InputError
        If theta and x do not fit together, or the posterior cannot draw; the line says for which trials.
    """
    torch = require("torch", "sbi")
    truths, data = plain(theta, what=f"{SOURCE}: theta"), plain(x, what=f"{SOURCE}: x")
    truths = truths[:, None] if truths.ndim == 1 else truths
    if truths.ndim != 2 or data.ndim < 1 or len(data) != len(truths):
        raise InputError(
            f"{SOURCE}: theta has the shape {truths.shape}, x {data.shape}; "
            "expected (trial, parameter) and (trial, ...), with as many trials"
        )
    for needed in ("sample", *(["log_prob_batched"] if densities else [])):
        if not hasattr(posterior, needed):
            more = (
                "; leave densities=False" if needed != "sample" else "; give what build_posterior() returns"
            )
            raise InputError(f"{SOURCE}: {type(posterior).__name__} has no method {needed}{more}")
    kinds = {base.__name__ for base in type(posterior).__mro__}
    is_chain = "MCMCPosterior" in kinds
    if densities and kinds & UNNORMALISED:
        raise InputError(
            f"{SOURCE}: the density of {type(posterior).__name__} is not normalised; leave densities=False"
        )
    # sbi's networks are of single precision, whatever the simulator's is.
    given = torch.as_tensor(x if hasattr(x, "detach") else data, dtype=torch.float32)
    parts: list[Array] = []
    log_q: list[tuple[Array, Array]] = []
    with seeded_globals(seed), warnings.catch_warnings():
        # How sbi divides its work is nothing that a reader could act on.
        warnings.filterwarnings("ignore", message="Capping max_sampling_batch_size")
        length = _at_once(posterior, max(draws, LEAKAGE_DRAWS if densities else 0), is_chain=is_chain)
        for trials in _chunks(len(truths), length):
            with blamed(f"{SOURCE}: {type(posterior).__name__}", trials):
                rows = slice(trials.start, trials.stop)
                sampled = _sampled(torch, posterior, given[rows], draws)
                parts.append(_checked(sampled, posterior, (draws, len(trials), truths.shape[1])))
                if densities:
                    log_q.append(_log_q(torch, posterior, sampled, truths[rows], given[rows]))
    parameters = _names(names, truths.shape[1])
    whole = np.concatenate([part.swapaxes(0, 1) for part in parts])
    return make_trials(
        truths, whole, parameters, x=data,
        log_q=np.concatenate([at_draws for at_draws, _ in log_q]) if log_q else None,
        log_q_true=np.concatenate([at_truth for _, at_truth in log_q]) if log_q else None,
        autocorrelated=is_chain if autocorrelated is None else autocorrelated,
    )  # fmt: skip


def _names(names: Sequence[str] | None, number: int) -> list[str]:
    if names is not None:
        return [str(name) for name in names]
    return ["theta"] if number == 1 else [f"theta[{index}]" for index in range(number)]


def _chunks(number: int, length: int) -> Iterator[range]:
    return (range(start, min(start + length, number)) for start in range(0, number, length))


def _at_once(posterior: Any, draws: int, *, is_chain: bool) -> int:
    """How many trials one call samples."""
    if not _batched(posterior):
        return 1
    if is_chain:
        return max(1, CHAINS_AT_ONCE // int(getattr(posterior, "num_chains", None) or 1))
    return max(1, AT_ONCE // draws)


def _batched(posterior: Any) -> bool:
    """Whether `sample_batched` works; sbi's MCMC has it for one of its samplers only."""
    method = getattr(posterior, "method", None)
    return hasattr(posterior, "sample_batched") and method in (None, "slice_np_vectorized")


def _sampled(torch: Any, posterior: Any, x: Any, draws: int) -> Any:
    """Draws ``(draw, trial, parameter)``, a tensor."""
    if _batched(posterior):
        try:
            return posterior.sample_batched((draws,), x=x, show_progress_bars=False)
        except NotImplementedError:
            pass  # some of sbi's posteriors have the method only to say that they cannot
    single = (posterior.sample((draws,), x=x[[row]], show_progress_bars=False) for row in range(len(x)))
    return torch.stack(list(single), dim=1)


def _checked(sampled: Any, posterior: Any, shape: tuple[int, ...]) -> Array:
    array = plain(sampled, what=f"{SOURCE}: draws of {type(posterior).__name__}")
    if array.shape != shape:
        raise InputError(
            f"{SOURCE}: {type(posterior).__name__} gave draws of the shape {array.shape}; "
            f"expected {shape} for (draw, trial, parameter)"
        )
    return array


def _log_q(torch: Any, posterior: Any, sampled: Any, truths: Array, x: Any) -> tuple[Array, Array]:
    """Log q ``(trial, draw)`` at the draws and ``(trial,)`` at the truths."""
    at_truth = torch.as_tensor(truths, dtype=sampled.dtype, device=sampled.device)[None]
    points = torch.cat([sampled, at_truth])
    more = {}
    if any(base.__name__ == "DirectPosterior" for base in type(posterior).__mro__):
        # Draws that no prior can refuse need no correction, and sbi's takes long.
        more["norm_posterior"] = _bounded(posterior.prior)
    known = posterior.log_prob_batched(points, x=x, **more)
    both = plain(known, what=f"{SOURCE}: log_prob_batched of {type(posterior).__name__}")
    return both[:-1].T, both[-1]


def _bounded(prior: Any) -> bool:
    """Whether a prior may be zero somewhere; True where it does not say."""
    support: Any = getattr(prior, "support", None)
    while hasattr(support, "base_constraint"):
        support = support.base_constraint
    return str(support) not in ("Real()", "RealVector()")
