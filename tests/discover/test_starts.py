"""Where fits begin: at the likeliest draws, and at every place where something narrow may be."""

import numpy as np
import pytest

from gaugeblock.discovery.fitting import fit
from gaugeblock.discovery.starts import likeliest_draws
from gaugeblock.simulators import LogUniform, Prior, Uniform
from gaugeblock.simulators.protocol import poisson_log_likelihood

THETA = np.array([[2000.0, 1.5], [300.0, 2.5], [50_000.0, 0.3]])


def test_fits_begin_at_the_likeliest_draws_under_each_exposure(power_law):
    simulator, scale = power_law(), np.array([0.5, 2.0, 10.0])
    counts = np.round(simulator.expected(THETA) * scale[:, None])
    found = likeliest_draws(simulator, counts, scale, bank=60, tries=3, seed=4)
    drawn = simulator.prior.sample(60, np.random.default_rng(4))
    for i in range(3):
        likely = [poisson_log_likelihood(scale[i] * simulator.expected(one), counts[i]) for one in drawn]
        np.testing.assert_array_equal(found[i], drawn[np.argsort(likely)[::-1][:3]])


def test_fits_begin_in_every_range_of_every_parameter_too(power_law):
    """Of equally many draws each, the likeliest, after the likeliest of all; without ranges, not."""
    simulator, scale = power_law(), np.array([0.5, 2.0, 10.0])
    counts = np.round(simulator.expected(THETA) * scale[:, None])
    plain = likeliest_draws(simulator, counts, scale, bank=90, tries=2, seed=4)
    found = likeliest_draws(simulator, counts, scale, bank=90, tries=2, seed=4, ranges=3)
    assert found.shape == (3, 2 + 2 * 3, 2)
    np.testing.assert_array_equal(found[:, :2], plain)
    drawn = simulator.prior.sample(90, np.random.default_rng(4))
    for i, later in enumerate(found[:, 2:].reshape(3, 2, 3, 2)):
        likely = poisson_log_likelihood(scale[i] * simulator.expected(drawn), counts[i])
        for parameter, starts in enumerate(later):
            ends = np.quantile(drawn[:, parameter], [1 / 3, 2 / 3])
            of = np.digitize(drawn[:, parameter], ends)
            for k in range(3):
                best = drawn[of == k][np.argmax(likely[of == k])]
                np.testing.assert_array_equal(starts[k], best)


class Either:
    """Two ways to be tilted: what is right is narrow, what is nearly right is broad, and has most draws."""

    prior = Prior({"norm": LogUniform(100.0, 1e4), "turn": Uniform(-1.0, 1.0)})
    channel = np.linspace(-1.0, 1.0, 40)

    def expected(self, theta):
        norm, turn = np.moveaxis(np.asarray(theta, dtype=float)[..., None], -2, 0)
        narrow, broad = (
            np.exp(-0.5 * ((turn - at) / width) ** 2) for at, width in ((-0.9, 0.03), (0.5, 0.3))
        )
        return norm * (2.0 + (1.0 * narrow + 0.8 * broad) * self.channel)


def test_the_narrower_of_two_valleys_is_found():
    truth = np.array([[3000.0, -0.9]])
    counts = np.random.default_rng(2).poisson(Either().expected(truth))
    best = fit(Either(), counts, start=truth).objective[0]
    lost = [fit(Either(), counts, bank=200, tries=3, seed=k).objective[0] - best for k in range(20)]
    found = [
        fit(Either(), counts, bank=200, tries=3, ranges=6, seed=k).objective[0] - best for k in range(20)
    ]
    assert sum(gap > 10.0 for gap in lost) >= 10
    assert sum(gap > 10.0 for gap in found) <= 4


class Bumped:
    """A power law over 200 channels and a narrow bump somewhere, which a climb finds only from near by."""

    prior = Prior(
        {
            "norm": LogUniform(10.0, 1e4),
            "slope": Uniform(0.0, 3.0),
            "place": Uniform(0.0, 200.0),
            "height": LogUniform(1.0, 1e4),
        }
    )
    channel = np.arange(200.0)

    def expected(self, theta):
        norm, slope, place, height = np.moveaxis(np.asarray(theta, dtype=float)[..., None], -2, 0)
        bump = np.exp(-0.5 * ((self.channel - place) / 1.5) ** 2)
        return norm * (1.0 + self.channel) ** (-0.3 * slope) + height * bump


class Placed(Bumped):
    """The same, which says so."""

    @property
    def places(self):
        return {"place": ("height",)}


@pytest.fixture(scope="module")
def bumps():
    """Truths and counts of forty sources, the bump of each worth some ten standard errors."""
    rng = np.random.default_rng(5)
    truth = Bumped.prior.sample(40, rng)
    truth[:, 0] = 300.0
    truth[:, 2] = rng.uniform(5.0, 195.0, 40)
    level = 300.0 * (1.0 + truth[:, 2]) ** (-0.3 * truth[:, 1])
    truth[:, 3] = 8.0 * np.sqrt(level) + 8.0
    return truth, rng.poisson(Bumped().expected(truth))


def test_what_is_narrow_is_found_wherever_it_is(bumps):
    """No fit ends far above one that begins at the truth; without a word of its place many do."""
    truth, counts = bumps
    best = fit(Bumped(), counts, start=truth).objective
    behind = fit(Placed(), counts, bank=4096, tries=8).objective - best
    assert behind.max() < 0.1
    lost = fit(Bumped(), counts, bank=4096, tries=8).objective - best
    assert 8 <= (lost > 10.0).sum() <= 30


class Twice(Placed):
    """With two bumps."""

    prior = Bumped.prior * Prior({"second": Uniform(0.0, 200.0), "size": LogUniform(1.0, 1e4)})

    def expected(self, theta):
        theta = np.asarray(theta, dtype=float)
        other = np.exp(-0.5 * ((self.channel - theta[..., 4, None]) / 1.5) ** 2)
        return super().expected(theta[..., :4]) + theta[..., 5, None] * other

    @property
    def places(self):
        return {"place": ("height",), "second": ("size",)}


class First(Twice):
    """Of which only the first says where it is."""

    @property
    def places(self):
        return {"place": ("height",)}


def test_of_two_places_both_are_tried(bumps):
    truth, _ = bumps
    both = np.concatenate([truth, (truth[:, 2:3] + 70.0) % 190.0 + 5.0, truth[:, 3:]], axis=1)
    counts = np.random.default_rng(6).poisson(Twice().expected(both))
    best = fit(Twice(), counts, start=both).objective
    assert (fit(Twice(), counts).objective - best).max() < 0.1


def test_of_every_source_the_better_fit_is_kept_whole(bumps):
    _, counts = bumps
    together = fit(Placed(), counts)
    some_gained = together.objective < fit(Bumped(), counts).objective - 1.0
    assert 0 < some_gained.sum() < len(counts)
    for i in (int(np.argmax(some_gained)), int(np.argmin(some_gained))):
        alone = fit(Placed(), counts[i : i + 1])
        for name in ("theta", "expected", "jacobian", "log_likelihood", "objective", "converged"):
            np.testing.assert_allclose(getattr(together, name)[i], getattr(alone, name)[0], rtol=1e-6)
    np.testing.assert_allclose(together.expected, Placed().expected(together.theta), rtol=1e-12)
    said = poisson_log_likelihood(together.expected, counts)
    np.testing.assert_allclose(together.log_likelihood, said, rtol=1e-9)


def test_what_a_poor_try_of_places_makes_worse_stays(bumps):
    _, counts = bumps
    plain, placed = (fit(kind(), counts, bank=64, tries=1).objective for kind in (Bumped, Placed))
    assert (placed <= plain + 1e-9).all()
    assert (placed < plain - 1.0).any()
    one, both = (fit(kind(), counts, bank=64, tries=1).objective for kind in (First, Twice))
    assert (both <= one + 1e-9).all()


def test_climbs_begin_anew_at_the_likeliest_places_that_lie_apart(bumps):
    """What goes with a place is of one draw, the rest the best fit's; a 64th of places has one start."""
    truth, _ = bumps
    exposure, asked = np.array([3.0, 0.2]), []

    class Heard(Placed):
        def expected(self, theta):
            asked.append(np.array(theta))
            return super().expected(theta)

    counts = np.random.default_rng(7).poisson(exposure[:, None] * Bumped().expected(truth[:2]))
    fit(Heard(), counts, scale=exposure, bank=1024, tries=8, seed=3)
    _, one, other = (k for k, theta in enumerate(asked) if len(theta) == 1024)
    begun = asked[other + 1].reshape(2, 8, 4)
    drawn = Bumped.prior.sample(1024, np.random.default_rng(3))
    first = fit(Bumped(), counts, scale=exposure, bank=1024, tries=8, seed=3).theta
    parts = np.array_split(np.argsort(drawn[:, 2]), 64)
    for source, (bank, starts) in enumerate(zip((asked[one], asked[other]), begun, strict=True)):
        np.testing.assert_array_equal(bank[:, 2:], drawn[:, 2:])
        np.testing.assert_array_equal(bank[:, :2], np.tile(first[source, :2], (1024, 1)))
        likely = poisson_log_likelihood(exposure[source] * Bumped().expected(bank), counts[source])
        best = sorted((part[np.argmax(likely[part])] for part in parts), key=lambda k: -likely[k])[:8]
        np.testing.assert_allclose(starts, bank[best], rtol=1e-9)


def test_places_are_tried_of_few_sources_without_a_start_alone(bumps):
    truth, counts = bumps
    begun = truth.copy()
    begun[:, 2] = (truth[:, 2] + 100.0) % 200.0
    plain, placed = (fit(kind(), counts, start=begun) for kind in (Bumped, Placed))
    np.testing.assert_array_equal(plain.theta, placed.theta)
    many = np.concatenate([counts, counts])
    plain, placed = (fit(kind(), many) for kind in (Bumped, Placed))
    np.testing.assert_array_equal(plain.theta, placed.theta)
