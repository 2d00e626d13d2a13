"""Default priors: every component has some, norms follow the counts, what is given stays."""

import numpy as np
import pytest
from scipy.sparse import csr_array

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import LogUniform, Prior, Uniform

pytest.importorskip("jaxspec")
from gaugeblock.simulators.xray import (
    Response,
    XraySpectrum,
    default_prior,
    joint_spectra,
    reference,
    with_background,
)
from gaugeblock.simulators.xray.build import settled
from gaugeblock.simulators.xray.components import COMPONENTS
from gaugeblock.simulators.xray.default_priors import SHAPES
from gaugeblock.simulators.xray.expression import parameter_names, parse
from gaugeblock.simulators.xray.observation import model_prior

pytestmark = pytest.mark.usefixtures("xray_data")


@pytest.fixture(scope="module")
def simulator():
    return reference()


def test_every_component_has_priors_for_all_but_the_norm_of_what_emits():
    for entry in COMPONENTS.values():
        expected = set(entry.parameters) - ({"norm"} if entry.additive else {"lg10Flux"})
        assert set(SHAPES[entry.component]) == expected
    assert set(SHAPES) == {entry.component for entry in COMPONENTS.values()}


ONE_EACH = sorted({entry.component: name for name, entry in COMPONENTS.items()}.values())
EMISSION = [name for name in ONE_EACH if COMPONENTS[name].additive]
FACTORS = [name for name in ONE_EACH if not COMPONENTS[name].additive and name != "cflux"]


# A few in one model: each takes seconds to compile, and evaluating all of one for each takes longer still.
TOGETHER = [
    *(EMISSION[k::2] for k in range(2)),
    *(FACTORS[k::5] for k in range(5)),
    ["cflux"],
]


@pytest.mark.parametrize("names", TOGETHER, ids=" ".join)
def test_draws_of_every_component_are_finite_and_some_have_the_counts(names):
    """One after the other, with no norm but its own."""
    if COMPONENTS[names[0]].additive:
        model, norms = "+".join(names), [f"{COMPONENTS[name].component.lower()}_1.norm" for name in names]
    else:
        model = "+".join(f"{name}*powerlaw" for name in names)
        norms = [f"powerlaw_{k}.norm" for k in range(1, len(names) + 1)]
    if names == ["cflux"]:
        norms = ["cflux_1.lg10Flux"]
    edges = np.geomspace(0.5, 8.0, 103)
    bins, counts = np.stack([edges[:-1], edges[1:]], axis=1), np.full(102, 10)
    eye = csr_array(np.eye(102))
    response = Response("ideal", bins, bins, bins, np.full(102, 500.0), eye, eye, 353.0)
    prior = default_prior(model, response, counts)
    assert prior.names == parameter_names(parse(model))
    made = XraySpectrum(model, response, prior)
    theta = prior.sample(512, np.random.default_rng(0))
    every = [prior.names.index(norm) for norm in norms]
    for name, norm in zip(names, norms, strict=True):
        alone, own = theta.copy(), prior.names.index(norm)
        alone[:, every] = 0.0
        alone[:, own] = theta[:, own]
        totals = made.expected(alone).sum(axis=1)
        assert np.isfinite(totals).mean() > 0.99, name
        assert (totals > counts.sum()).mean() > 0.03, name
        assert (totals < counts.sum()).mean() > 0.3, name


def test_a_flux_is_scaled_by_the_counts_like_a_norm(simulator):
    counts = np.full(102, 10)
    prior = default_prior("tbabs*cflux*(powerlaw+gauss)", simulator.response, counts)
    low, high = prior.marginals["cflux_1.lg10Flux"].support
    assert high - low >= 5.99
    # 1020 counts of 353 s in EPIC-pn are some 1e-11 erg/cm2/s.
    assert low < -11.5 < -10.5 < high
    assert "powerlaw_1.norm" not in prior.names
    assert isinstance(prior.marginals["gauss_1.norm"], LogUniform)
    several = default_prior("tbabs*(cflux*powerlaw+cflux*bbody)", simulator.response, counts)
    alone = default_prior("tbabs*cflux*powerlaw", simulator.response, counts)
    np.testing.assert_allclose(
        several.marginals["cflux_1.lg10Flux"].support, alone.marginals["cflux_1.lg10Flux"].support, atol=0.3
    )


def test_what_is_tied_has_the_prior_of_the_first(simulator):
    prior = default_prior(
        "gauss+zgauss(El=gauss_1.El, redshift=0.1)+po(alpha=1)", simulator.response, np.ones(102)
    )
    assert prior.names == (
        "gauss_1.El", "gauss_1.sigma", "gauss_1.norm", "zgauss_1.sigma", "zgauss_1.norm", "powerlaw_1.norm",
    )  # fmt: skip
    given = {f"{name}.norm": LogUniform(1e-5, 1.0) for name in ("cutoffpl_1", "powerlaw_1")}
    prior = default_prior(
        "cutoffpl+powerlaw(alpha=cutoffpl_1.beta)", simulator.response, np.ones(102), given=given
    )
    assert prior.marginals["cutoffpl_1.beta"] == SHAPES["Cutoffpl"]["beta"]


def test_the_truth_lies_well_inside(simulator):
    theta = simulator.prior.sample(60, np.random.default_rng(1))
    x = simulator.simulate(theta, np.random.default_rng(2))
    together = default_prior(simulator.model, simulator.response, x)
    u = together.to_unit_cube(theta)
    assert ((u > 0.005) & (u < 0.995)).all()
    for truth, counts in zip(theta[:3], x[:3], strict=True):
        u = default_prior(simulator.model, simulator.response, counts).to_unit_cube(truth)
        assert ((u > 0.005) & (u < 0.995)).all()


def test_norms_follow_the_rate_not_the_exposure(simulator):
    counts = np.full(102, 10)
    once = default_prior("powerlaw", simulator.response, counts)
    longer = default_prior("powerlaw", simulator.response.with_exposure(10 * simulator.exposure), 10 * counts)
    brighter = default_prior("powerlaw", simulator.response, 10 * counts)
    other = default_prior("powerlaw", simulator.response, counts, simulator.exposure / 10)
    low = np.array([p.marginals["powerlaw_1.norm"].support[0] for p in (once, longer, brighter, other)])
    np.testing.assert_allclose(low[1:] / low[0], [1.0, 10.0, 10.0], rtol=1e-9)
    span = once.marginals["powerlaw_1.norm"].support
    assert span[1] / span[0] >= 0.999e6


def test_lines_lie_in_the_band(simulator):
    prior = default_prior("powerlaw+gauss", simulator.response, np.ones(102))
    low, high = prior.marginals["gauss_1.El"].support
    assert (low, high) == pytest.approx((0.522, 7.795), abs=1e-3)


def test_what_is_given_replaces_the_default(simulator, tmp_path):
    counts = np.full(102, 10)
    (tmp_path / "p.toml").write_text('[tbabs_1.nh]\ndistribution = "uniform"\nlow = 0.1\nhigh = 0.3\n')
    prior = model_prior(*settled("tbabs*powerlaw", tmp_path / "p.toml"), simulator.response, counts)
    assert prior.marginals["tbabs_1.nh"] == Uniform(0.1, 0.3)
    assert prior.marginals["powerlaw_1.alpha"] == SHAPES["Powerlaw"]["alpha"]
    given = {"powerlaw_1.norm": LogUniform(1e-5, 1e-3)}
    assert default_prior("powerlaw", simulator.response, counts, given=given).marginals == {
        "powerlaw_1.alpha": SHAPES["Powerlaw"]["alpha"],
        "powerlaw_1.norm": LogUniform(1e-5, 1e-3),
    }
    whole = model_prior(*settled(simulator.model, "reference"), simulator.response, counts)
    assert whole == simulator.prior


def test_a_column_that_is_given_narrows_the_norm(simulator):
    counts = np.full(102, 10)
    wide = default_prior("tbabs*powerlaw", simulator.response, counts)
    given = {"tbabs_1.nh": Uniform(10.0, 12.0), "powerlaw_1.alpha": Uniform(1.9, 2.1)}
    heavy = default_prior("tbabs*powerlaw", simulator.response, counts, given=given)
    assert heavy.marginals["powerlaw_1.norm"].center > 10 * wide.marginals["powerlaw_1.norm"].support[0]
    span = heavy.marginals["powerlaw_1.norm"].support
    assert span[1] / span[0] == pytest.approx(1e6)


def test_what_cannot_be_is_refused_in_one_line(simulator):
    with pytest.raises(InputError, match=r"prior for tbabs_1\.nh, which it does not have"):
        default_prior("powerlaw", simulator.response, np.ones(102), given={"tbabs_1.nh": Uniform(0, 1)})
    with pytest.raises(InputError, match="no counts"):
        default_prior("powerlaw", simulator.response, np.zeros(102))


def test_a_norm_reaches_three_decades_to_either_side_of_what_the_counts_need(simulator):
    counts = np.full(102, 10)
    response = simulator.response
    sharp = default_prior(
        "powerlaw", response, counts, given={"powerlaw_1.alpha": Uniform(2.0, 2.0 + 1e-9)}
    ).marginals["powerlaw_1.norm"]
    made = type(simulator)("powerlaw(alpha=2.0)", response, Prior({"powerlaw_1.norm": LogUniform(1e-6, 1e6)}))
    needed = counts.sum() / made.expected(np.array([[1.0]])).sum()
    # From a thousandth to ten times of it would be four decades about a tenth of it: there are six.
    np.testing.assert_allclose(sharp.support, needed * 0.1 * np.array([1e-3, 1e3]), rtol=1e-6)
    # Two sources: the faint one from below, the bright one from above.
    two = default_prior(
        "powerlaw", response, [counts, 100 * counts], given={"powerlaw_1.alpha": Uniform(2.0, 2.0 + 1e-9)}
    ).marginals["powerlaw_1.norm"]
    np.testing.assert_allclose(two.support, needed * np.array([1e-3, 1e3]), rtol=1e-6)


def test_shapes_that_need_unlike_norms_widen_the_prior(simulator):
    """By the tenths of draws, sorted by hand: indices from -1 to 5 ask for norms of seven decades."""
    counts = np.full(102, 10)
    low, high = default_prior("powerlaw", simulator.response, counts).marginals["powerlaw_1.norm"].support
    made = type(simulator)(
        "powerlaw", simulator.response,
        Prior({"powerlaw_1.alpha": Uniform(-1, 5), "powerlaw_1.norm": LogUniform(1e-6, 1e6)}),
    )  # fmt: skip
    index = np.linspace(-1, 5, 2001)
    needed = np.sort(counts.sum() / made.expected(np.column_stack([index, np.ones(2001)])).sum(axis=1))
    middle = np.sqrt(1e-3 * needed[200] * 10 * needed[1800])
    half = max(0.5 * np.log10(1e4 * needed[1800] / needed[200]), 3.0)
    # 512 draws tell the tenths within a few percent of an index.
    np.testing.assert_allclose(np.log10([low, high]), np.log10(middle) + np.array([-half, half]), atol=0.15)


LINED = "tbabs*edge*(powerlaw+gauss+zgauss(El={El}))"


@pytest.mark.parametrize(
    ("El", "second"),
    [("6.7", {}), ("gauss_1.El", {"gauss_1.El": ("zgauss_1.sigma", "zgauss_1.redshift", "zgauss_1.norm")})],
)
def test_lines_and_edges_have_places_where_their_energies_are_free(simulator, El, second):
    """A tied energy takes the parameters of both components along, a frozen one is no place."""
    model = LINED.format(El=El)
    prior = default_prior(model, simulator.response, np.full(102, 10))
    source = XraySpectrum(model, simulator.response, prior)
    line = ("gauss_1.sigma", "gauss_1.norm", *second.get("gauss_1.El", ()))
    wanted = {"edge_1.Ec": ("edge_1.tau",), "gauss_1.El": line}
    assert source.places == wanted
    assert all(name in prior.names for place in wanted for name in (place, *wanted[place]))
    behind = with_background(source, np.full(102, 5), 0.5, knots=[0.5, 2.0, 8.0])
    joint = joint_spectra([behind, source], ["a", "b"])
    assert behind.places == joint.places == joint.parts[1].simulator.places == wanted
    assert all(name in joint.prior.names for place in wanted for name in (place, *wanted[place]))


def test_a_model_without_lines_has_no_places(simulator):
    assert simulator.places == {}
