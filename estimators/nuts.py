"""The No-U-Turn sampler through numpyro: a second exact family, for likelihoods JAX can differentiate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.errors import InputError, require
from gaugeblock.estimators._rows import row_seeds
from gaugeblock.simulators.protocol import can
from gaugeblock.streams import Rng


@dataclass(frozen=True, kw_only=True)
class NutsRun:
    """Chains, one a row of data, with what the sampler says about itself.

    `draws` is ``(batch, n, parameter)`` in physical units; `divergences` counts divergent steps after
    warm-up, `acceptance` is the mean acceptance probability, `step_size` the adapted step, each ``(batch,)``.
    """

    draws: NDArray[np.float64]
    divergences: NDArray[np.int64]
    acceptance: NDArray[np.float64]
    step_size: NDArray[np.float64]


class Nuts:
    """One NUTS chain a row of data, many rows side by side, in the prior's unbounded coordinates.

    A chain starts at the likeliest of `starts` draws from the prior, adapts its step and a dense mass matrix
    during `warmup` steps, and keeps every `thinning`-th step after that. One chain does not cross between
    well-separated modes. Everything runs in float64 without touching JAX's global state; rows are padded to
    powers of two of at most `parallel`, so only a few shapes are compiled. Rows of one trial's stream always
    get the same random numbers, but a chain amplifies the last bit of its gradients: across batch sizes
    draws agree in distribution, not in value.

    Parameters
    ----------
    simulator
        With ``log_likelihood_jax(theta, x)``: traceable, one theta ``(parameter,)`` and one x.
    warmup, thinning, starts
        As above.
    parallel
        Most chains run side by side.
    target_acceptance
        Acceptance probability that the step size is adapted to.

    Raises
    ------
    InputError
        If the simulator has no `log_likelihood_jax` or a number is out of range.
    MissingExtraError
        If numpyro or JAX is not installed.

    References
    ----------
    Hoffman & Gelman (2014), JMLR 15, 1593; Phan, Pradhan & Jankowiak (2019), arXiv:1912.11554.
    """

    autocorrelated = True

    def __init__(
        self,
        simulator: Any,
        *,
        warmup: int = 500,
        thinning: int = 2,
        starts: int = 256,
        parallel: int = 32,
        target_acceptance: float = 0.8,
    ):
        require("jax", "nuts")
        require("numpyro", "nuts")
        if not can(simulator, "log_likelihood_jax"):
            raise InputError(
                f"nuts: {type(simulator).__name__} has no log_likelihood_jax(theta, x); take nested_sampling"
            )
        if min(warmup, thinning, starts, parallel) < 1 or not 0.0 < target_acceptance < 1.0:
            raise InputError(
                "nuts: warmup, thinning, starts, parallel must be at least 1, target_acceptance in (0, 1), "
                f"got {warmup}, {thinning}, {starts}, {parallel} and {target_acceptance}"
            )
        self._simulator = simulator
        self._parallel = int(parallel)
        self._settings = {
            "warmup": int(warmup),
            "thinning": int(thinning),
            "starts": int(starts),
            "target_acceptance": float(target_acceptance),
        }
        import jax

        # One function for the life of the estimator: JAX compiles it once for each batch shape and n.
        self._chains = jax.jit(jax.vmap(self._chain, in_axes=(0, 0, None)), static_argnums=2)

    def _chain(self, seed: Any, x: Any, n: int) -> tuple[Any, Any, Any, Any]:
        """One chain on one row of data, traced."""
        import jax
        import jax.numpy as jnp
        from numpyro.infer.hmc import hmc

        prior, settings = self._simulator.prior, self._settings

        def log_likelihood(z: Any) -> Any:
            return self._simulator.log_likelihood_jax(prior.from_unbounded(z), x)

        def potential(z: Any) -> Any:
            return -(log_likelihood(z) + prior.log_prob_unbounded(z))

        start_key, run_key = jax.random.split(jax.random.key(seed))
        starts = _draw_unbounded(prior, start_key, int(settings["starts"]))
        # A row at a time: all starts of all rows at once would need memory for every one of them.
        start = starts[jnp.argmax(jnp.nan_to_num(jax.lax.map(log_likelihood, starts), nan=-jnp.inf))]
        initialise, advance = hmc(potential_fn=potential, algo="NUTS")
        state = initialise(
            start,
            settings["warmup"],
            dense_mass=True,
            target_accept_prob=settings["target_acceptance"],
            find_heuristic_step_size=True,
            rng_key=run_key,
        )
        state = jax.lax.fori_loop(0, settings["warmup"], lambda _, s: advance(s), state)

        def keep(carry: Any, _: None) -> Any:
            def step(_: int, inner: Any) -> Any:
                moved, divergent = inner
                moved = advance(moved)
                return moved, divergent + moved.diverging

            carry = jax.lax.fori_loop(0, settings["thinning"], step, carry)
            return carry, carry[0].z

        (state, divergent), chain = jax.lax.scan(keep, (state, jnp.zeros((), dtype=int)), None, length=n)
        return prior.from_unbounded(chain), divergent, state.mean_accept_prob, state.adapt_state.step_size

    def run(self, x: ArrayLike, n: int, rng: Rng) -> NutsRun:
        """One chain of n kept draws for each row of x."""
        import jax

        data = np.asarray(x, dtype=float)
        seeds = row_seeds(rng, len(data))
        blocks = []
        with jax.enable_x64(True):
            for start in range(0, len(data), self._parallel):
                rows, keys = data[start : start + self._parallel], seeds[start : start + self._parallel]
                padding = (1 << (len(rows) - 1).bit_length()) - len(rows)
                rows = np.concatenate([rows, np.repeat(rows[-1:], padding, axis=0)])
                padded_keys = np.concatenate([keys, np.repeat(keys[-1:], padding)])
                results = self._chains(padded_keys, rows, n)
                blocks.append([np.asarray(result)[: len(keys)] for result in results])
        if not blocks:
            blocks = [[np.empty((0, n, self._simulator.prior.size)), *(np.empty(0) for _ in range(3))]]
        draws, divergences, acceptance, step_size = (
            np.concatenate(parts) for parts in zip(*blocks, strict=True)
        )
        return NutsRun(
            draws=draws.astype(float),
            divergences=divergences.astype(np.int64),
            acceptance=acceptance,
            step_size=step_size,
        )

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        """Autocorrelated posterior draws, ``(batch, n, parameter)``."""
        return self.run(x, n, rng).draws

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies it."""
        return {"estimator": "nuts", "parallel": self._parallel, **self._settings}


def _draw_unbounded(prior: Any, key: Any, n: int) -> Any:
    """Prior draws in unbounded coordinates ``(n, parameter)``: logistic where bounded, normal where not."""
    import jax
    import jax.numpy as jnp

    keys = jax.random.split(key, prior.size)
    return jnp.stack(
        [
            (jax.random.logistic if np.isfinite(marginal.support[0]) else jax.random.normal)(column, (n,))
            for column, marginal in zip(keys, prior.marginals.values(), strict=True)
        ],
        axis=-1,
    )
