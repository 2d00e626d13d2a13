"""How hypothesis runs here, the spectra whose likelihood is tested, and likelihoods wrong on purpose."""

from __future__ import annotations

import os

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from scipy.special import gammaln
from scipy.stats import poisson

from gaugeblock.simulators import Effect, LogUniform, Uniform

# The first call of each spectrum compiles it, so no example has a deadline. In CI the examples are the same
# each time: a red build is somebody's change, not somebody's luck.
settings.register_profile("default", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("ci", settings.get_profile("default"), derandomize=True, database=None)
_ci = os.environ.get("CI") or os.environ.get("GAUGEBLOCK_REQUIRE_ALL") == "1"
settings.load_profile("ci" if _ci else "default")


def effects():
    """Every effect, its parameters free over a generous range, so that the prior covers them too."""
    free = {
        "emission_line": {
            "energy": Uniform(0.6, 7.5),
            "sigma": LogUniform(1e-3, 0.5),
            "norm": LogUniform(1e-7, 1e-3),
        },
        "soft_excess": {"kT": Uniform(0.03, 0.5), "norm": Uniform(0.0, 1e4)},
        "thermal_continuum": {"kT": Uniform(0.3, 15.0), "norm": Uniform(0.0, 1e-2)},
        "absorption_line": {
            "energy": Uniform(0.6, 7.5),
            "sigma": LogUniform(1e-3, 0.5),
            "strength": Uniform(0.0, 1.0),
        },
        "absorption_edge": {"energy": Uniform(0.6, 7.5), "depth": Uniform(0.0, 3.0)},
        "partial_covering": {"nh": LogUniform(0.01, 100.0), "fraction": Uniform(0.0, 1.0)},
        "high_energy_cutoff": {"energy": Uniform(0.0, 7.5), "inverse_folding": Uniform(0.0, 2.0)},
        "reflection": {
            "energy": Uniform(5.0, 7.0),
            "width": LogUniform(1e-2, 1.0),
            "strength": Uniform(0.0, 5.0),
        },
        "ionised_absorber": {
            "energy": Uniform(0.6, 0.8),
            "ionisation": Uniform(0.0, 4.0),
            "depth": Uniform(0.0, 5.0),
        },
        "gain_slope": {"slope": Uniform(0.97, 1.03)},
        "gain_offset": {"offset": Uniform(-0.05, 0.05)},
        "gain_curve": {"curve": Uniform(-0.05, 0.05)},
        "effective_area": {
            "energy": Uniform(0.6, 7.5),
            "width": LogUniform(0.02, 2.0),
            "depth": Uniform(-0.9, 3.0),
        },
        "resolution": {"variance": Uniform(0.0, 0.02)},
        "background": {"level": Uniform(0.0, 1.0), "index": Uniform(-1.0, 3.0)},
        "pileup": {"overlap": Uniform(0.0, 1.0)},
        "published_partial_covering": {"fraction": Uniform(0.0, 1.0)},
        "published_thermal_continuum": {"kT": Uniform(0.3, 15.0)},
        "published_gain": {"factor": Uniform(0.97, 1.03)},
    }
    return {name: Effect(name, parameters) for name, parameters in free.items()}


TOGETHER = {
    "source": (
        "emission_line", "soft_excess", "thermal_continuum", "absorption_line", "absorption_edge",
        "partial_covering", "high_energy_cutoff", "reflection", "ionised_absorber", "effective_area",
        "published_gain",
    ),
    "recorded": (
        "emission_line", "gain_slope", "resolution", "gain_offset", "gain_curve", "pileup", "background",
    ),
    "published": ("emission_line", "published_partial_covering", "published_thermal_continuum"),
}  # fmt: skip
"""Effects that are free in one spectrum, so that few are compiled and each effect is in one of them."""


@pytest.fixture(scope="session")
def spectra(xray_data):
    """Spectra by name: without effects, on another detector, with fixed effects, with all of them free."""
    from gaugeblock.simulators.xray import XraySpectrum, reference

    plain, each = reference(), effects()
    fixed = plain.with_effect(Effect("emission_line", {"energy": 6.4, "sigma": 0.05, "norm": 1e-5}))
    fixed = fixed.with_effect(Effect("gain_slope", {"slope": 1.01}))
    named = {"plain": plain, "nicer": reference("nicer"), "fixed": fixed}
    # Bright sources pile up; the reference case has no frame time of its own.
    framed = XraySpectrum(plain.model, plain.response.with_frame_time(0.0734), plain.prior)
    for name, free in TOGETHER.items():
        named[name] = framed
        for effect in free:
            named[name] = named[name].with_effect(each[effect])
    return named


SPECTRA = ("plain", "nicer", "fixed", *TOGETHER)


@pytest.fixture(scope="session", params=SPECTRA)
def spectrum(request, spectra):
    """One of them after the other."""
    return spectra[request.param]


@pytest.fixture(scope="session")
def plain(spectra):
    """The reference spectrum alone."""
    return spectra["plain"]


class Wrong:
    """A spectrum but for one thing."""

    def __init__(self, spectrum):
        self._spectrum = spectrum
        self.prior = spectrum.prior
        self.expected = spectrum.expected
        self.simulate = spectrum.simulate
        self.log_likelihood = spectrum.log_likelihood


class DroppedFactorial(Wrong):
    def __init__(self, spectrum):
        super().__init__(spectrum)
        self.log_likelihood = lambda theta, x: (
            spectrum.log_likelihood(theta, x) + gammaln(np.asarray(x) + 1.0).sum(axis=-1)
        )


class SinglePrecision(Wrong):
    def __init__(self, spectrum):
        super().__init__(spectrum)

        def log_likelihood(theta, x):
            mean, x = spectrum.expected(theta).astype(np.float32), np.asarray(x).astype(np.float32)
            terms = x * np.log(mean) - mean - gammaln(x + np.float32(1.0))
            return np.sum(terms, axis=-1, dtype=np.float32).astype(np.float64)

        self.log_likelihood = log_likelihood


class OffByOneChannel(Wrong):
    def __init__(self, spectrum):
        super().__init__(spectrum)
        self.log_likelihood = lambda theta, x: poisson.logpmf(
            x, np.roll(spectrum.expected(theta), 1, axis=-1)
        ).sum(axis=-1)


class LinearNormPrior(Wrong):
    """The prior that the published nested sampling used where the simulations did not."""

    def __init__(self, spectrum):
        super().__init__(spectrum)
        linear = {
            n: Uniform(*m.support) for n, m in spectrum.prior.marginals.items() if isinstance(m, LogUniform)
        }
        self.prior = spectrum.prior.replace(**linear)


@pytest.fixture(scope="session")
def wrong_likelihoods():
    """What no check may let pass, by name: each makes a wrong candidate from a spectrum."""
    return {
        "dropped -log x!": DroppedFactorial,
        "float32": SinglePrecision,
        "off by one": OffByOneChannel,
        "linear norm prior": LinearNormPrior,
    }
