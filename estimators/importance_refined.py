"""Importance refinement: any estimator with a density, corrected by the exact likelihood and prior."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import logsumexp

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.core.values import Shown
from gaugeblock.estimators._rows import resample
from gaugeblock.estimators.protocol import has_density, sample_and_log_prob
from gaugeblock.simulators.prior import HasPriorDensity, require_prior
from gaugeblock.simulators.protocol import HasLikelihood, Simulator, description

COLLAPSED = 10.0
"""Fewer effective draws than this and a row's weights describe a few lucky draws, not the posterior."""


@dataclass(frozen=True, kw_only=True)
class WeightedDraws:
    """Draws of the base estimator with their importance weights.

    `draws` is ``(batch, n, parameter)``; `log_weight` ``(batch, n)`` is normalised, as weights sum to 1;
    `effective_draws` ``(batch,)`` is Kish's effective sample size; `log_evidence` and `log_evidence_error`
    ``(batch,)``, the error by the delta method, which is itself too small where `collapsed`.
    """

    draws: NDArray[np.float64]
    log_weight: NDArray[np.float64]
    effective_draws: NDArray[np.float64]
    log_evidence: NDArray[np.float64]
    log_evidence_error: NDArray[np.float64]

    @property
    def collapsed(self) -> NDArray[np.bool_]:
        """Rows ``(batch,)`` that rest on fewer than `COLLAPSED` effective draws: do not trust them."""
        return np.asarray(~(self.effective_draws >= COLLAPSED))

    def resample(self, n: int, rng: Rng) -> NDArray[np.float64]:
        """Equal-weight draws ``(batch, n, parameter)`` with replacement; a row with NaN weights gives NaN."""
        invalid = np.asarray(np.isnan(self.log_weight).any(axis=-1))
        log_weight = np.where(invalid[:, None], 0.0, self.log_weight)
        index = resample(log_weight, rng.random((len(self.draws), n)))
        chosen = np.take_along_axis(self.draws, index[..., None], axis=1)
        return np.where(invalid[:, None, None], np.nan, chosen)


class ImportanceRefined(Shown):
    """Draws of `base`, weighted by likelihood x prior / density and resampled.

    The refined draws follow the exact posterior as `oversample` grows, if the base covers it. They have no
    density of their own. Where the weights collapse, `refine(...)` says so; `sample` alone cannot.

    Parameters
    ----------
    base
        Estimator with `log_prob` or `sample_and_log_prob`.
    simulator
        With `log_likelihood`.
    oversample
        Draws of the base for each refined draw.
    evidence_draws
        Draws of the base for `log_evidence`.

    Raises
    ------
    InputError
        If the base has no density, the simulator no `log_likelihood`, or a number of draws is not positive.

    References
    ----------
    Rubin (1988), Bayesian Statistics 3, 395; Dax et al. (2023), PRL 130, 171403.
    """

    def __init__(
        self,
        base: Any,
        simulator: Simulator | HasLikelihood,
        *,
        oversample: int = 8,
        evidence_draws: int = 2000,
    ):
        if not has_density(base):
            raise InputError(
                f"importance_refined: {type(base).__name__} has no log_prob, so its draws cannot be weighted"
            )
        if not isinstance(simulator, HasLikelihood):
            raise InputError(
                f"importance_refined: {type(simulator).__name__} has no log_likelihood(theta, x)"
            )
        require_prior(simulator.prior, HasPriorDensity, "estimator importance_refined")
        if oversample < 1 or evidence_draws < 2:
            raise InputError(
                "importance_refined: needs oversample >= 1 and evidence_draws >= 2, "
                f"got {oversample} and {evidence_draws}"
            )
        self.base, self._simulator = base, simulator
        self._oversample, self._evidence_draws = int(oversample), int(evidence_draws)

    def log_target(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Log likelihood plus log prior, ``(batch, n)``: the numerator of the weights."""
        points, data = np.asarray(theta, dtype=float), np.asarray(x)
        log_likelihood = self._simulator.log_likelihood(points, data[:, None])
        return np.asarray(log_likelihood + self._simulator.prior.log_prob(points))

    def weights(self, x: ArrayLike, n: int, rng: Rng) -> WeightedDraws:
        """`n` draws of the base for each row of x, with weights, effective sample size and evidence."""
        draws, log_q = sample_and_log_prob(self.base, x, n, rng)
        log_weight = self.log_target(draws, x) - log_q
        with np.errstate(invalid="ignore"):  # a row whose every weight is zero: NaN, and so collapsed
            total = logsumexp(log_weight, axis=-1)
            normalised = log_weight - total[:, None]
            effective = np.exp(-logsumexp(2.0 * normalised, axis=-1))
        return WeightedDraws(
            draws=draws,
            log_weight=normalised,
            effective_draws=effective,
            log_evidence=total - np.log(n),
            log_evidence_error=np.sqrt(np.maximum(1.0 / effective - 1.0 / n, 0.0)),
        )

    def refine(self, x: ArrayLike, n: int, rng: Rng) -> tuple[NDArray[np.float64], WeightedDraws]:
        """Refined draws ``(batch, n, parameter)``, and the weighted draws they come from."""
        weighted = self.weights(x, n * self._oversample, rng)
        return weighted.resample(n, rng), weighted

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        """Refined draws, ``(batch, n, parameter)``."""
        return self.refine(x, n, rng)[0]

    def sample_and_log_evidence(
        self, x: ArrayLike, n: int, rng: Rng
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """The draws of `sample`, and the evidence by all the weights that they were chosen by."""
        draws, weighted = self.refine(x, n, rng)
        return draws, weighted.log_evidence, weighted.log_evidence_error

    def log_evidence(self, x: ArrayLike, rng: Rng) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Log evidence and its standard error by importance sampling, each ``(batch,)``."""
        weighted = self.weights(x, self._evidence_draws, rng)
        return weighted.log_evidence, weighted.log_evidence_error

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies it, base included."""
        return {
            "estimator": "importance_refined",
            "oversample": self._oversample,
            "evidence_draws": self._evidence_draws,
            "base": description(self.base),
        }
