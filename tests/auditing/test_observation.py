"""Trials around an observation: truths of its posterior, and weights that are its likelihood."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy import stats

from gaugeblock.auditing.audit import audit, audit_configured
from gaugeblock.auditing.config import read_config
from gaugeblock.auditing.observation import OWN_TRUTHS, read_observation, trials_around
from gaugeblock.core.errors import InputError
from gaugeblock.estimators import build_estimator
from gaugeblock.simulators import Prior, Uniform, build_simulator
from gaugeblock.validate import Outcome, judge, make_policy, read_trials, trials_tree, write_trials
from gaugeblock.validate.local.posterior_sbc import pool_weights, posterior_sbc
from gaugeblock.validate.prepared import Prepared
from gaugeblock.validate.trials import group_trials

SIMULATOR = build_simulator("linear_gaussian", parameters=2, data=3)
# The same likelihood under another prior: whoever is exact for it is wrong here, and agrees with itself.
OTHER = build_simulator("linear_gaussian", parameters=2, data=3, prior_sd=0.3)
OBSERVED = np.array([1.5, 0.5, 1.0])
POLICY = make_policy({"required": ["posterior_sbc.bias", "posterior_sbc.log_width"]}, source="test")


class NoDensity:
    def __init__(self, base):
        self.sample = base.sample


class NarrowNearby:
    """Exact, but for data within 2.5 of the observation: there 0.6 times as wide as it should be."""

    def _width(self, x):
        near = np.linalg.norm(np.asarray(x) - OBSERVED, axis=1) < 2.5
        return np.where(near, 0.6, 1.0)[:, None, None]

    def _center(self, x):
        return SIMULATOR.posterior_sample(x, 1, Zero())

    def sample(self, x, n, rng):
        center = self._center(x)
        return center + self._width(x) * (SIMULATOR.posterior_sample(x, n, rng) - center)

    def log_prob(self, theta, x):
        center, width = self._center(x), self._width(x)
        inner = center + (theta - center) / width
        return SIMULATOR.posterior_log_prob(inner, x) - 2 * np.log(width[..., 0])


class Zero:
    def standard_normal(self, size):
        return np.zeros(size)


def exact(simulator=SIMULATOR):
    return build_estimator("exact", simulator)


def found(trials, seed=1):
    main = trials.drop_vars(["weight", "weight_true"])
    return {item.id: item for item in posterior_sbc(Prepared(trials_tree(main, posterior=trials), seed))}


def p_values(findings, what="uniform"):
    return [finding.p_value for name, finding in findings.items() if name.startswith(f"posterior_sbc.{what}")]


def test_truths_are_draws_of_the_posterior_and_weights_its_likelihood():
    """Kolmogorov-Smirnov against the exact marginals at p = 1e-4, for an estimator that is too narrow."""
    trials = trials_around(SIMULATOR, NarrowNearby(), OBSERVED, number=1000, draws=20, seed=1, proposals=500)
    reference = SIMULATOR.posterior_sample(OBSERVED[None], 100_000, np.random.default_rng(2))[0]
    for column in range(2):
        truth = trials["theta_true"].values[:, column]
        assert (
            stats.kstest(truth, "norm", (reference[:, column].mean(), reference[:, column].std())).pvalue
            > 1e-4
        )
    log_likelihood, true = (
        SIMULATOR.log_likelihood(theta, OBSERVED)
        for theta in (trials["draws"].values, trials["theta_true"].values)
    )
    expected = pool_weights(log_likelihood, true)
    pool = np.column_stack([trials["weight_true"], trials["weight"]])
    np.testing.assert_allclose(pool / pool.sum(axis=1, keepdims=True), expected, rtol=1e-9, atol=1e-300)
    assert "caveat" not in trials.attrs


def test_an_exact_estimator_passes():
    """p > 1e-4 for two parameters, and no gate FAILs; PASS where the tolerance is 6 errors away."""
    findings = found(trials_around(SIMULATOR, exact(), OBSERVED, number=4000, draws=50, seed=3))
    assert min(p_values(findings)) > 1e-4
    assert judge(list(findings.values()), [], POLICY, seed=1).outcome is Outcome.PASS


def test_an_estimator_that_is_wrong_near_the_observation_is_blocked():
    trials = trials_around(SIMULATOR, NarrowNearby(), OBSERVED, number=1000, draws=200, seed=4)
    findings = found(trials)
    assert judge(list(findings.values()), [], POLICY, seed=1).outcome is Outcome.FAIL


def test_another_prior_shows_where_there_is_a_density_and_hides_where_there_is_none():
    """The blind spot of truths that the estimator chose itself: p > 1e-4, where weighted truths give 1e-9."""
    told = found(trials_around(SIMULATOR, exact(OTHER), OBSERVED, number=1000, draws=100, seed=5))
    assert max(p_values(told)) < 1e-9
    blind = trials_around(SIMULATOR, NoDensity(exact(OTHER)), OBSERVED, number=1000, draws=100, seed=5)
    findings = found(blind)
    assert min(p_values(findings)) > 1e-4
    assert OWN_TRUTHS in findings["posterior_sbc.bias[theta_1]"].caveats


def test_bits_depend_on_the_seed_and_the_block_alone_and_survive_the_disk(tmp_path):
    first = trials_around(SIMULATOR, exact(), OBSERVED, number=30, draws=20, seed=6)
    other = trials_around(SIMULATOR, exact(), OBSERVED, number=30, draws=20, seed=7)
    again = trials_around(SIMULATOR, exact(), OBSERVED, number=30, draws=20, seed=6)
    for name in ("theta_true", "draws", "x", "weight", "weight_true"):
        np.testing.assert_array_equal(first[name], again[name])
        assert not np.array_equal(first[name], other[name])
    for block in (1, 7, 30):
        short, longer = (
            trials_around(SIMULATOR, exact(), OBSERVED, number=number, draws=20, seed=6, block=block)
            for number in (12, 30)
        )
        for name in ("theta_true", "draws", "x", "weight", "weight_true"):
            np.testing.assert_array_equal(short[name], longer[name][:12])
            # No trial is there twice; impossible weights are all 0 or 1.
            assert name.startswith("weight") or len(np.unique(longer[name], axis=0)) == 30
    main = first.drop_vars(["weight", "weight_true"])
    tree = read_trials(write_trials(trials_tree(main, posterior=first), tmp_path / "trials.nc"))
    stored = Prepared(tree, 1).group("posterior")
    np.testing.assert_array_equal(stored["weight_true"], first["weight_true"])
    np.testing.assert_array_equal(stored["weight"], first["weight"])


def test_draws_that_are_not_finite_or_outside_the_prior_weigh_nothing():
    simulator = build_simulator("gaussian_mixture")

    class Wild:
        def sample(self, x, n, rng):
            draws = simulator.prior.center + 0.1 * rng.standard_normal((len(x), n, simulator.prior.size))
            draws[:, 3] = 1e9
            draws[:, 4, 0] = np.nan
            return draws

        def log_prob(self, theta, x):
            return np.zeros(theta.shape[:-1])

    center = simulator.prior.center[None]
    observed = simulator.simulate(center, np.random.default_rng(8))[0]
    trials = trials_around(simulator, Wild(), observed, number=20, draws=10, seed=9)
    assert np.isfinite(trials["theta_true"]).all()
    assert simulator.prior.contains(trials["theta_true"].values).all()
    assert (trials["weight"].values[:, 3:5] == 0).all()
    assert (trials["weight"].values[:, :3].max(axis=1) > 0).all()


class NoLikelihood:
    prior = SIMULATOR.prior
    simulate = SIMULATOR.simulate


class Elsewhere:
    def sample(self, x, n, rng):
        return np.full((len(x), n, 1), 9.0)

    def log_prob(self, theta, x):
        return np.zeros(theta.shape[:-1])


@pytest.mark.parametrize(
    ("arguments", "options", "words"),
    [
        ((NoLikelihood(), exact(), OBSERVED), {}, "NoLikelihood has no log_likelihood"),
        ((SIMULATOR, exact(), OBSERVED[:2]), {}, r"has shape \(2,\); it must .* data, \(3,\)"),
        ((SIMULATOR, exact(), OBSERVED * np.nan), {}, "must be finite"),
        ((SIMULATOR, exact(), OBSERVED), {"draws": 1}, "draws >= 2"),
        ((SIMULATOR, Elsewhere(), OBSERVED), {}, "the estimator gave"),
    ],
)
def test_misuse_is_one_clear_line(arguments, options, words):
    with pytest.raises(InputError, match=words) as caught:
        trials_around(*arguments, number=5, seed=1, **{"draws": 10, **options})
    assert "\n" not in str(caught.value)


def test_an_observation_that_the_estimator_cannot_explain():
    class Simulator1:
        prior = Prior({"a": Uniform(0, 1)})

        def simulate(self, theta, rng):
            return np.asarray(theta) + rng.standard_normal(np.shape(theta))

        def log_likelihood(self, theta, x):
            return -0.5 * np.sum((x - theta) ** 2, axis=-1)

    with pytest.raises(InputError, match="no draw of the estimator at the observation is possible"):
        trials_around(Simulator1(), Elsewhere(), np.array([0.3]), number=5, draws=10, seed=1)


TOML = """
[simulator]
name = "linear_gaussian"
parameters = 2
data = 3
[estimator]
name = "exact"
[trials]
number = 40
draws = 20
importance_number = 0
joint_number = 0
observation = "{file}"
"""


@pytest.mark.parametrize("suffix", [".npy", ".nc"])
def test_an_audit_looks_around_the_observation_it_is_given(tmp_path, suffix):
    file = tmp_path / f"mine{suffix}"
    if suffix == ".npy":
        np.save(file, [0.5, 0.1, -0.2])
    else:
        xr.Dataset({"x": ("channel", [0.5, 0.1, -0.2])}).to_netcdf(file)
    (tmp_path / "audit.toml").write_text(TOML.format(file=file.name))
    made = audit_configured(read_config(tmp_path / "audit.toml"), tmp_path / "out")
    assert "posterior_sbc.bias[theta_1]" in {finding.id for finding in made.findings}
    assert group_trials(read_trials(tmp_path / "out" / "trials.nc"), "posterior") is not None
    assert made.verdict.provenance["observation"]["file_sha256"]


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("none.npy", None, "cannot be read"),
        ("bad.npy", b"no array", "cannot be read as a NumPy array"),
        ("bad.csv", b"1, 2", "what is read is NetCDF, and .npy; save it with numpy.save$"),
        ("bad.nc", b"no file", "cannot be read as NetCDF"),
    ],
)
def test_an_observation_that_cannot_be_read(tmp_path, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        read_observation(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_an_observation_file_without_x(tmp_path):
    xr.Dataset({"y": ("channel", [1.0])}).to_netcdf(tmp_path / "other.nc")
    with pytest.raises(InputError, match="no array 'x'"):
        read_observation(tmp_path / "other.nc")


def test_an_estimator_that_fails_at_the_observation_is_the_one_that_is_named():
    class Lost:
        def sample(self, x, n, rng):
            return np.full((len(x), n, 2), np.nan)

    with pytest.raises(InputError, match="estimator gave NaN or infinite draws at the observation"):
        trials_around(SIMULATOR, Lost(), OBSERVED, number=10, draws=20, seed=1)


class Refusing:
    """Draws that nobody may ask for."""

    def sample(self, x, n, rng):
        raise AssertionError("asked")


class WithoutLikelihood:
    prior = SIMULATOR.prior

    def simulate(self, theta, rng):
        return SIMULATOR.simulate(theta, rng)


@pytest.mark.parametrize(
    ("simulator", "data", "words"),
    [
        (WithoutLikelihood(), OBSERVED, "posterior SBC needs a likelihood; WithoutLikelihood has no"),
        (SIMULATOR, OBSERVED[:2], r"observation: has shape \(2,\); it must be finite and of the shape"),
        (SIMULATOR, np.array([1.0, np.inf, 0.0]), "observation: has shape"),
    ],
)
def test_an_observation_that_cannot_be_judged_is_refused_before_anything_is_drawn(
    simulator, data, words, tmp_path
):
    np.save(tmp_path / "x.npy", data)
    with pytest.raises(InputError, match=words):
        audit(Refusing(), simulator, observation=tmp_path / "x.npy", trials=50, draws=10, seed=1)
