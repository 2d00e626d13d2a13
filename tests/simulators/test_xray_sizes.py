"""Programs that spectra of one instrument share: other sizes, the same numbers, compiled once."""

import gc
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("jaxspec")
from gaugeblock.simulators import Prior, Uniform
from gaugeblock.simulators.xray import Response, XraySpectrum, read_observation
from gaugeblock.simulators.xray.data import EXAMPLE, path
from gaugeblock.simulators.xray.response import grown, size_above

pytestmark = pytest.mark.usefixtures("xray_data")

PRIOR = Prior(
    {
        "tbabs_1.nh": Uniform(0.1, 1.0),
        "powerlaw_1.alpha": Uniform(1.0, 3.0),
        "powerlaw_1.norm": Uniform(1e-4, 1e-2),
    }
)


@pytest.fixture(scope="module")
def response(xray_data):
    files = ("MOS1.rmf", "MOS1.arf", "MOS1_spectrum_grp.fits")
    return Response.from_ogip(*(path(EXAMPLE + name) for name in files), band=(0.4, 9.0))


def spectrum(response):
    return XraySpectrum("tbabs*powerlaw", response, PRIOR, integration="exact")


def regrouped(response, pairs):
    """Some pairs of channels in the middle as one each."""
    number = len(response.channels)
    first = number // 2 + 2 * np.arange(pairs)
    kept = np.setdiff1d(np.arange(number), first + 1)
    grouping = response.grouping.tolil()
    grouping[first] = grouping[first] + grouping[first + 1]
    channels = response.channels.copy()
    channels[first, 1] = channels[first + 1, 1]
    return replace(response, channels=channels[kept], grouping=grouping.tocsr()[kept])


def test_sizes_are_few_and_never_far_above():
    sizes = np.array([size_above(n) for n in range(1, 5000)])
    numbers = np.arange(1, 5000)
    assert np.all(sizes >= numbers)
    assert np.all(np.diff(sizes) >= 0)
    assert np.all(sizes[64:] <= 1.0906 * numbers[64:] + 1)
    assert all(size_above(size) == size for size in set(sizes.tolist()))
    assert len(set(sizes.tolist())) == 8 + 8 * 6 + 3


@pytest.mark.parametrize("start", [0, 3, 50])
@pytest.mark.parametrize("length", [1, 9, 64, 90])
def test_a_range_grows_within_its_limits(start, length):
    rows = slice(start, start + length)
    for low, high in ((0, 1000), (start, start + length), (0, start + length + 1), (60, 1000)):
        found = grown(rows, low, high)
        assert found.start <= rows.start
        assert found.stop >= rows.stop
        assert found.start >= min(low, rows.start)
        assert found.stop <= high
        assert found.stop - found.start <= size_above(length)
    assert grown(rows, 0, 1000).stop - grown(rows, 0, 1000).start == size_above(length)


TOGETHER = (("emission_line", "partial_covering", "effective_area", "gain_curve"), ("resolution",))
"""What is added, what is multiplied, and the three ways in which a detector may differ."""


def test_every_kind_of_effect_expects_the_same_counts(response):
    plain, shared = spectrum(response), spectrum(replace(response, shared=True))
    theta = PRIOR.sample(3, np.random.default_rng(1))
    channels = len(response.channels)
    assert len(shared.response.sized.channels) > channels
    np.testing.assert_allclose(shared.expected(theta), plain.expected(theta), rtol=1e-12)
    assert shared.jacobian(theta).shape == (3, channels, 3)
    np.testing.assert_allclose(shared.jacobian(theta), plain.jacobian(theta), rtol=1e-9, atol=1e-9)
    counts = np.round(plain.expected(theta))
    np.testing.assert_allclose(
        shared.log_likelihood(theta, counts), plain.log_likelihood(theta, counts), rtol=1e-9
    )
    library = plain.effect_library(theta)
    for names in TOGETHER:
        mine, theirs = shared, plain
        for name in names:
            effect = library[name].effect()
            mine, theirs = mine.with_effect(effect), theirs.with_effect(effect)
        rows = theirs.prior.sample(4, np.random.default_rng(2))
        # Gains interpolate a cumulative sum: what lies outside of the band takes part in its rounding.
        np.testing.assert_allclose(mine.expected(rows), theirs.expected(rows), rtol=1e-9, err_msg=names[-1])
        held = mine.held(rows[0, 3:]).expected(rows[:1, :3])
        np.testing.assert_allclose(held, theirs.expected(rows[:1]), rtol=1e-9, err_msg=names[-1])


@pytest.mark.parametrize("effect", [None, "gain_slope", "emission_line", "resolution"])
def test_other_groups_find_the_programs_that_there_are(response, effect):
    """Spectra of 103 and of 101 channels: nothing is compiled for the second."""
    jax = pytest.importorskip("jax")
    monitoring = pytest.importorskip("jax.monitoring")
    if not jax.config.jax_compilation_cache_dir:
        pytest.skip("JAX keeps no programs here")
    missed = []

    def listen(event, **_):
        if event.endswith("cache_misses"):
            missed.append(event)

    def evaluated(response):
        model = spectrum(response)
        if effect is not None:
            model = model.with_effect(model.effect_library([[0.3, 2.0, 1e-3]])[effect].effect())
        missed.clear()
        return model.expected(model.prior.sample(4, np.random.default_rng(3)))

    monitoring.register_event_listener(listen)
    try:
        one = evaluated(replace(response, shared=True))
        other = evaluated(replace(regrouped(response, 2), shared=True))
        assert not missed
        assert one.shape[1] - other.shape[1] == 2
        np.testing.assert_allclose(other.sum(axis=1), one.sum(axis=1), rtol=1e-9)
    finally:
        monitoring.unregister_event_listener(listen)


def test_measured_spectra_share_programs():
    files = {role: path(EXAMPLE + name) for role, name in (("rmf", "PN.rmf"), ("arf", "PN.arf"))}
    read = read_observation(
        path(EXAMPLE + "PN_spectrum_grp20.fits"),
        model="powerlaw",
        band=(0.5, 8.0),
        background="none",
        **files,
    )
    assert read.simulator.response.shared


def test_models_of_one_response_share_its_matrix(response):
    jax = pytest.importorskip("jax")
    theta, models, held = PRIOR.sample(1, np.random.default_rng(4)), [], []
    plain = spectrum(response)
    library = plain.effect_library(theta)
    shifted = plain.with_effect(library["gain_offset"].effect())
    for name in (None, "emission_line"):
        gc.collect()
        held.append(sum(array.nbytes for array in jax.live_arrays()))
        models.append(shifted if name is None else shifted.with_effect(library[name].effect()))
        models[-1].expected(models[-1].prior.sample(1, np.random.default_rng(5)))
    first, other = np.diff([*held, sum(array.nbytes for array in jax.live_arrays())])
    assert first > 8 * len(response.channels) * 100
    assert other < 0.2 * first
