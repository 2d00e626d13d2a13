"""X-ray simulators from plain options, as in a configuration file."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import Effect, LogUniform, Uniform

pytest.importorskip("jaxspec")
from gaugeblock.simulators.registry import build_simulator
from gaugeblock.simulators.xray import data, published, reference
from gaugeblock.simulators.xray.build import read_effect

pytestmark = pytest.mark.usefixtures("xray_data")

POWERLAW = """
[tbabs_1.nh]
distribution = "uniform"
low = 0.1
high = 0.4

["powerlaw_1.alpha"]
distribution = "normal"
mean = 2.0
sd = 0.3

[powerlaw_1.norm]
distribution = "log_uniform"
low = 1e-5
high = 1e-2
"""


def files(*names):
    return {name.split(".")[-1]: data.path(data.EXAMPLE + name) for name in names}


def test_without_options_it_is_the_reference_case():
    assert build_simulator("xray").describe() == reference().describe()
    bright = build_simulator("xray", response="nicer", level="bright", priors="published_linear_norm")
    assert bright.describe() == reference("nicer", "bright", prior="published_linear_norm").describe()


def test_a_model_with_priors_from_a_toml_file(tmp_path):
    file = tmp_path / "priors.toml"
    file.write_text(POWERLAW)
    simulator = build_simulator("xray", model="TBabs*powerlaw", priors=str(file), exposure=50.0)
    assert simulator.prior.names == ("tbabs_1.nh", "powerlaw_1.alpha", "powerlaw_1.norm")
    assert simulator.prior.marginals["tbabs_1.nh"] == Uniform(0.1, 0.4)
    assert simulator.exposure == 50.0


def test_the_priors_own_order_is_the_order_of_theta():
    marginals = reference().prior.marginals
    turned = {name: marginals[name].describe() for name in reversed(marginals)}
    simulator = build_simulator("xray", priors=turned)
    assert simulator.prior.names == tuple(reversed(marginals))
    theta = published.theta(4, 1)
    assert np.array_equal(simulator.expected(theta[:, ::-1]), reference().expected(theta))


def test_files_of_ones_own():
    from_files = build_simulator(
        "xray",
        **files("PN.rmf", "PN.arf"),
        pha=data.path(data.EXAMPLE + "PN_spectrum_grp20.fits"),
        band=[0.5, 8.0],
        exposure=353.4,
    )
    theta = published.theta(4, 1)
    assert np.array_equal(from_files.expected(theta), reference().expected(theta))


def test_systematic_errors_of_a_spectrum_are_noted(tmp_path):
    from astropy.io import fits

    with fits.open(data.path(data.EXAMPLE + "PN_spectrum_grp20.fits")) as file:
        file["SPECTRUM"].header["SYS_ERR"] = 0.02
        file.writeto(tmp_path / "s.pha")
    options = {**files("PN.rmf", "PN.arf"), "pha": tmp_path / "s.pha", "band": [0.5, 8.0]}
    assert "SYS_ERR" in build_simulator("xray", **options).notes[0]


def test_an_effect_is_read_as_it_is_or_from_its_table():
    effect = Effect("gain_slope", {"slope": Uniform(0.9, 1.1)})
    assert read_effect(effect) is effect
    table = {"name": "gain_slope", "slope": {"distribution": "uniform", "low": 0.9, "high": 1.1}}
    assert read_effect(table) == effect


def test_effects_from_tables():
    simulator = build_simulator(
        "xray",
        effects=[
            {"name": "gain_slope", "slope": 1.01},
            {
                "name": "emission_line",
                "energy": 6.4,
                "sigma": 0.05,
                "norm": {"distribution": "log_uniform", "low": 1e-6, "high": 1e-3},
            },
            Effect("gain_offset", {"offset": 0}),
        ],
    )
    assert simulator.prior.marginals["emission_line_1.norm"] == LogUniform(1e-6, 1e-3)
    assert [effect.name for effect in simulator.effects] == ["gain_slope", "emission_line", "gain_offset"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"colour": "red"}, "colour"),
        ({"background": "b.pha"}, "background"),
        ({"model": "tbabs*powerlaw"}, "blackbodyrad_1.kT, blackbodyrad_1.norm, which it does not have"),
        (
            {"model": "tbabs*(powerlaw+bbodyrad+gauss)"},
            "no prior for gauss_1.El, gauss_1.norm, gauss_1.sigma",
        ),
        ({"priors": "nowhere.toml"}, "nowhere.toml"),
        ({"priors": {"tbabs_1.nh": {"distribution": "cauchy"}}}, "tbabs_1.nh"),
        ({"priors": {"tbabs_1.nh": 0.2}}, "needs a table"),
        ({"arf": "x.arf"}, "need the rmf"),
        ({"band": [0.5, 8.0]}, "need the rmf"),
        ({"rmf": "x.rmf", "level": "faint"}, "leave them out"),
        ({"rmf": "x.rmf", "arf": "x.arf"}, "needs exposure"),
        ({"rmf": "x.rmf", "arf": "x.arf", "exposure": 1.0}, "x.rmf: no such file"),
        ({"rmf": "x.rmf", "exposure": 1.0, "band": [1.0]}, "two energies"),
        ({"exposure": -3}, "positive number of seconds"),
        ({"effects": [{"slope": 1.0}]}, "needs a name"),
        ({"effects": ["gain_slope"]}, "needs a name"),
        ({"effects": [{"name": "gain_slope", "slope": "big"}]}, "number or a distribution"),
        ({"effects": [{"name": "gain_slope", "slope": True}]}, "number or a distribution"),
        ({"effects": [{"name": "sunspots"}]}, "sunspots"),
    ],
)
def test_wrong_options_are_one_line(options, words):
    with pytest.raises(InputError, match=words) as caught:
        build_simulator("xray", **options)
    assert "\n" not in str(caught.value)


def test_a_prior_file_that_is_no_toml_is_named(tmp_path):
    file = tmp_path / "p.toml"
    for text in ("tbabs = [", "a = 3", '[x]\ndistribution = "uniform"\nlow = 2\nhigh = 1'):
        file.write_text(text)
        with pytest.raises(InputError, match=r"p\.toml"):
            build_simulator("xray", priors=str(file))
    file.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match=r"p\.toml"):
        build_simulator("xray", priors=str(file))
