"""One likelihood, whoever asks: ours is held to 1e-9 against everyone who evaluates the same thing.

Each check below takes the reference spectrum and a candidate that claims to be it. The candidate of
`test_ours_agrees` is the spectrum itself; those of `test_a_wrong_one_is_caught` are wrong on purpose, and the
very same checks on the very same examples must then fail.
"""

from dataclasses import dataclass, replace

import mpmath
import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.special import gammaln, xlogy
from scipy.stats import poisson

RTOL = 1e-9
CANCELS = 1e8
"""Above so many counts the summands of the log likelihood cancel, and set the scale of its rounding."""

ROWS = 8
EXAMPLES = 15
SLOW = ("mpmath", "single")
KINDS = ("none", "drawn", "few", "huge", "one huge channel")


@dataclass(frozen=True)
class Batch:
    """Parameters ``(row, parameter)``, counts and their mean ``(row, channel)`` at an exposure."""

    theta: np.ndarray
    x: np.ndarray
    exposure: float
    mean: np.ndarray

    def rows(self, number):
        """The first of them."""
        return Batch(self.theta[:number], self.x[:number], self.exposure, self.mean[:number])


def draws(size):
    """Anything that the prior, the exposure and a detector allow, ends of all ranges included."""
    return st.fixed_dictionaries(
        {
            "unit": arrays.arrays(float, (ROWS, size), elements=st.floats(0.0, 1.0)),
            "log_exposure": st.floats(0.0, 7.0),
            "kinds": st.lists(st.sampled_from(KINDS), min_size=ROWS, max_size=ROWS),
            "seed": st.integers(0, 2**32 - 1),
            "slow": st.sampled_from((*SLOW, "neither")),
        }
    )


def make_batch(spectrum, drawn):
    theta = spectrum.prior.from_unit_cube(drawn["unit"])
    exposure = 10.0 ** drawn["log_exposure"]
    rng = np.random.default_rng(drawn["seed"])
    mean = spectrum.with_exposure(exposure).expected(theta)
    x = np.stack([counts(kind, row, rng) for kind, row in zip(drawn["kinds"], mean, strict=True)])
    return Batch(theta, x, exposure, mean)


def counts(kind, mean, rng):
    """A spectrum of counts; its kind has nothing to do with whether theta could have made it."""
    if kind == "none":
        return np.zeros(mean.shape, dtype=np.int64)
    if kind == "drawn":
        return rng.poisson(mean)
    if kind == "few":
        return rng.integers(0, 30, mean.shape)
    if kind == "huge":
        return rng.poisson(mean * (10.0 ** rng.uniform(8.5, 12.0) / mean.sum()))
    x = rng.poisson(mean)
    x[rng.integers(len(x))] = rng.integers(10**9, 10**13)
    return x


def agree(value, expected, batch, what):
    """Values ``(row,)`` agree to RTOL: relative, absolute near zero, of the summands where they cancel."""
    value, expected = np.asarray(value), np.asarray(expected)
    assert value.dtype == np.float64, f"{what}: {value.dtype}"
    assert value.shape == expected.shape == (len(batch.theta),), f"{what}: shape {value.shape}"
    size = np.maximum(1.0, np.abs(expected))
    summands = np.sum(np.abs(xlogy(batch.x, batch.mean)) + batch.mean + gammaln(batch.x + 1.0), axis=-1)
    size = np.where(batch.x.sum(axis=-1) > CANCELS, summands, size)
    with np.errstate(invalid="ignore"):
        off = np.abs(value - expected) / size
    assert np.all(off <= RTOL), f"{what}: {np.max(off):.3g} at exposure {batch.exposure!r}:\n{batch}"


def by_scipy(batch):
    """SciPy's Poisson distribution on the expected counts."""
    return poisson.logpmf(batch.x, batch.mean).sum(axis=-1)


def check_scipy(spectrum, candidate, batch):
    agree(candidate.log_likelihood(batch.theta, batch.x), by_scipy(batch), batch, "scipy")


def check_mpmath(spectrum, candidate, batch):
    """Fifty digits, row by row; two rows, for it is slow."""
    few = batch.rows(2)

    def exact(means, numbers):
        pairs = [(mpmath.mpf(float(m)), int(n)) for m, n in zip(means, numbers, strict=True)]
        return float(mpmath.fsum(n * mpmath.log(m) - m - mpmath.loggamma(n + 1) for m, n in pairs))

    with mpmath.workdps(50):
        expected = np.array([exact(*row) for row in zip(few.mean, few.x, strict=True)])
    agree(candidate.log_likelihood(few.theta, few.x), expected, few, "mpmath")


def check_single(spectrum, candidate, batch):
    """One at a time, and every theta against every x at once, are what a batch is."""
    rows = np.array([candidate.log_likelihood(t, x) for t, x in zip(batch.theta, batch.x, strict=True)])
    agree(rows, by_scipy(batch), batch, "single")
    table = candidate.log_likelihood(batch.theta[:2, None], batch.x[None, :3])
    assert table.shape == (2, 3)
    agree(np.diagonal(table), rows[:2], batch.rows(2), "table")


def check_ultranest(spectrum, candidate, batch):
    """The very function that the nested sampler hands to UltraNest."""
    from gaugeblock.estimators.nested_sampling import NestedSampling

    shared = replace(batch, x=np.broadcast_to(batch.x[0], batch.x.shape))
    value = NestedSampling(candidate).evaluated_log_likelihood(shared.theta, batch.x[0])
    agree(value, by_scipy(shared), shared, "ultranest")


def check_importance(spectrum, candidate, batch):
    """Likelihood times prior, as in the numerator of importance weights."""
    from gaugeblock.estimators.importance_refined import ImportanceRefined

    refined = ImportanceRefined(FromPrior(spectrum.prior), candidate)
    value = refined.log_target(batch.theta[:, None], batch.x)[:, 0]
    agree(value, by_scipy(batch) + spectrum.prior.log_prob(batch.theta), batch, "importance")


def check_prior(spectrum, candidate, batch):
    """Prior density and prior transform are one distribution, the simulator's."""
    unit = candidate.prior.to_unit_cube(batch.theta)
    theta, ours = candidate.prior.from_unit_cube(unit), spectrum.prior
    np.testing.assert_allclose(candidate.prior.log_prob(theta), ours.log_prob(batch.theta), rtol=RTOL)
    np.testing.assert_allclose(unit, ours.to_unit_cube(batch.theta), rtol=RTOL, atol=RTOL)


@dataclass(frozen=True)
class FromPrior:
    """The least an importance-refined estimator needs of its base."""

    prior: object

    def sample(self, x, n, rng):
        return np.stack([self.prior.sample(n, rng) for _ in x])

    def log_prob(self, theta, x):
        return self.prior.log_prob(theta)


CHECKS = {
    "scipy": check_scipy,
    "mpmath": check_mpmath,
    "single": check_single,
    "ultranest": check_ultranest,
    "importance": check_importance,
    "prior": check_prior,
}


def holds(check, spectrum, candidate_of, *, examples, shrink):
    """Run a check, or all, on many batches; `candidate_of` makes a candidate of the spectrum, exposed."""
    phases = (Phase.explicit, Phase.reuse, Phase.generate, *((Phase.shrink,) if shrink else ()))

    @settings(max_examples=examples, phases=phases, report_multiple_bugs=False)
    @given(draws(spectrum.prior.size))
    def run(drawn):
        batch = make_batch(spectrum, drawn)
        exposed = spectrum.with_exposure(batch.exposure)
        every = [name for name in CHECKS if name not in SLOW or name == drawn["slow"]]
        for name in [check] if check else every:
            CHECKS[name](exposed, candidate_of(exposed), batch)

    run()


def test_ours_agrees(spectrum):
    """Every check but the slow ones on 15 batches, in which each catches what is wrong; these on a third."""
    holds(None, spectrum, lambda exposed: exposed, examples=EXAMPLES, shrink=True)


LIKELIHOOD_CHECKS = ("scipy", "mpmath", "single", "ultranest", "importance")
CAUGHT_BY = [
    *((wrong, name) for wrong in ("dropped -log x!", "float32", "off by one") for name in LIKELIHOOD_CHECKS),
    ("linear norm prior", "importance"),
    ("linear norm prior", "prior"),
]


@pytest.mark.parametrize(("wrong", "name"), CAUGHT_BY)
def test_a_wrong_one_is_caught(wrong, name, plain, wrong_likelihoods):
    with pytest.raises(AssertionError):
        holds(name, plain, wrong_likelihoods[wrong], examples=EXAMPLES, shrink=False)


def test_every_effect_is_tested(spectra):
    from gaugeblock.simulators.xray.effects import EFFECTS

    assert set(EFFECTS) <= {effect.name for spectrum in spectra.values() for effect in spectrum.effects}
