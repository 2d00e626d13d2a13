"""What instruments do to recorded energies: gains, broadening, pile-up, background."""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq
from scipy.sparse import csr_array
from scipy.special import ndtr

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import Effect, Prior, Uniform

pytest.importorskip("jaxspec")
from gaugeblock.core.precision import double_precision
from gaugeblock.simulators.xray import Response, XraySpectrum, data, reference
from gaugeblock.simulators.xray.effects import EFFECTS
from gaugeblock.simulators.xray.gain import Gain
from gaugeblock.simulators.xray.pha import read_pha
from gaugeblock.simulators.xray.recorded.layout import Layout, layout, near, per_second
from gaugeblock.simulators.xray.recorded.pileup import Pileup

pytestmark = pytest.mark.usefixtures("xray_data")

THETA = np.array([2.0, 1e-9])
PILEUP = Effect("pileup", {"overlap": Uniform(0, 1)})


def ungrouped(band, norm=(1e-9, 1e-2)):
    """A power law in EPIC-pn's own channels."""
    response = Response.from_ogip(
        data.path(data.EXAMPLE + "PN.rmf"), data.path(data.EXAMPLE + "PN.arf"), band=band, exposure=1e4
    )
    return XraySpectrum(
        "powerlaw", response, Prior({"powerlaw_1.alpha": Uniform(1, 3), "powerlaw_1.norm": Uniform(*norm)})
    )


@pytest.fixture(scope="module")
def line():
    """A narrow line on next to nothing, from 5 to 8 keV."""
    return ungrouped((5.0, 8.0)).with_effect(
        Effect("emission_line", {"energy": 6.4, "sigma": 0.02, "norm": 1.0})
    )


@pytest.fixture(scope="module")
def whole():
    """A bright power law over all channels."""
    return ungrouped(None)


def moments(spectrum, counts):
    """Mean and variance of the energies near the peak of some counts."""
    middle = spectrum.channels.mean(axis=1)
    near = np.abs(middle - middle[np.argmax(counts)]) < 0.4
    mean = np.average(middle[near], weights=counts[near])
    return mean, np.average((middle[near] - mean) ** 2, weights=counts[near])


def test_counts_move_along_a_cubic_of_their_sum_and_begin_to_with_its_slope():
    """Six unequal channels; the slope between two lies between their densities, at the ends it is theirs."""
    import jax
    import jax.numpy as jnp

    edges = np.array([1.0, 1.5, 2.5, 3.0, 4.5, 5.0, 7.0])
    counts = np.array([4.0, 9.0, 2.0, 30.0, 1.0, 12.0])
    width = np.diff(edges)
    density = counts / width
    slope = np.empty(7)
    slope[0], slope[-1] = density[0], density[-1]
    for i in range(1, 6):
        # The nearer a middle, the more its density counts.
        slope[i] = np.interp(edges[i], edges[i - 1 : i + 1].mean() + [0, (width[i - 1] + width[i]) / 2],
                             density[i - 1 : i + 1])  # fmt: skip
    cubic = CubicHermiteSpline(edges, np.append(0.0, np.cumsum(counts)), slope)
    change = Gain(lambda energy, shift: energy + shift).prepare(edges, None)

    def moved(shift):
        return change(jnp.asarray(counts), {"shift": shift}, None)

    both = jax.jit(lambda shift: (moved(shift), jax.jacfwd(moved)(shift)))
    with double_precision():
        for shift in (-0.3, 0.0, 0.7):
            between = cubic(np.clip(edges + shift, 1.0, 7.0))
            np.testing.assert_allclose(both(shift)[0], np.diff(between), rtol=1e-11, atol=1e-11)
        found, rise = both(0.0)
    assert found.tolist() == counts.tolist()
    # Where nothing moves yet, also at both ends, and not half of it.
    np.testing.assert_allclose(rise, np.diff(slope), rtol=1e-11, atol=1e-11)


def test_channels_between_two_energies_have_one_or_two_to_spare_on_either_side():
    edges = np.array([1.0, 1.5, 2.5, 3.0, 4.5, 5.0, 7.0])
    places = Layout(np.arange(6), edges, edges[None, [0, -1]], np.ones((1, 1)), None)
    for low, high in [(2.7, 2.8), (2.5, 3.0), (1.2, 2.0), (0.1, 1.1), (4.6, 9.0), (0.1, 9.0), (1.0, 7.0)]:
        touched = [i for i in range(6) if edges[i] <= high and edges[i + 1] >= low]
        found = near(places, low, high)
        assert found.start == max(touched[0] - 1, 0), (low, high)
        assert min(touched[-1] + 2, 6) <= found.stop <= min(touched[-1] + 3, 6), (low, high)


@pytest.mark.parametrize(
    ("name", "ranges", "reach"),
    [
        ("gain_slope", {"slope": (0.9, 1.1)}, (1.0 / 1.1, 8.0 / 0.9)),
        ("gain_offset", {"offset": (-0.2, 0.1)}, (0.9, 8.2)),
        # The farthest below the pivot and above it are both those of the weaker curve.
        (
            "gain_curve",
            {"curve": (0.01, 0.05)},
            [brentq(lambda e, r=r: e + 0.01 * e * (e - 5.9) / 5.9 - r, 0.1, 12.0) for r in (1.0, 8.0)],
        ),
        ("resolution", {"variance": (0.0, 0.04)}, (1.0 - 1.6, 8.0 + 1.6)),
        ("background", {"level": (0.0, 1.0), "index": (0.0, 2.0)}, (1.0, 8.0)),
        ("pileup", {"overlap": (0.0, 1.0)}, (-np.inf, 8.0)),
    ],
)
def test_what_happens_between_two_energies_may_come_from_so_far(name, ranges, reach):
    found = EFFECTS[name].apply.what.reach(1.0, 8.0, ranges)
    assert found == pytest.approx(tuple(reach), rel=1e-5)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("name", "ranges"),
    [
        ("gain_slope", {"slope": (0.9, 1.1)}),
        ("gain_offset", {"offset": (-0.2, 0.1)}),
        ("gain_curve", {"curve": (-0.05, 0.05)}),
    ],
)
def test_a_gain_of_what_comes_from_all_energies_comes_from_all(name, ranges):
    """Resolution without end, or pile-up, lies between the gain and the recorded counts."""
    reach = EFFECTS[name].apply.what.reach
    assert reach(-np.inf, np.inf, ranges) == (-np.inf, np.inf)
    low, high = reach(-np.inf, 8.0, ranges)
    assert low == -np.inf
    assert high == reach(1.0, 8.0, ranges)[1]


def test_channels_are_laid_out_by_energy_and_groups_are_runs_of_neighbours():
    """A detector that counts downwards; one channel of a group is bad, so that it is two runs."""
    fine = np.array([[3.0, 4.0], [2.0, 3.0], [1.0, 2.0], [0.0, 1.0]])
    grouping = csr_array(np.array([[1.0, 0, 1, 1], [0, 1, 0, 0]]))
    matrix = np.array([[0.1, 0.2], [0.3, 0.4], [0.5, 0.6], [0.7, 0.8]])
    bins = np.array([[0.5, 1.0], [1.0, 4.0]])
    response = Response(
        "made", bins, fine[:2], fine, np.array([10.0, 20.0]), csr_array(matrix), grouping, 5.0
    )  # fmt: skip
    found = layout(response)
    assert found.order.tolist() == [3, 2, 1, 0]
    assert found.edges.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert found.runs.tolist() == [[0.0, 2.0], [3.0, 4.0], [2.0, 3.0]]
    assert found.groups.toarray().tolist() == [[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    assert found.members.toarray().tolist() == [[1.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0]]
    np.testing.assert_allclose(per_second(response, [2, 0]), [[5.0, 12.0], [1.0, 4.0]])


def test_a_curved_gain_moves_a_line_by_its_formula_and_keeps_its_counts():
    free = ungrouped((5.0, 8.0)).with_effect(
        Effect("emission_line", {"energy": Uniform(5.5, 7.0), "sigma": 0.02, "norm": 1.0})
    )
    free = free.with_effect(Effect("gain_curve", {"curve": Uniform(-0.03, 0.03)}))
    middle = free.channels.mean(axis=1)
    for curve in (-0.02, 0.015):
        plain, moved = (free.expected([*THETA, 6.4, value]) for value in (0.0, curve))
        at = middle[np.argmax(plain)]
        shift = moments(free, moved)[0] - moments(free, plain)[0]
        assert shift == pytest.approx(curve * at * (at - 5.9) / 5.9, rel=0.05)
        assert moved.sum() == pytest.approx(plain.sum(), rel=1e-3)
    # It is right at its pivot.
    plain, moved = (free.expected([*THETA, 5.9, value]) for value in (0.0, 0.02))
    assert moments(free, moved)[0] == pytest.approx(moments(free, plain)[0], abs=0.003)


def test_broadening_is_a_gaussian_of_the_stated_variance(line):
    variance = 0.0025
    plain = line.expected(THETA)
    broad = line.with_effect(Effect("resolution", {"variance": Uniform(0, 0.02)}))
    counts = broad.expected([*THETA, variance])
    edges = np.append(line.channels[:, 0], line.channels[-1, 1])
    width = np.diff(edges).mean()
    # Diffusion between channels starts from a channel's middle; the Gaussian here starts from all of it.
    spread = np.sqrt(variance - width**2 / 12)
    kernel = np.diff(ndtr((edges[:, None] - 0.5 * (edges[:-1] + edges[1:])) / spread), axis=0)
    inside = (edges[:-1] > 5.6) & (edges[:-1] < 7.2)
    np.testing.assert_allclose(counts[inside], (kernel @ plain)[inside], rtol=2e-3, atol=1e-4 * plain.max())
    before, after = (moments(line, c) for c in (plain, counts))
    assert after[0] == pytest.approx(before[0], abs=1e-3)
    assert counts.sum() == pytest.approx(plain.sum(), rel=1e-4)
    smallest = broad.expected([*THETA, 1e-7])
    assert np.all(smallest >= 0)
    slope = (smallest - plain) / 1e-7
    jacobian = broad.jacobian([*THETA, 0.0])[:, -1]
    np.testing.assert_allclose(slope, jacobian, atol=2e-2 * np.abs(jacobian).max())


def test_variances_add_up(line):
    twice = line.with_effect(Effect("resolution", {"variance": 0.001}))
    twice = twice.with_effect(Effect("resolution", {"variance": 0.002})).expected(THETA)
    once = line.with_effect(Effect("resolution", {"variance": 0.003})).expected(THETA)
    free = line.with_effect(Effect("resolution", {"variance": Uniform(0, 0.01)}))
    np.testing.assert_allclose(twice, once, rtol=1e-9, atol=1e-9 * once.max())
    np.testing.assert_allclose(free.expected([*THETA, 0.003]), once, rtol=1e-9, atol=1e-9 * once.max())


def test_background_knows_neither_area_nor_redistribution():
    spectrum = reference(level="bright")
    theta = spectrum.prior.center
    level, gain = (
        Effect("background", {"level": 0.05, "index": Uniform(-1.0, 3.0)}),
        Effect("gain_slope", {"slope": 1.05}),
    )
    changed = spectrum.with_effect(level)
    before, after = changed.with_effect(gain), spectrum.with_effect(gain).with_effect(level)
    low, high = spectrum.channels.T
    for index in (0.0, 1.0, 1.7):
        # Every group of this spectrum is one run of channels.
        power = 1.0 - index
        integral = np.log(high / low) if power == 0 else (high**power - low**power) / power
        added = changed.expected([*theta, index]) - spectrum.expected(theta)
        np.testing.assert_allclose(added, spectrum.exposure * 0.05 * integral, rtol=1e-9)
        most = np.abs(before.expected([*theta, index]) / after.expected([*theta, index]) - 1).max()
        # What comes later sees what came before; but counts even in log energy stay so under a slope.
        assert most < 1e-6 if index == 1.0 else most > 1e-4


@pytest.fixture(scope="module")
def piled(whole):
    """Frames of 10 ms over all channels, in which photons may pile up."""
    framed = XraySpectrum("powerlaw", whole.response.with_frame_time(0.01), whole.prior)
    return framed.with_effect(PILEUP)


def test_piled_up_pairs_keep_their_energy(whole, piled):
    theta = np.array([2.0, 5e-3])
    rate = whole.expected(theta) / whole.exposure
    middle = whole.channels.mean(axis=1)
    slope = piled.jacobian([*theta, 0.0])[:, -1] / whole.exposure
    total = rate.sum()
    assert slope.sum() == pytest.approx(-0.5 * 0.01 * total**2, rel=1e-3)
    assert (slope * middle).sum() == pytest.approx(0.0, abs=1e-3 * 0.01 * total * (rate * middle).sum())
    # Pairs by hand, on a grid of 20 eV.
    grid = np.arange(0, 20, 0.02)
    coarse = np.histogram(middle, grid, weights=rate)[0]
    pairs = 0.5 * 0.01 * np.convolve(coarse, coarse)[: len(coarse)]
    energy = grid[:-1] + 0.02
    high = (energy > 4) & (energy < 8)
    mine = np.histogram(middle, grid, weights=slope + 0.01 * total * rate)[0]
    assert mine[high].sum() == pytest.approx(pairs[high].sum(), rel=0.02)
    counts = piled.expected([*theta, 0.5])
    assert np.all(counts > 0)
    assert counts.sum() < whole.expected(theta).sum()


def test_pile_up_of_unequal_channels_is_that_of_equal_ones(whole):
    """By loops: counts spread evenly over equal bins, every pair of bins added up, and spread back."""
    import jax.numpy as jnp

    rng = np.random.default_rng(2)
    edges = np.concatenate([[0.0], np.cumsum(rng.uniform(0.6, 1.4, 30))])
    counts, frame, overlap, others = rng.uniform(0.0, 5.0, 30), 0.01, 0.3, 40.0
    change = Pileup().prepare(edges, whole.response.with_frame_time(frame))
    with double_precision():
        found = np.asarray(change(jnp.asarray(counts), {"overlap": overlap}, others))

    def spread(values, own, wanted):
        made = np.zeros(len(wanted) - 1)
        for i, value in enumerate(values):
            for j in range(len(made)):
                shared = min(own[i + 1], wanted[j + 1]) - max(own[i], wanted[j])
                made[j] += value * max(shared, 0.0) / (own[i + 1] - own[i])
        return made

    equal = np.linspace(0.0, edges[-1], int(np.ceil(edges[-1] / np.median(np.diff(edges)))) + 1)
    even = spread(counts, edges, equal)
    pairs = np.zeros(len(even) + 1)
    for i, one in enumerate(even):
        for j, other in enumerate(even):
            # Two flat bins make a triangle over two: half of it in each.
            for k in (i + j, i + j + 1):
                pairs[min(k, len(even))] += 0.5 * one * other
    rate = overlap * frame
    made = counts + 0.5 * rate * spread(pairs[:-1], equal, edges)
    np.testing.assert_allclose(found, np.exp(-rate * (counts.sum() + others)) * made, rtol=1e-10)


def test_pile_up_counts_the_photons_outside_the_band(piled):
    theta = np.array([2.0, 5e-3])
    narrow = ungrouped((1.0, 5.0))
    band = XraySpectrum("powerlaw", narrow.response.with_frame_time(0.01), narrow.prior).with_effect(PILEUP)
    inside = np.isin(piled.channels[:, 0], band.channels[:, 0])
    np.testing.assert_allclose(band.expected([*theta, 0.3]), piled.expected([*theta, 0.3])[inside], rtol=1e-3)


def test_without_a_frame_time_there_is_no_pile_up_and_it_says_why(whole):
    with pytest.raises(InputError, match="frame time is not known, which pileup needs; give it") as caught:
        whole.with_effect(Effect("pileup", {"overlap": 0.1}))
    assert "\n" not in str(caught.value)
    assert set(whole.not_in_library()) == {"pileup"}
    framed = XraySpectrum("powerlaw", whole.response.with_frame_time(0.01), whole.prior)
    assert not framed.not_in_library()
    # It identifies what depends on it, and nothing else.
    assert "frame_time_s" not in framed.describe()
    assert framed.with_effect(Effect("pileup", {"overlap": 0.1})).describe()["frame_time_s"] == 0.01
    with pytest.raises(InputError, match="positive number of seconds"):
        whole.response.with_frame_time(0.0)


def test_frame_times_are_read_from_headers(tmp_path):
    fits = pytest.importorskip("astropy.io.fits")
    assert reference().response.frame_time == pytest.approx(0.073)
    assert reference("nicer").response.frame_time is None
    path = tmp_path / "frames.pha"
    for keyword, value, expected in [
        ("TIMEDEL", 3.2, 3.2),
        ("TIMEDEL", 4e-8, None),
        ("FRMTIME", 199, 0.199),
        ("FRMTIME", 0, None),
    ]:
        table = fits.BinTableHDU.from_columns(
            [fits.Column("CHANNEL", "J", array=np.arange(4)), fits.Column("COUNTS", "J", array=np.ones(4))],
            name="SPECTRUM",
        )
        table.header["EXPOSURE"] = 100.0
        table.header[keyword] = value
        fits.HDUList([fits.PrimaryHDU(), table]).writeto(path, overwrite=True)
        assert read_pha(path).frame_time == expected


def test_the_order_of_what_is_recorded_matters_and_of_factors_does_not():
    spectrum = reference(level="bright")
    theta = spectrum.prior.sample(20, np.random.default_rng(0))
    factors = [
        Effect("absorption_line", {"energy": 1.5, "sigma": 0.04, "strength": 0.03}),
        Effect("effective_area", {"energy": 2.0, "width": 0.1, "depth": -0.2}),
        Effect("reflection", {"energy": 6.4, "width": 0.2, "strength": 1.0}),
        Effect("soft_excess", {"kT": 0.1, "norm": 50.0}),
    ]
    recorded = [
        Effect("resolution", {"variance": 0.002}),
        Effect("gain_slope", {"slope": 1.02}),
        Effect("pileup", {"overlap": 0.5}),
        Effect("background", {"level": 0.02, "index": 1.0}),
        Effect("gain_offset", {"offset": -0.02}),
    ]

    def together(effects):
        changed = spectrum
        for effect in effects:
            changed = changed.with_effect(effect)
        return changed.expected(theta)

    first = together([*factors, *recorded])
    turned = factors[::-1]
    mixed = together([recorded[0], *turned[:2], *recorded[1:3], *turned[2:], *recorded[3:]])
    np.testing.assert_allclose(mixed, first, rtol=1e-10)
    assert np.abs(together([*factors, *recorded[::-1]]) / first - 1).max() > 1e-4
    # A gain is the same whether something comes after it or not.
    nothing = Effect("background", {"level": 0.0, "index": 1.0})
    np.testing.assert_allclose(together([recorded[1], nothing]), together([recorded[1]]), rtol=1e-10)
