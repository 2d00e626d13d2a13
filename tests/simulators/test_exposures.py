"""Counts of exposures that differ: noise and likelihood against Poisson, and what people get wrong."""

import numpy as np
import pytest
from scipy import stats

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import LogUniform, Normal, Prior, Uniform, build_simulator
from gaugeblock.simulators.exposures import AcrossExposures
from gaugeblock.simulators.protocol import HasExposures, HasLikelihood, HasNoise, Simulator


class Lamp:
    """Three colours of one rate, in 50 seconds."""

    data_shape = (3,)
    prior = Prior({"rate": Uniform(1.0, 2.0)})
    exposure = 50.0
    colours = np.array([1.0, 2.0, 5.0])

    def expected(self, theta):
        return self.exposure * np.asarray(theta)[..., :1] * self.colours

    def simulate(self, theta, rng):
        return rng.poisson(self.expected(theta))


@pytest.fixture
def lamps():
    return AcrossExposures(Lamp(), LogUniform(0.5, 500.0))


def test_it_is_a_simulator_with_noise_likelihood_and_exposures(lamps):
    assert all(isinstance(lamps, each) for each in (Simulator, HasNoise, HasLikelihood, HasExposures))
    assert not isinstance(Lamp(), HasExposures)
    assert lamps.prior is Lamp.prior
    assert lamps.data_shape == (4,)


def test_exposures_are_drawn_and_counts_grow_with_them(lamps):
    rng = np.random.default_rng(1)
    theta = np.full((40_000, 1), 1.5)
    x = lamps.simulate(theta, rng)
    assert x.shape == (40_000, 4)
    exposure = x[:, 3]
    log_share = np.log(exposure / 0.5) / np.log(1000.0)
    assert stats.kstest(log_share, "uniform").pvalue > 1e-3
    # Poisson in every decade: mean and variance by the exposure of each.
    mean = exposure[:, None] * 1.5 * Lamp.colours
    for low, high in ((0.5, 5.0), (5.0, 50.0), (50.0, 500.0)):
        rows = (exposure >= low) & (exposure < high)
        z = (x[rows, :3] - mean[rows]) / np.sqrt(mean[rows])
        assert abs(z.mean()) < 4 / np.sqrt(z.size)
        # Kurtosis of few counts included: its variance is 2 + 1/mean.
        assert abs((z**2).mean() - 1) < 4 * np.sqrt((2 + (1 / mean[rows]).mean()) / z.size)
    np.testing.assert_array_equal(x[:, :3], np.round(x[:, :3]))


def test_the_likelihood_is_that_of_the_counts_given_their_exposure(lamps):
    theta = np.array([[[1.0], [1.7]], [[1.2], [1.9]]])
    x = np.array([[3.0, 1.0, 9.0, 2.0], [130.0, 260.0, 600.0, 100.0]])
    mean = x[:, None, 3:] * theta * Lamp.colours
    expected = stats.poisson(mean).logpmf(x[:, None, :3]).sum(axis=-1)
    np.testing.assert_allclose(lamps.log_likelihood(theta, x[:, None]), expected, rtol=1e-12)


def test_the_mean_is_in_the_bases_own_exposure(lamps):
    np.testing.assert_allclose(lamps.expected([[2.0]]), [[100.0, 200.0, 500.0, 50.0]])

    # A base without one counts as 1.
    class Plain(Lamp):
        exposure = 1.0

    plain = Plain()
    without = type("Without", (), {
        "prior": Lamp.prior, "data_shape": (3,),
        "expected": lambda _, theta: plain.expected(theta), "simulate": lambda _, theta, rng: None,
    })()  # fmt: skip
    np.testing.assert_allclose(AcrossExposures(without, LogUniform(1, 2)).expected([[2.0]]), [[2, 4, 10, 1]])


def test_what_has_negative_means_is_no_counter():
    signal = AcrossExposures({"name": "linear_gaussian", "data": 4}, LogUniform(1.0, 2.0))
    assert signal.data_shape is None
    with pytest.raises(InputError, match="a LinearGaussian, are negative"):
        signal.simulate(np.ones((2, 5)) * [[1.0], [-1.0]], np.random.default_rng(1))


def test_one_simulator_says_what_it_is_and_another_that_it_is_another(lamps):
    said = lamps.describe()
    assert said["simulator"] == "across_exposures"
    assert said["exposure"] == {"distribution": "log_uniform", "low": 0.5, "high": 500.0}
    assert AcrossExposures(Lamp(), LogUniform(0.5, 50.0)).describe() != said


@pytest.mark.parametrize(
    ("base", "exposure", "words"),
    [
        ({"name": "two_moons"}, LogUniform(1.0, 2.0), "needs `expected"),
        ({"name": "linear_gaussian"}, Normal(1.0, 2.0), "two positive, finite ends"),
        ({"name": "linear_gaussian"}, Uniform(0.0, 2.0), "two positive, finite ends, got 0.0 to 2.0"),
        (
            {"name": "linear_gaussian"},
            {"distribution": "log_uniform", "low": -1, "high": 2},
            "low must be positive",
        ),
        ({"level": "bright"}, LogUniform(1.0, 2.0), "needs a name"),
    ],
)
def test_what_it_cannot_be_made_of(base, exposure, words):
    with pytest.raises(InputError, match=words):
        AcrossExposures(base, exposure)


def test_without_a_base_its_name_says_what_it_takes():
    with pytest.raises(InputError, match="its options are: base, exposure"):
        build_simulator("across_exposures")


@pytest.mark.usefixtures("xray_data")
def test_spectra_are_those_of_each_exposure():
    pytest.importorskip("jaxspec")
    from gaugeblock.simulators.xray import published, reference

    table = {"distribution": "log_uniform", "low": 10.0, "high": 1e4}
    spectra = build_simulator(
        "across_exposures", base={"name": "xray", "response": "epic-pn"}, exposure=table
    )
    assert spectra.data_shape == (103,)
    theta = published.theta(6, 1)
    x = spectra.simulate(theta, np.random.default_rng(2))
    one_by_one = [
        reference().with_exposure(row[-1]).log_likelihood(each, row[:-1])
        for each, row in zip(theta, x, strict=True)
    ]
    # But for the least count that a channel may expect, which is of the base's exposure.
    np.testing.assert_allclose(spectra.log_likelihood(theta, x), one_by_one, rtol=0, atol=2e-4)
