"""Several instruments: shared source, constants between them, effects where they belong."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.discovery.fitting import fit
from gaugeblock.simulators import Effect, LogUniform, Simulator, Uniform
from gaugeblock.simulators.library import Known, LibraryEffect
from gaugeblock.simulators.protocol import Described, Extensible, HasJacobian, HasLikelihood, HasNoise
from gaugeblock.simulators.segments import segments

pytest.importorskip("jaxspec")
from gaugeblock.simulators.xray import (
    OnInstrument,
    XraySpectrum,
    data,
    double_precision,
    joint_spectra,
    on_instrument,
    reference,
    w_statistic,
    with_background,
)
from gaugeblock.simulators.xray.joint_library import joint_library

pytestmark = pytest.mark.usefixtures("xray_data")
GAIN = Effect("gain_slope", {"slope": Uniform(0.95, 1.05)})
LINE = Effect("emission_line", {"energy": 2.0, "sigma": 0.1, "norm": Uniform(0.0, 1e-3)})


@pytest.fixture(scope="module")
def pn():
    return reference()


@pytest.fixture(scope="module")
def mos(pn):
    from gaugeblock.simulators.xray import Response

    names = ("MOS1.rmf", "MOS1.arf", "MOS1_spectrum_grp.fits")
    paths = [data.path(data.EXAMPLE + name) for name in names]
    response = Response.from_ogip(*paths, band=(0.3, 10.0), exposure=2e3)
    source = XraySpectrum(pn.model, response, pn.prior)
    level = np.random.default_rng(0).poisson(5.0, len(response.channels))
    return with_background(source, level, 0.5, knots=[0.3, 1.0, 10.0])


@pytest.fixture(scope="module")
def joint(pn, mos):
    return joint_spectra([pn, mos], ["pn", "mos"])


@pytest.fixture(scope="module")
def gained(joint):
    return (
        joint.with_effect(LINE).with_effect(on_instrument(GAIN, "mos")).with_effect(on_instrument(GAIN, "pn"))
    )


@pytest.fixture(scope="module")
def theta(joint):
    return joint.prior.sample(40, np.random.default_rng(1))


def test_names_shapes_and_segments(joint, pn, mos):
    assert isinstance(joint, Simulator)
    for capability in (HasNoise, HasLikelihood, Extensible, Described, HasJacobian):
        assert isinstance(joint, capability)
    assert joint.prior.names == (
        *pn.prior.names,
        "cross_calibration_2.factor",
        "background_2.rate_1",
        "background_2.rate_2",
        "background_2.rate_3",
    )
    number = mos.data_shape[0] // 2
    found = [(s.name, s.start, s.stop, s.role) for s in segments(joint, 102 + 2 * number)]
    assert found == [
        ("pn", 0, 102, "source"),
        ("mos", 102, 102 + number, "source"),
        ("mos background", 102 + number, 102 + 2 * number, "background"),
    ]
    assert joint.data_shape == (102 + 2 * number,)


def test_it_is_its_parts_side_by_side_and_the_constant_acts_on_the_source(joint, pn, mos, theta):
    expected = joint.expected(theta)
    own, factor, behind = theta[:, :5], theta[:, 5:6], theta[:, 6:]
    assert np.array_equal(expected[:, :102], pn.expected(own))
    alone = mos.expected(np.concatenate([own, behind], axis=1))
    number = alone.shape[1] // 2
    assert np.array_equal(expected[:, 102 + number :], alone[:, number:])
    extra = (factor - 1.0) * mos.source.expected(own)
    np.testing.assert_allclose(expected[:, 102 : 102 + number], alone[:, :number] + extra, rtol=1e-9)


def test_w_of_instruments_with_and_without_a_background_adds_up(joint, pn, mos, theta):
    x = joint.simulate(theta[:4], np.random.default_rng(2))
    own, factor = theta[:4, :5], theta[:4, 5:6]
    number = mos.data_shape[0] // 2
    mean, counts = 2.0 * pn.expected(own), x[:, :102].astype(float)
    ratio = np.where(counts > 0, counts / mean, 1.0)
    cash = 2.0 * (mean - counts + counts * np.log(ratio)).sum(axis=1)
    behind = w_statistic(
        x[:, 102 : 102 + number], x[:, 102 + number :], 2.0 * factor * mos.source.expected(own), 0.5
    )
    np.testing.assert_allclose(joint.w_statistic(theta[:4], x, 2.0), cash + behind, rtol=1e-9)


@pytest.mark.parametrize("shifted", [False, True])
def test_the_jacobian_is_the_derivative(joint, gained, shifted):
    simulator = gained if shifted else joint
    at = simulator.prior.from_unit_cube(np.full(simulator.prior.size, 0.4371))
    jacobian = simulator.jacobian(at)
    # Small: a gain is interpolated between detector channels, and so has corners.
    steps = np.diag(np.maximum(np.abs(at), 1e-9) * 1e-7)
    slopes = (simulator.expected(at + steps) - simulator.expected(at - steps)) / (
        2 * steps.sum(axis=1)[:, None]
    )
    for derivative, slope in zip(jacobian.T, slopes, strict=True):
        np.testing.assert_allclose(derivative, slope, atol=1e-6 * np.abs(slope).max())


def test_a_source_effect_is_shared_and_an_instrument_effect_is_not(joint, gained, theta):
    added = ("emission_line_1.norm", "gain_slope_1.slope", "gain_slope_2.slope")
    assert gained.prior.names == (*joint.prior.names, *added)

    def extended(norm, mos_slope, pn_slope):
        columns = np.tile([norm, mos_slope, pn_slope], (len(theta), 1))
        return gained.expected(np.concatenate([theta, columns], axis=1))

    plain = extended(0.0, 1.0, 1.0)
    np.testing.assert_allclose(plain, joint.expected(theta), rtol=1e-7)
    line, mos, pn = (extended(*values) for values in ((1e-3, 1, 1), (0, 1.03, 1), (0, 1, 1.03)))
    number = (plain.shape[1] - 102) // 2
    pieces = {"pn": slice(0, 102), "mos": slice(102, 102 + number), "behind": slice(102 + number, None)}
    changed = {
        name: {
            piece
            for piece, place in pieces.items()
            if np.abs(data[:, place] / plain[:, place] - 1).max() > 1e-4
        }
        for name, data in (("line", line), ("mos", mos), ("pn", pn))
    }
    assert changed == {"line": {"pn", "mos"}, "mos": {"mos"}, "pn": {"pn"}}


def test_the_likelihood_under_jax_is_the_same(joint, theta):
    x = joint.simulate(theta[:5], np.random.default_rng(2))
    import jax

    with double_precision():
        traced = jax.jit(joint.log_likelihood_jax)(theta[0], x[0].astype(float))
        np.testing.assert_allclose(traced, joint.log_likelihood(theta[:5], x)[0], rtol=1e-10)


def test_a_constant_between_instruments_is_found(joint, theta):
    brighter = joint.with_exposure(200 * joint.exposure)
    np.testing.assert_allclose(brighter.expected(theta), 200 * joint.expected(theta), rtol=1e-9)
    at = joint.prior.center
    at[5] = 1.1
    x = brighter.simulate(np.tile(at, (40, 1)), np.random.default_rng(3))
    found = fit(brighter, x, start=np.tile(at, (40, 1)))
    factor = found.theta[:, 5]
    assert factor.std() < 0.05
    # Four standard errors, and this seed is fixed.
    assert abs(factor.mean() - 1.1) < 4 * factor.std() / np.sqrt(len(factor))


def entry(name, origin, low, high, scanned):
    return LibraryEffect(
        name=name,
        parameters={"energy": Uniform(low, high), "norm": Uniform(0.0, 1.0)},
        amplitude="norm",
        neutral=0.0,
        step=0.5,
        scanned={"energy": scanned},
        cause="a cause",
        typical="a size",
        origin=origin,
    )


def test_the_library_has_a_source_effect_once_and_an_instrument_effect_for_each():
    first = {
        "line": entry("line", "source", 0.5, 8, [1, 4, 7]),
        "area": entry("area", "instrument", 1, 2, [1]),
    }
    second = {
        "line": entry("line", "source", 3, 20, [1, 6, 7, 12]),
        "area": entry("area", "instrument", 1, 2, [1]),
    }
    library = joint_library({"pn": first, "nustar": second})
    assert list(library) == ["line", "area[pn]", "area[nustar]"]
    assert library["line"].parameters["energy"] == Uniform(0.5, 20)
    assert library["line"].scanned["energy"].tolist() == [1, 4, 7, 12]
    # What cannot be widened is as the first instrument has it.
    other = replace(second["line"], parameters={**second["line"].parameters, "energy": LogUniform(3, 20)})
    mixed = joint_library({"pn": first, "nustar": {"line": other}})["line"]
    assert mixed.parameters == first["line"].parameters
    assert library["area[nustar]"].name == "area"
    assert library["area[nustar]"].effect().kind == OnInstrument("nustar")


def test_lines_of_every_detector_are_known_once():
    pn, mos, iron = (Known(name, 1.0, 1) for name in ("of the pn", "of the mos", "iron"))
    given = {
        name: {"line": replace(entry("line", "source", 0.5, 8, [1]), known=known)}
        for name, known in {"pn": (iron, pn), "mos": (iron, mos)}.items()
    }
    assert joint_library(given)["line"].known == (iron, pn, mos)


def test_its_own_library_fits_its_instruments(joint, theta):
    library = joint.effect_library(theta)
    assert {"gain_slope[pn]", "gain_slope[mos]", "emission_line"} <= set(library)
    shifted = joint.with_effect(library["gain_slope[mos]"].effect())
    assert shifted.prior.size == joint.prior.size + len(library["gain_slope[mos]"].parameters)


def test_it_can_be_pickled_and_described(joint, theta):
    again = pickle.loads(pickle.dumps(joint))
    assert np.array_equal(again.expected(theta[:2]), joint.expected(theta[:2]))
    assert again.describe() == joint.describe()
    assert joint.with_effect(on_instrument(GAIN, "pn")).describe() != joint.describe()


def test_what_does_not_belong_together_is_refused(pn, mos, joint):
    with pytest.raises(InputError, match="distinct names"):
        joint_spectra([pn, mos], ["pn", "pn"])
    with pytest.raises(InputError, match="distinct names"):
        joint_spectra([], [])
    other = XraySpectrum(pn.model, pn.response, pn.prior.replace(**{"tbabs_1.nh": Uniform(0.0, 1.0)}))
    with pytest.raises(InputError, match="pn and other: need the same model"):
        joint_spectra([pn, other], ["pn", "other"])
    with pytest.raises(InputError, match="after joining"):
        joint_spectra([pn.with_effect(LINE)] * 2, ["a", "b"])
    with pytest.raises(InputError, match="no instrument 'nicer'; there are pn, mos"):
        joint.with_effect(on_instrument(GAIN, "nicer"))
    with pytest.raises(InputError, match="parameters"):
        joint.expected(np.zeros(3))


def test_a_fixed_effect_may_be_there_before_joining(pn):
    fixed = Effect("gain_slope", {"slope": 1.02})
    joint = joint_spectra([pn.with_effect(fixed)] * 2, ["a", "b"])
    at = joint.prior.center
    assert joint.effects == (fixed,)
    again = joint.with_effect(on_instrument(GAIN, "b"))
    assert again.prior.names[-1] == "gain_slope_2.slope"
    moved = again.expected(np.append(at, 1.03)) - joint.expected(at)
    assert np.abs(moved[:102]).max() < 1e-6 < np.abs(moved[102:]).max()


def test_an_instrument_with_a_constant_is_its_source_times_it(pn):
    """What `JointSpectra` asks of an instrument, asked of the second one by itself."""
    noted = replace(pn.response, notes=("mended",), frame_time=None)
    source = XraySpectrum(pn.model, noted, pn.prior)
    joint = joint_spectra([pn, source], ["a", "b"], cross_calibration=LogUniform(0.5, 2.0))
    alone = joint.parts[1].simulator
    assert alone.prior.names[-1] == "cross_calibration_1.factor"
    assert joint.prior.marginals["cross_calibration_2.factor"] == LogUniform(0.5, 2.0)
    assert alone.notes == ("mended",)
    assert dict(alone.not_in_library()) == dict(source.not_in_library())
    # Of both, each says what is the matter with which.
    assert joint.notes == ("b: mended",)
    assert joint.not_in_library() == {"pileup[b]": source.not_in_library()["pileup"]}
    at = np.append(pn.prior.center, 1.25)
    np.testing.assert_allclose(alone.expected(at), 1.25 * pn.expected(at[:-1]), rtol=1e-12)
    np.testing.assert_allclose(
        alone.with_exposure(3 * pn.exposure).expected(at), 3 * alone.expected(at), rtol=1e-9
    )
    # Whatever the constant, no channel expects less than the floor.
    assert alone.expected(np.append(pn.prior.center, 1e-30)).min() == 1e-6
    lined = alone.with_effect(LINE)
    assert lined.prior.names[-1] == "cross_calibration_1.factor"
    assert lined.prior.names[-2] == "emission_line_1.norm"
    told = alone.describe()
    assert told["source"] == source.describe()
    assert told["cross_calibration_1.factor"] == LogUniform(0.5, 2.0).describe()
    assert set(alone.effect_library(at[None])) == set(source.effect_library(at[None, :-1]))
    with double_precision():
        np.testing.assert_allclose(alone.expected_jax(at), alone.expected(at), rtol=1e-12)
