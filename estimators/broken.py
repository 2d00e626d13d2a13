"""The zoo: estimators that are wrong in a known way, to see whether a gate blocks them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gaugeblock.core.errors import InputError
from gaugeblock.core.streams import Rng
from gaugeblock.core.values import Shown
from gaugeblock.estimators._faults import FAULTS
from gaugeblock.estimators._ingredients import Ingredients
from gaugeblock.estimators.protocol import Estimator, HasDensity
from gaugeblock.simulators.prior import HasPriorDensity, Prior
from gaugeblock.simulators.protocol import (
    HasExactDensity,
    HasExactEvidence,
    HasExactPosterior,
    HasLikelihood,
    Simulator,
    description,
)


class Broken(Shown):
    """A sound estimator with one fault of one size.

    ========================= ======= =====================================================================
    fault                     size    what is wrong
    ========================= ======= =====================================================================
    ``narrow``, ``wide``      0.9 1.1 width ratio of every parameter, about the posterior mean
    ``shifted``               0.1     every parameter displaced by so many posterior sd
    ``swapped``                       the first two parameters exchanged
    ``uncorrelated``                  marginals as they should be, correlations dropped
    ``wrong_joint``                   marginals as they should be, the last parameter's correlations reversed
    ``mode_dropped``                  one side of the plane across the posterior's longest axis is missing:
                                      of a posterior with two modes, one of them
    ``prior``                         draws of the prior, whatever the data
    ``leaking``               0.5     draws pulled to the truth, as far as to this share of their distance;
                                      needs data that hold it, `WithTruth`
    ``some_nan``              0.01    this share of the draws is NaN
    ``fixed_seed``                    every trial's draws are made of the same random numbers
    ``unnormalised``          0.5     log density too high by so many nat; the draws are sound
    ``wrong_when_bright``     0.7     width ratio for the brightest fifth of the data; the others are so much
                                      too wide that the width is right in the mean square over all
    ========================= ======= =====================================================================

    ``narrow wide shifted swapped prior leaking some_nan fixed_seed unnormalised wrong_when_bright`` keep the
    base's density, changed as the draws are; the others have none. Draws that are moved may leave the
    prior's support.

    Parameters
    ----------
    base
        The sound estimator, or its name.

    Raises
    ------
    InputError
        If there is no such fault, it has no such size, or the simulator has too few parameters for it.

    >>> from gaugeblock.estimators import build_estimator
    >>> from gaugeblock.simulators import build_simulator
    >>> simulator = build_simulator("linear_gaussian", parameters=2, data=3)
    >>> broken = build_estimator("broken", simulator, fault="narrow", size=0.8)
    >>> broken.sample(np.zeros((4, 3)), 10, np.random.default_rng(1)).shape
    (4, 10, 2)
    """

    def __init__(
        self,
        simulator: Simulator,
        *,
        fault: str,
        size: float | None = None,
        base: Estimator | str = "exact",
    ):
        if fault not in FAULTS:
            raise InputError(f"broken: no fault {fault!r}; there are {', '.join(FAULTS)}")
        chosen = FAULTS[fault]
        if simulator.prior.size < chosen.parameters:
            raise InputError(
                f"broken: fault {fault!r} needs {chosen.parameters} parameters, the simulator has "
                f"{simulator.prior.size}"
            )
        _check_size(fault, size)
        if isinstance(base, str):
            from gaugeblock.estimators.registry import build_estimator

            base = build_estimator(base, simulator)
        used = chosen.size if size is None else float(size)
        self._name, self._fault, self._size, self._base = fault, chosen, used, base
        self._ingredients = Ingredients(base, simulator, np.nan if used is None else used)
        self.autocorrelated = bool(getattr(base, "autocorrelated", False))
        known = fault != "prior" or isinstance(simulator.prior, HasPriorDensity)
        if chosen.log_prob is not None and isinstance(base, HasDensity) and known:
            self.log_prob = self._log_prob

    def sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        """Faulty draws, ``(batch, n, parameter)``."""
        return self._fault.sample(self._ingredients, np.asarray(x), n, rng)

    def _log_prob(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        """Log density of the faulty draws, ``(batch, n)``; for ``unnormalised``, what it claims to be."""
        assert self._fault.log_prob is not None
        return self._fault.log_prob(self._ingredients, np.asarray(theta, dtype=float), np.asarray(x))

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies it, base included."""
        return {
            "estimator": "broken",
            "fault": self._name,
            "size": self._size,
            "base": description(self._base),
        }


def _check_size(fault: str, size: float | None) -> None:
    sizes = FAULTS[fault].sizes
    if size is None:
        return
    if sizes is None:
        raise InputError(f"broken: fault {fault!r} has no size, got {size}")
    if not (sizes[0] < size < sizes[1]):
        raise InputError(
            f"broken: the size of {fault!r} must lie between {sizes[0]:.3g} and {sizes[1]:.3g}, got {size}"
        )


class WithTruth(Shown):
    """A simulator whose data end with the parameters that made them: what an estimator must never see.

    Likelihood and exact posterior are of the data alone, so that an estimator which looks at the rest shows
    as one that knows more than the data say. The data must be one-dimensional.

    >>> from gaugeblock.simulators import build_simulator
    >>> leaky = WithTruth("linear_gaussian", parameters=2, data=3)
    >>> leaky.simulate([[1.0, 2.0]], np.random.default_rng(1))[:, 3:].tolist()
    [[1.0, 2.0]]

    Raises
    ------
    InputError
        If the data of the base have more than one axis.
    """

    def __init__(self, base: Simulator | str, **options: Any):
        if isinstance(base, str):
            from gaugeblock.simulators.registry import build_simulator

            base = build_simulator(base, **options)
        self._base: Any = base  # its capabilities are asked for once, below
        if isinstance(base, HasLikelihood):
            self.log_likelihood = self._log_likelihood
        if isinstance(base, HasExactPosterior):
            self.posterior_sample = self._posterior_sample
        if isinstance(base, HasExactDensity):
            self.posterior_log_prob = self._posterior_log_prob
        if isinstance(base, HasExactEvidence):
            self.log_evidence = self._log_evidence

    @property
    def prior(self) -> Prior:
        """The base's."""
        prior: Prior = self._base.prior
        return prior

    def simulate(self, theta: ArrayLike, rng: Rng) -> NDArray[np.float64]:
        """Data of the base, then theta, ``(n, data + parameter)``."""
        x = np.asarray(self._base.simulate(theta, rng), dtype=float)
        if x.ndim != 2:
            raise InputError(f"WithTruth: the data must be one-dimensional, got shape {x.shape[1:]}")
        return np.concatenate([x, np.asarray(theta, dtype=float)], axis=1)

    def data(self, x: ArrayLike) -> NDArray[np.float64]:
        """The data alone."""
        return np.asarray(x)[..., : -self.prior.size]

    def truth(self, x: ArrayLike) -> NDArray[np.float64]:
        """The truth alone, ``(..., parameter)``."""
        return np.asarray(x)[..., -self.prior.size :]

    def _log_likelihood(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(self._base.log_likelihood(theta, self.data(x)))

    def _posterior_sample(self, x: ArrayLike, n: int, rng: Rng) -> NDArray[np.float64]:
        return np.asarray(self._base.posterior_sample(self.data(x), n, rng))

    def _posterior_log_prob(self, theta: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(self._base.posterior_log_prob(theta, self.data(x)))

    def _log_evidence(self, x: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(self._base.log_evidence(self.data(x)))

    def describe(self) -> dict[str, Any]:
        """Plain data that identifies it, base included."""
        return {"simulator": "with_truth", "base": description(self._base)}
