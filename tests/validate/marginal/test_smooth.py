from __future__ import annotations

import numpy as np
import pytest
from scipy import special, stats

from gaugeblock.validate.marginal.smooth import MEANINGS, legendre_components, smooth_finding, smooth_test


def test_components_are_those_of_the_library_s_polynomials():
    u = np.random.default_rng(0).random(50)
    for degree, component in enumerate(legendre_components(u, order=6), start=1):
        expected = np.sqrt(2 * degree + 1) * special.eval_sh_legendre(degree, u).sum() / np.sqrt(50)
        assert component == pytest.approx(expected, abs=1e-12)


def test_components_are_uncorrelated_with_unit_variance():
    """20,000 uniform samples of 30: each of 16 covariances within 5 errors (1e-5)."""
    components = legendre_components(np.random.default_rng(1).random((30, 20_000)))
    np.testing.assert_allclose(np.cov(components), np.eye(4), atol=5 * np.sqrt(3 / 20_000))


@pytest.mark.parametrize("n", [2, 5, 30, 199, 200, 1000])
def test_size(n):
    """4,000 uniform samples: rejections at 5% and 1% inside the 0.0005 and 0.9995 binomial quantiles."""
    rng = np.random.default_rng(n)
    p = np.array([smooth_test(sample).p_value for sample in rng.random((4000, n))])
    for level in (0.05, 0.01):
        rejected = np.count_nonzero(p <= level)
        assert stats.binom.ppf(0.0005, 4000, level) <= rejected <= stats.binom.ppf(0.9995, 4000, level)
    assert p.min() >= 1 / 20_001 or n >= 200


POWER = {  # trials: posterior 10% narrow, bias of 0.1 sd; as tabulated for one dimension at 5%
    200: (0.42, 0.21),
    500: (0.75, 0.36),
    1000: (0.96, 0.72),
    2000: (1.0, 0.96),
}


@pytest.mark.parametrize("n", POWER)
def test_power_is_that_of_the_table(n):
    """1,000 repetitions against figures good to about 0.03: within that plus 3.5 binomial errors (5e-4)."""
    rng = np.random.default_rng(n)
    z = rng.normal(size=(1000, n))
    for u, expected in zip((stats.norm.cdf(z / 0.9), stats.norm.cdf(z + 0.1)), POWER[n], strict=True):
        power = np.mean([smooth_test(sample).p_value <= 0.05 for sample in u])
        assert abs(power - expected) <= 0.03 + 3.5 * np.sqrt(max(expected * (1 - expected), 0.005) / 1000)


@pytest.mark.parametrize(
    ("fault", "component"),
    [
        (lambda z, _: stats.norm.cdf(z + 0.2), 0),
        (lambda z, _: stats.norm.cdf(z / 0.85), 1),
        (lambda _, rng: stats.norm.cdf(rng.exponential(size=4000) - 1), 2),  # true posterior skewed upwards
        (lambda _, rng: stats.norm.cdf(stats.t.rvs(5, size=4000, random_state=rng) / np.sqrt(5 / 3)), 3),
    ],
)
def test_components_say_what_kind_of_fault_it_is(fault, component):
    rng = np.random.default_rng(3)
    test = smooth_test(fault(rng.normal(size=4000), rng))
    assert test.p_value < 1e-4
    assert test.component[component] > 3
    if component < 2:  # a skewed or heavy-tailed posterior has more wrong than that
        assert np.abs(test.component).argmax() == component


def test_finding_carries_its_components():
    finding = smooth_finding("a", np.random.default_rng(4).random(300))
    assert (finding.id, finding.kind, finding.quantity) == ("sbc.smooth[a]", "test", "")
    assert finding.details["smooth"].coords["meaning"].values.tolist() == list(MEANINGS)
    assert finding.estimate[0] == pytest.approx(float((finding.details["smooth"] ** 2).sum()))


def test_hopeless_samples_have_tiny_p_values():
    assert 0 < smooth_test(np.full(4000, 0.999)).p_value < 1e-100
    assert smooth_test(np.full(50, 0.999)).p_value == 1 / 20_001
