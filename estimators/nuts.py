"""The No-U-Turn sampler through numpyro: a second exact family, for likelihoods JAX can differentiate."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import InputError, require
from gaugeblock.core.precision import double_precision
from gaugeblock.core.streams import Rng
from gaugeblock.core.values import Shown
from gaugeblock.estimators._rows import padded, row_seeds
from gaugeblock.simulators.prior import HasBijections, require_prior
from gaugeblock.simulators.protocol import HasTraceableLikelihood

BLOCK = 50
"""Draws kept by one call of the compiled sampler: any n is made of such calls, so n is never compiled in."""


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


class Nuts(Shown):
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
        if not isinstance(simulator, HasTraceableLikelihood):
            raise InputError(
                f"nuts: {type(simulator).__name__} has no log_likelihood_jax(theta, x); take nested_sampling"
            )
        require_prior(simulator.prior, HasBijections, "estimator nuts")
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

        # Two functions for the life of the estimator, compiled once for each batch shape.
        self._start = jax.jit(jax.vmap(self._start_chain))
        self._advance = jax.jit(jax.vmap(self._advance_chain, in_axes=(0, 0, None)))

    def _log_density(self, z: Any, x: Any) -> Any:
        """Log likelihood plus log prior, in unbounded coordinates."""
        prior = self._simulator.prior
        return self._simulator.log_likelihood_jax(prior.from_unbounded(z), x) + prior.log_prob_unbounded(z)

    def _kernel(self) -> Any:
        from numpyro.infer.hmc import hmc

        return hmc(potential_fn_gen=lambda x: lambda z: -self._log_density(z, x), algo="NUTS")

    def _initialise(self, start: Any, x: Any, key: Any) -> tuple[Any, Any]:
        """State of a chain before its first step, and the function that advances it by one."""
        initialise, advance = self._kernel()
        state = initialise(
            start,
            self._settings["warmup"],
            dense_mass=True,
            target_accept_prob=self._settings["target_acceptance"],
            model_args=(x,),
            rng_key=key,
        )
        return state, advance

    def _start_chain(self, seed: Any, x: Any) -> Any:
        """State of one chain at its start, traced."""
        import jax
        import jax.numpy as jnp

        start_key, run_key = jax.random.split(jax.random.key(seed))
        starts = _draw_unbounded(self._simulator.prior, start_key, int(self._settings["starts"]))
        # One start at a time: all starts of all rows at once would need memory for every one of them.
        likelihood = jax.lax.map(
            lambda z: self._simulator.log_likelihood_jax(self._simulator.prior.from_unbounded(z), x), starts
        )
        start = starts[jnp.argmax(jnp.nan_to_num(likelihood, nan=-jnp.inf))]
        return self._initialise(start, x, run_key)[0]

    def _advance_chain(self, state: Any, x: Any, steps: Any) -> tuple[Any, Any, Any]:
        """One chain through ``steps[k]`` steps before it keeps its k-th draw, traced.

        Returns its state, the kept draws ``(BLOCK, parameter)`` and how many steps diverged.
        """
        import jax
        import jax.numpy as jnp

        # numpyro sets its kernel up by initialising it; only the function is wanted here, not the state.
        _, advance = self._initialise(state.z, x, state.rng_key)

        def step(_: Any, carry: Any) -> Any:
            moved = advance(carry[0], (x,))
            return moved, carry[1] + moved.diverging

        def keep(carry: Any, count: Any) -> Any:
            carry = jax.lax.fori_loop(0, count, step, carry)
            return carry, carry[0].z

        (state, divergent), chain = jax.lax.scan(keep, (state, jnp.zeros((), dtype=int)), steps)
        return state, self._simulator.prior.from_unbounded(chain), divergent

    def _block(self, x: NDArray[np.float64], seeds: NDArray[np.int64], n: int) -> NutsRun:
        """Chains for one padded batch."""
        first_only = np.arange(BLOCK) == 0
        state, _, _ = self._advance(
            self._start(seeds, x), x, np.where(first_only, self._settings["warmup"], 0)
        )
        kept, divergences = (
            [np.empty((len(x), 0, self._simulator.prior.size))],
            np.zeros(len(x), dtype=np.int64),
        )
        for start in range(0, n, BLOCK):
            steps = np.where(np.arange(BLOCK) < n - start, self._settings["thinning"], 0)
            state, draws, divergent = self._advance(state, x, steps)
            kept.append(np.asarray(draws)[:, : n - start])
            divergences += np.asarray(divergent)
        return NutsRun(
            draws=np.concatenate(kept, axis=1),
            divergences=divergences,
            acceptance=np.asarray(state.mean_accept_prob),
            step_size=np.asarray(state.adapt_state.step_size),
        )

    def run(self, x: ArrayLike, n: int, rng: Rng) -> NutsRun:
        """One chain of n kept draws for each row of x, one row or more."""
        data = np.asarray(x, dtype=float)
        seeds = row_seeds(rng, len(data))
        runs, sizes = [], []
        with double_precision():
            for start in range(0, len(data), self._parallel):
                rows, keys = data[start : start + self._parallel], seeds[start : start + self._parallel]
                runs.append(self._block(padded(rows), padded(keys), n))
                sizes.append(len(rows))

        def join(name: str) -> NDArray[Any]:
            parts = [getattr(run, name)[:size] for run, size in zip(runs, sizes, strict=True)]
            return np.concatenate(parts)

        return NutsRun(**{each.name: join(each.name) for each in fields(NutsRun)})

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        """Autocorrelated posterior draws, ``(batch, n, parameter)``."""
        if not len(np.asarray(x)):
            return np.empty((0, n, self._simulator.prior.size))
        return self.run(x, n, rng).draws

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies it."""
        return {"estimator": "nuts", "parallel": self._parallel, **self._settings}


def _draw_unbounded(prior: Any, key: Any, n: int) -> Any:
    """Starts in unbounded coordinates ``(n, parameter)``: draws of uniform and normal priors, near others."""
    import jax
    import jax.numpy as jnp

    keys = jax.random.split(key, prior.size)
    return jnp.stack(
        [
            (jax.random.normal if normal else jax.random.logistic)(column, (n,))
            for column, normal in zip(keys, prior.standard_normal, strict=True)
        ],
        axis=-1,
    )
