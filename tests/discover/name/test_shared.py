"""Shared effects over a catalogue: exact projections, priors, influence, the search and its null."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.discovery import blocks
from gaugeblock.discovery.blocks import blocks_of
from gaugeblock.discovery.engine import beyond
from gaugeblock.discovery.fitting import fit, select
from gaugeblock.discovery.library import Candidates
from gaugeblock.discovery.name.catalogue import Members, search_shared
from gaugeblock.discovery.name.score import allowed
from gaugeblock.discovery.name.shared import Term, share
from gaugeblock.discovery.name.shared_score import SharedScores, join, shared_scores
from gaugeblock.discovery.name.stacked import influence, stack, without
from gaugeblock.discovery.sources import Sources
from gaugeblock.simulators import Effect, Prior, Uniform


def population(power_law, n, seed, *, depth=0.0, energy=2.0):
    rng = np.random.default_rng(seed)
    simulator = power_law()
    theta = np.column_stack([rng.uniform(200, 2000, n), rng.uniform(1.0, 2.5, n)])
    truth = simulator.with_effect(Effect("dip", {"energy": energy, "depth": depth}))
    return Sources.of(simulator, truth.simulate(theta, rng)), theta


@pytest.fixture
def made(power_law):
    """Eight sources, their fits, two templates and two nuisances."""
    sources, _ = population(power_law, 8, 1)
    fitted = fit(sources.simulator, sources.counts)
    entry = sources.simulator.effect_library(fitted.theta)["dip"]
    shared = share(sources.simulator, [Term(entry, {"energy": e}) for e in (1.0, 2.0, 3.0, 4.0)])
    values = shared.templates(fitted.theta, shared.neutral, sources.scale, sources.redshift)
    return sources, fitted, values


def test_the_information_is_that_of_one_large_fit(made):
    sources, fitted, values = made
    sd = np.array([0.02, np.inf])
    found = stack(shared_scores(sources.counts, fitted, values[:, :1], values[:, 1:3]), sd)
    n, p = fitted.theta.shape
    size = n * p + 3
    information, gradient = np.zeros((size, size)), np.zeros(size)
    for i in range(n):
        columns = np.zeros((fitted.expected.shape[1], size))
        columns[:, i * p : (i + 1) * p] = fitted.jacobian[i]
        columns[:, n * p :] = values[i, :3].T
        information += columns.T @ (columns / fitted.expected[i][:, None])
        gradient += columns.T @ (sources.counts[i] / fitted.expected[i] - 1.0)
    information[-2, -2] += 1 / sd[0] ** 2
    covariance = np.linalg.inv(information)
    # Fits are at their optimum up to their tolerance, so a whole step agrees with the projected one.
    assert found.standard_error[0] == pytest.approx(np.sqrt(covariance[-3, -3]), rel=1e-6)
    assert found.amplitude[0] == pytest.approx(
        (covariance @ gradient)[-3], abs=0.02 * found.standard_error[0]
    )


def test_influence_is_what_the_others_say(made):
    sources, fitted, values = made
    scores = shared_scores(sources.counts, fitted, values[:, :1], values[:, 1:3])
    sd = np.array([0.02, np.inf])
    others = stack(scores.select(np.arange(8) != 3), sd)
    assert without(scores, sd)[3, 0] == pytest.approx(others.z[0], abs=1e-9)
    assert influence(scores, sd)[3, 0] == pytest.approx(stack(scores, sd).z[0] - others.z[0], abs=1e-9)


@pytest.mark.parametrize("sd", [(), (0.3, np.inf), (0.2, 0.4)])
def test_a_stack_source_by_source(sd):
    """Scores where amplitude and nuisances fit best, their scatter, and what is left without a source."""
    rng, number, beside = np.random.default_rng(9), 7, len(sd)
    every = rng.normal(size=(number, 2 + beside, 30)) * rng.uniform(0.5, 2.0, (number, 1, 1))
    gram = np.einsum("nic,njc->nij", every, every)
    noise = np.einsum("nic,nc->ni", every, rng.normal(0.2, 1.0, (number, 30)))
    total = np.einsum("ntt->nt", gram[:, :2, :2]) * rng.uniform(1.0, 2.0, (number, 2))
    own = np.einsum("ntt->nt", gram[:, :2, :2])
    scores = SharedScores(noise[:, :2], own, total, noise[:, 2:], gram[:, :2, 2:], gram[:, 2:, 2:])
    found, alone = stack(scores, sd), without(scores, sd)
    prior = np.diag(1.0 / np.array(sd) ** 2).reshape(beside, beside)

    def fitted(kept, t):
        """Amplitude, its information and the nuisances in the normal equations of some sources."""
        cross, matrix = gram[kept, t, 2:].sum(axis=0), gram[kept, 2:, 2:].sum(axis=0) + prior
        whole = np.block([[own[kept, t].sum(), cross[None]], [cross[:, None], matrix]])
        both = np.linalg.solve(whole, np.append(noise[kept, t].sum(), noise[kept, 2:].sum(axis=0)))
        return both[0], 1.0 / np.linalg.inv(whole)[0, 0], both[1:], np.linalg.solve(matrix, cross)

    for t in range(2):
        amplitude, information, nuisances, weight = fitted(np.arange(number), t)
        scatter = 0.0
        for i in range(number):
            score = noise[i, t] - own[i, t] * amplitude - gram[i, t, 2:] @ nuisances
            others = noise[i, 2:] - gram[i, 2:, t] * amplitude - gram[i, 2:, 2:] @ nuisances
            scatter += (score - weight @ others) ** 2
            left, known, *_ = fitted(np.arange(number) != i, t)
            assert alone[i, t] == pytest.approx(left * np.sqrt(known))
        assert found.amplitude[t] == pytest.approx(amplitude)
        assert found.information[t] == pytest.approx(information)
        assert found.z[t] == pytest.approx(amplitude * np.sqrt(information))
        assert found.smallest_detectable[t] == pytest.approx(5.0 / np.sqrt(information))
        assert found.sandwich_error[t] == pytest.approx(np.sqrt(scatter * 7 / 6) / information)
        assert found.kept[t] == pytest.approx(information / total[:, t].sum())
        assert found.effective_sources[t] == pytest.approx(own[:, t].sum() ** 2 / (own[:, t] ** 2).sum())
    np.testing.assert_allclose(influence(scores, sd), found.z - alone)


def test_more_freedom_never_adds_information(made):
    sources, fitted, values = made
    alone = stack(shared_scores(sources.counts, fitted, values[:, :1]))
    held = stack(shared_scores(sources.counts, fitted, values[:, :1], values[:, 1:3]), [1e-9, 1e-9])
    loose = stack(shared_scores(sources.counts, fitted, values[:, :1], values[:, 1:3]), [0.02, 0.02])
    free = stack(shared_scores(sources.counts, fitted, values[:, :1], values[:, 1:3]), [np.inf, np.inf])
    assert held.information == pytest.approx(alone.information, rel=1e-6)
    assert alone.information > loose.information > free.information > 0
    assert 0 < free.kept[0] < loose.kept[0] < alone.kept[0] < 1
    assert 1 < alone.effective_sources[0] <= 8


def test_a_template_inside_the_nuisances_knows_nothing(made):
    sources, fitted, values = made
    found = stack(shared_scores(sources.counts, fitted, values[:, :1], values[:, :1]), [np.inf])
    assert found.z[0] == 0
    assert np.isinf(found.standard_error[0])


def test_a_template_that_no_source_sees_is_of_no_source(made):
    sources, fitted, values = made
    unseen = np.concatenate([values[:, :1], np.zeros_like(values[:, :1])], axis=1)
    found = stack(shared_scores(sources.counts, fitted, unseen))
    assert (found.z[1], found.amplitude[1], found.kept[1], found.effective_sources[1]) == (0, 0, 0, 0)
    assert found.standard_error[1] == found.smallest_detectable[1] == np.inf


def test_z_is_standard_normal_with_nuisances_drawn_from_their_priors(made):
    _, fitted, values = made
    rng = np.random.default_rng(2)
    sd = np.array([0.02, 0.02])
    z = []
    for _ in range(600):
        drawn = np.einsum("nkc,k->nc", values[:, 1:3], rng.normal(0, sd))
        counts = rng.poisson(np.maximum(fitted.expected + drawn, 0))
        z.append(stack(shared_scores(counts, fitted, values[:, :1], values[:, 1:3]), sd).z[0])
    # Limits of 1e-4 either side: 3.9 standard errors of a mean and of a standard deviation.
    assert abs(np.mean(z)) < 3.9 / np.sqrt(600)
    assert np.std(z) == pytest.approx(1, abs=3.9 / np.sqrt(1200))


def test_the_sandwich_sees_scatter_between_sources(made):
    _, fitted, values = made
    rng = np.random.default_rng(3)
    many = [
        shared_scores(
            rng.poisson(np.maximum(fitted.expected + spread * rng.normal(size=(8, 1)) * values[:, 0], 0)),
            fitted,
            values[:, :1],
        )
        for spread in (0.0, 0.2)
        for _ in range(25)
    ]
    calm, wild = stack(join(many[:25])), stack(join(many[25:]))
    assert calm.sandwich_error[0] == pytest.approx(calm.standard_error[0], rel=0.25)
    assert wild.sandwich_error[0] > 1.5 * wild.standard_error[0]


def group(power_law, seed, **hidden):
    sources, _ = population(power_law, 60, seed, **hidden)
    fitted = fit(sources.simulator, sources.counts)
    return Members(sources, fitted, Candidates.of(sources.simulator, fitted.theta, only=("dip", "edge")))


def test_a_hidden_dip_is_found_where_it_is(power_law):
    found = search_shared([group(power_law, 4, depth=-0.08)], replicates=199, rng=np.random.default_rng(0))
    best = np.argmax(np.abs(found.stack.z))
    assert found.owner[best] == "dip"
    assert beyond(found.null, np.abs(found.stack.z[best])) == 1 / 200
    library = power_law().effect_library(np.array([[1000.0, 2.0]]))
    assert library["dip"].nodes[found.node[best], 0] == pytest.approx(2.0, rel=0.1)
    assert found.stack.amplitude[best] == pytest.approx(-0.08, abs=4 * found.stack.standard_error[best])


def test_effect_free_catalogues_are_quiet(power_law):
    # Twelve searches: more than four below 0.1 in fewer than one of two hundred.
    p = [
        beyond(found.null, allowed(found.stack.z, found.sign).max())
        for k in range(12)
        for found in [search_shared([group(power_law, 20 + k)], replicates=99, rng=np.random.default_rng(k))]
    ]
    assert np.sum(np.array(p) <= 0.1) <= 4
    assert max(p) > 0.3


@pytest.mark.parametrize("sd", [0.02, np.inf])
def test_the_null_beside_a_nuisance_is_that_of_normals_as_alike_as_the_templates(power_law, sd):
    """A dip of free depth beside edges: 3% of the largest is five errors of a quantile."""
    sources, _ = population(power_law, 60, 6)
    fitted = fit(sources.simulator, sources.counts)
    edges = Candidates.of(sources.simulator, fitted.theta, only=("edge",))
    dip = sources.simulator.effect_library(fitted.theta)["dip"]
    found = search_shared(
        [Members(sources, fitted, edges)],
        [Term(dip, {"energy": 2.0}, sd=sd)],
        replicates=4000,
        rng=np.random.default_rng(1),
    )
    cross = found.scores.cross.sum(axis=0)
    own = found.scores.nuisance_information.sum(axis=0) + 1 / sd**2
    known = found.gram - cross @ np.linalg.solve(own, cross.T)
    size = np.sqrt(np.diag(known))
    # The dip takes a good part of what some edges would be known by, so it matters how it is taken off.
    assert np.min(np.diag(known) / np.diag(found.gram)) < 0.8
    z = np.random.default_rng(2).multivariate_normal(np.zeros(len(size)), known / np.outer(size, size), 4000)
    expected = allowed(z, found.sign).max(axis=1)
    for level in (0.5, 0.9):
        assert np.quantile(found.null, level) == pytest.approx(np.quantile(expected, level), rel=0.03)


def test_a_search_does_not_depend_on_blocks_or_on_the_order_of_terms(power_law, monkeypatch):
    one = group(power_law, 5)
    entry = one.candidates.entries["edge"]
    terms = [Term(entry, {"energy": 3.0}, sd=0.05)]
    whole = search_shared([one], terms, replicates=50, rng=np.random.default_rng(0))
    monkeypatch.setattr(blocks, "BLOCK", 7)
    cut = [
        Members(some, select(one.fit, rows), one.candidates)
        for some, rows in zip(blocks_of([one.sources]), np.array_split(np.arange(60), 9), strict=True)
    ]
    parts = search_shared(cut, terms, replicates=50, rng=np.random.default_rng(0))
    np.testing.assert_allclose(parts.stack.z, whole.stack.z, atol=1e-9)
    np.testing.assert_allclose(parts.null, whole.null, atol=1e-9)
    # An effect is not tested beside itself.
    alone = search_shared([one], replicates=50, rng=np.random.default_rng(0))
    edge = whole.owner == "edge"
    np.testing.assert_allclose(whole.stack.z[edge], alone.stack.z[edge], atol=1e-12)
    assert np.abs(whole.stack.z[~edge] - alone.stack.z[~edge]).max() > 1e-3


def test_the_unit_of_an_amplitude_decides_nothing(power_law):
    """Lines in counts and in billionths of a count, beside a dip."""

    class Small(power_law):
        def with_effect(self, effect):
            made = super().with_effect(effect)
            return Small(made.effects, made.prior)

        def expected(self, theta):
            free = [name for effect in self.effects for name in effect.free]
            unit = [1.0, 1.0, *(1e-9 if name == "counts" else 1.0 for name in free)]
            return super().expected(np.asarray(theta) * unit)

        def effect_library(self, theta):
            made = super().effect_library(theta)
            line = made["line"]
            most = Uniform(0.0, 1e9 * line.support[1])
            line = replace(line, step=1e9 * line.step, parameters={**line.parameters, "counts": most})
            return {**made, "line": line}

    sources, _ = population(power_law, 20, 7)
    found = []
    for simulator in (power_law(), Small()):
        own = Sources.of(simulator, sources.counts)
        fitted = fit(simulator, own.counts)
        lines = Candidates.of(simulator, fitted.theta, only=("line",))
        dip = Term(simulator.effect_library(fitted.theta)["dip"], {"energy": 2.0}, sd=0.05)
        found.append(
            search_shared([Members(own, fitted, lines)], [dip], replicates=50, rng=np.random.default_rng(1))
        )
    plain, small = found
    assert (plain.null > 0.1).sum() > 45
    np.testing.assert_allclose(small.null, plain.null, rtol=1e-6)
    np.testing.assert_allclose(small.stack.z, plain.stack.z, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(small.stack.kept, plain.stack.kept, rtol=1e-6)
    np.testing.assert_allclose(small.stack.standard_error, 1e9 * plain.stack.standard_error, rtol=1e-6)


@pytest.mark.parametrize("known", [False, True])
def test_what_sources_share_is_worked_in_where_each_of_them_sees_it(power_law, known):
    """A line of one energy at rest and a dip of the instrument: counts, templates and derivatives by hand."""

    class WithJacobian(power_law):
        def with_effect(self, effect):
            made = super().with_effect(effect)
            return WithJacobian(made.effects, made.prior)

        def jacobian(self, theta):
            columns = []
            for k, width in enumerate(1e-6 * np.maximum(np.abs(theta).max(axis=0), 1e-3)):
                move = width * np.eye(theta.shape[1])[k]
                columns.append((self.expected(theta + move) - self.expected(theta - move)) / (2 * width))
            return np.stack(columns, axis=-1)

    plain = WithJacobian() if known else power_law()
    library = plain.effect_library(np.array([[1000.0, 2.0]]))
    terms = [Term(library["line"], {"energy": 4.0}), Term(library["dip"], {"energy": 2.0}, sd=0.3)]
    shared, phi = share(plain, terms), np.array([150.0, 0.2])
    theta = np.array([[500.0, 1.5], [900.0, 2.0], [700.0, 1.0]])
    scale, redshift = np.array([1.0, 2.0, 0.5]), np.array([0.0, 0.5, 1.0])
    edges = np.geomspace(0.5, 8.0, 61)
    at, width = np.sqrt(edges[1:] * edges[:-1]), np.diff(edges)
    assert (shared.neutral.tolist(), shared.sd.tolist()) == ([0.0, 0.0], [np.inf, 0.3])
    assert shared.parameters == 2
    mean, made, slopes = [], [], []
    for (norm, index), times, z in zip(theta, scale, redshift, strict=True):
        law = norm * at**-index * width
        bell, dip = np.exp(-0.5 * ((at - 4.0 / (1 + z)) / 0.15) ** 2), np.exp(-0.5 * ((at - 2.0) / 0.4) ** 2)
        mean.append(times * (law + 150.0 * bell * width) * (1 + 0.2 * dip))
        made.append([times * bell * width * (1 + 0.2 * dip), times * (law + 150.0 * bell * width) * dip])
        slopes.append(times * np.stack([law / norm, -np.log(at) * law], axis=-1) * (1 + 0.2 * dip)[:, None])
    place = (phi, scale, redshift)
    np.testing.assert_allclose(shared.expected(theta, *place), mean, rtol=1e-9)
    np.testing.assert_allclose(shared.templates(theta, *place), made, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(shared.jacobian(theta, *place), slopes, rtol=1e-5, atol=1e-5)
    # With the instrument's alone a source's own parameters are all that is left.
    dips = share(plain, terms[1:])
    held = dips.held(np.array([0.2]))
    assert held is dips.held(np.array([0.2]))
    assert held.prior is plain.prior
    law = theta[:, :1] * at ** -theta[:, 1:] * width
    dip = np.exp(-0.5 * ((at - 2.0) / 0.4) ** 2)
    np.testing.assert_allclose(held.expected(theta), law * (1 + 0.2 * dip))
    np.testing.assert_allclose(dips.held(np.array([-0.1])).expected(theta), law * (1 - 0.1 * dip))
    assert hasattr(held, "jacobian") == known
    if known:
        own = np.stack([law / theta[:, :1], -np.log(at) * law], axis=-1) * (1 + 0.2 * dip)[:, None]
        np.testing.assert_allclose(held.jacobian(theta), own, rtol=1e-5, atol=1e-5)
    # Three shared parameters beside a source's two: differences are cheaper.
    many = share(plain, [terms[1]] * 3)
    assert not hasattr(many.held(np.zeros(3)), "jacobian")
    none = share(plain, [])
    assert none.held(np.zeros(0)) is plain
    assert none.templates(theta, np.zeros(0), scale, redshift).shape == (3, 0, 0)


def test_a_simulator_that_holds_parameters_itself_is_asked_to(power_law):
    """For an effect that is the same for all sources, whatever their redshifts; the rest is as without."""
    asked = []

    class Holds(power_law):
        def with_effect(self, effect):
            made = super().with_effect(effect)
            return Holds(made.effects, made.prior)

        def held(self, values):
            asked.append(list(values))
            tail = np.asarray(values)[None]

            def expected(theta):
                return self.expected(np.concatenate([theta, tail.repeat(len(theta), axis=0)], axis=1))

            return SimpleNamespace(expected=expected, jacobian=None)

    theta, phi = np.array([[500.0, 1.5], [900.0, 2.0]]), np.array([0.2])
    place = (phi, np.array([1.0, 2.0]), np.array([0.0, 1.0]))
    entry = power_law().effect_library(np.array([[1000.0, 2.0]]))["dip"]
    by, without = (share(each(), [Term(entry, {"energy": 2.0}, sd=0.3)]) for each in (Holds, power_law))
    np.testing.assert_array_equal(by.expected(theta, *place), without.expected(theta, *place))
    held = by.held(phi)
    assert held is by.held(phi)
    assert held.prior is by.base.prior
    np.testing.assert_array_equal(held.expected(theta), without.held(phi).expected(theta))
    # Once for the counts above, and once for all that is held.
    assert asked == [[0.2], [0.2]]


def test_terms_are_checked(power_law):
    entry = power_law().effect_library(np.array([[1000.0, 2.0]]))["dip"]
    with pytest.raises(InputError, match="shared dip: give a positive sd and values of energy"):
        Term(entry)
    with pytest.raises(InputError, match="positive sd"):
        Term(entry, {"energy": 2.0}, sd=-1.0)
    with pytest.raises(InputError, match="a catalogue needs sources"):
        search_shared([], rng=np.random.default_rng(0))
    with pytest.raises(InputError, match="at least one source"):
        join([])


def test_the_null_of_a_model_without_a_norm_is_centred(power_law):
    """What the fit takes off hides nothing there: a score that counts more than the excess shows."""

    class Slope(power_law):
        def __init__(self, effects=(), prior=None):
            super().__init__(effects, prior or Prior({"index": Uniform(-1.0, 4.0)}))

        def expected(self, theta):
            values = np.asarray(theta, dtype=float)
            norm = np.full((*values.shape[:-1], 1), 500.0)
            return super().expected(np.concatenate([norm, values], axis=-1))

        def with_effect(self, effect):
            made = super().with_effect(effect)
            return Slope(made.effects, made.prior)

    simulator, rng = Slope(), np.random.default_rng(8)
    sources = Sources.of(simulator, simulator.simulate(rng.uniform(1.0, 2.5, (30, 1)), rng))
    fitted = fit(simulator, sources.counts)
    edges = Candidates.of(simulator, fitted.theta, only=("edge",))
    found = search_shared([Members(sources, fitted, edges)], replicates=2000, rng=np.random.default_rng(1))
    size = np.sqrt(np.diag(found.gram))
    z = rng.multivariate_normal(np.zeros(len(size)), found.gram / np.outer(size, size), 4000)
    expected = allowed(z, found.sign).max(axis=1)
    for level in (0.5, 0.9):
        assert np.quantile(found.null, level) == pytest.approx(np.quantile(expected, level), abs=0.12)
