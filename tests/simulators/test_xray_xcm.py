"""XSPEC's saved models come in with what is frozen and tied and go out again; priors say the same."""

import numpy as np
import pytest

from gaugeblock.core.errors import InputError
from gaugeblock.simulators import Effect, Prior, Uniform

pytest.importorskip("jaxspec")
from gaugeblock.simulators.xray import (
    XraySpectrum,
    joint_spectra,
    read_xcm,
    reference,
    with_background,
    write_xcm,
)
from gaugeblock.simulators.xray.build import settled
from gaugeblock.simulators.xray.expression import parameter_names, parse
from gaugeblock.simulators.xray.observation import at_redshift

SAVED = """statistic cstat
method leven 10 0.01
abund wilm
systematic 0
model  constant*TBabs(zpowerlw + zgauss + zgauss)
              1      -0.01          0          0      1e+10      1e+10
          0.034      0.001          0          0     100000      1e+06
           1.73       0.01         -3         -2          9         10
          0.158      -0.01     -0.999     -0.999         10         10
          0.012       0.01          0          0      1e+20      1e+24
            6.4       0.05          0          0      1e+06      1e+06
           0.01      -0.05          0          0         10         20
= p4
        0.00021       0.01          0          0      1e+20      1e+24
= 1.1*p6 + 0.02
= 7
= p4
= 0.13*p9
bayes off
"""


@pytest.fixture
def saved(tmp_path):
    def write(text):
        (tmp_path / "fit.xcm").write_text(text)
        return tmp_path / "fit.xcm"

    return write


def test_a_saved_model_comes_in_with_what_is_frozen_and_tied(saved):
    read = read_xcm(saved(SAVED))
    assert read.model == (
        "constant(norm=1.0)*(tbabs*(zpowerlw(redshift=0.158)+zgauss(sigma=0.01, redshift=0.158)"
        "+zgauss(El=1.1*zgauss_1.El+0.02, sigma=0.01, redshift=0.158, norm=0.13*zgauss_1.norm)))"
    )
    assert read.values == {
        "tbabs_1.nh": 0.034, "zpowerlw_1.alpha": 1.73, "zpowerlw_1.norm": 0.012, "zgauss_1.El": 6.4,
        "zgauss_1.norm": 0.00021,
    }  # fmt: skip
    assert settled(str(saved(SAVED)), None) == (read.model, None)


def test_what_goes_out_comes_in_again(saved):
    model = "tbabs(nh=0.02)*tbpcf*(powerlaw+gaussian+gaussian(El=gauss_1.El, norm=0.13*gauss_1.norm+0.0))"
    model += "+cflux(Emin=2.0)*bbody"
    values = {name: 0.5 + k / 7 for k, name in enumerate(parameter_names(parse(model)))}
    text = write_xcm(model, values)
    # XSPEC's tbpcf has a redshift too.
    head = "model  tbabs*tbpcf*(powerlaw+gaussian+gaussian)+cflux*bbody"
    covering = [repr(values[f"tbpcf_1.{p}"]) for p in ("nh", "f")]
    assert text.splitlines()[:5] == [head, "0.02 -1", *covering, "0.0 -1"]
    back = read_xcm(saved(text))
    assert parse(back.model) == parse(model)
    assert back.values == values
    with pytest.raises(InputError, match=r"needs a value of tbpcf_1\.nh"):
        write_xcm(model, {})


def test_further_data_groups_may_differ_in_a_constant_alone(saved):
    # Commas and empty lines are XSPEC's too, and a slash ends a row.
    one = "model  constant*powerlaw\n1 -0.01\n\n1.7, 0.01 /\n/\n0.1 0.01\n"
    assert read_xcm(saved(one)).values == {"powerlaw_1.alpha": 1.7, "powerlaw_1.norm": 0.1}
    assert read_xcm(saved(one + "1.1 0.01\n= p2\n= p3\n")).model == "constant(norm=1.0)*powerlaw"
    with pytest.raises(InputError, match=r"powerlaw_1\.alpha of data group 2 is not tied"):
        read_xcm(saved(one + "1.1 0.01\n1.9 0.01\n= p3\n"))


def test_a_norm_under_a_flux_is_a_number_whatever_the_file_says(saved):
    read = read_xcm(saved("model cflux*po\n0.5 -1\n10 -1\n-12 0.1\n1.7 0.1\n3 0.1\n"))
    assert parse(read.model) == parse("cflux*powerlaw(norm=1)")
    assert read.values == {"cflux_1.lg10Flux": -12.0, "powerlaw_1.alpha": 1.7}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("statistic cstat\n", "holds 0 models"),
        ("model po\n1.7\n1\nmodel 2:b po\n1\n1\n", "holds 2 models"),
        ("model po\n1.7\n", "has 2 parameters .* but 1 follow"),
        ("model phabs*apec\n1\n1\n", "atable"),
        ("model tbpcf*po\n1\n0.5\n0.3\n1.7\n1\n", "redshift is not offered; it has to be 0"),
        ("model po\n= p9\n1\n", "no parameter 9"),
    ],
)
def test_what_cannot_be_read_is_one_line(saved, text, words):
    with pytest.raises(InputError, match=words) as caught:
        read_xcm(saved(text))
    assert "fit.xcm" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_priors_may_hold_numbers_and_ties(tmp_path):
    (tmp_path / "p.toml").write_text(
        'tbabs_1.nh = 0.02\n"gauss_1.El" = 6.4\n"gauss_2.norm" = "0.13*gauss_1.norm"\n'
        '[powerlaw_1.alpha]\ndistribution = "uniform"\nlow = 1.0\nhigh = 2.0\n'
    )
    model, prior = settled("tbabs*(po+ga+ga)", tmp_path / "p.toml")
    assert model == "tbabs(nh=0.02)*(powerlaw+gaussian(El=6.4)+gaussian(norm=0.13*gauss_1.norm))"
    assert prior.describe() == Prior({"powerlaw_1.alpha": Uniform(1.0, 2.0)}).describe()
    # Where nothing is free, there is no prior.
    fixed = {"powerlaw_1": {"alpha": 2, "norm": 0.5}}
    assert settled("po", fixed) == ("powerlaw(alpha=2.0, norm=0.5)", None)
    with pytest.raises(InputError, match=r"p\.toml: model 'po': has no tbabs_1\.nh"):
        settled("po", tmp_path / "p.toml")
    with pytest.raises(InputError, match="a number or a tie, got True"):
        settled("po", {"powerlaw_1.alpha": True})


def test_redshifts_that_nobody_gave_are_the_source_s():
    model = "tbabs*zphabs*(zpowerlw+zgauss(redshift=0.5))*ztbabs"
    given = Prior({"zphabs_1.redshift": Uniform(0.0, 1.0)})
    assert at_redshift(model, given, 0.3) == (
        "tbabs*zphabs*(zpowerlw(redshift=0.3)+zgauss(redshift=0.5))*ztbabs(z=0.3)"
    )


THETA = [0.2, 1.7, 3e-3, 0.5, 40.0]
LINE = {"energy": 2.31, "sigma": 0.004, "norm": 4e-4}
SOFT = {"kT": 0.11, "norm": 300.0}
GAS = {"kT": 1.3, "norm": 2e-3}
"""Effects that emit."""

LOST = {
    "absorption_line": {"energy": 1.5, "sigma": 0.08, "strength": 0.03},
    "absorption_edge": {"energy": 2.0, "depth": 0.4},
    "partial_covering": {"nh": 3.0, "fraction": 0.6},
    "high_energy_cutoff": {"energy": 3.0, "inverse_folding": 0.2},
}
"""Effects that are factors."""


def values_of(simulator, theta):
    return dict(zip(simulator.prior.names, theta, strict=True))


def folded(text, saved, response):
    """Counts of a saved model, read back as a user's `--model` is, at the values it was saved with."""
    read = read_xcm(saved(text))
    prior = Prior({name: Uniform(0.0, 1e9) for name in read.values})
    return XraySpectrum(read.model, response, prior, integration="exact").expected(list(read.values.values()))


@pytest.fixture(scope="module")
def plain(xray_data):
    spectrum = reference(level="bright")
    return XraySpectrum(spectrum.model, spectrum.response, spectrum.prior, integration="exact")


def test_a_fit_with_what_was_added_folds_to_the_same_counts_when_it_is_read(plain, saved):
    before = plain.xcm(values_of(plain, THETA), ())
    assert before.splitlines()[:3] == ["statistic cstat", "abund wilm", "model  tbabs*(powerlaw+bbodyrad)"]
    np.testing.assert_allclose(folded(before, saved, plain.response), plain.expected(THETA), rtol=1e-9)
    found = [("emission_line", LINE), ("soft_excess", SOFT), ("emission_line", {**LINE, "energy": 6.4})]
    found.append(("thermal_continuum", GAS))
    made, values = plain, values_of(plain, THETA)
    for name, at in found:
        made = made.with_effect(Effect(name, at))
        number = 1 + sum(key.endswith(".norm") and key.startswith(name) for key in values)
        values |= {f"{name}_{number}.{key}": value for key, value in at.items()}
    free = [Effect(name, dict.fromkeys(at, Uniform(0.0, 1e3))) for name, at in found]
    text = plain.xcm(values, tuple(free))
    assert "model  tbabs*(powerlaw+bbodyrad+gaussian+bbodyrad+gaussian+cutoffpl)" in text
    assert "\n1.0 -1\n1.3\n0.002\n" in text
    np.testing.assert_allclose(folded(text, saved, plain.response), made.expected(THETA), rtol=1e-9)
    # What is fixed in the simulator is told as well, and a background is not.
    assert made.xcm(values_of(plain, THETA), ()) == text
    both = with_background(plain, np.ones(102), 1.0)
    middle = values_of(both, both.prior.center)
    assert both.xcm(middle, ()) == plain.xcm(middle, ())


@pytest.mark.parametrize("name", LOST)
def test_a_factor_stands_in_front_and_differs_within_bins_alone(plain, saved, name):
    made = plain.with_effect(Effect(name, LOST[name]))
    text = plain.xcm(values_of(plain, THETA), (Effect(name, LOST[name]),))
    np.testing.assert_allclose(folded(text, saved, plain.response), made.expected(THETA), rtol=2e-4)
    assert not np.allclose(plain.expected(THETA), made.expected(THETA), rtol=1e-2)


def test_a_cutoff_that_is_none_is_at_xspec_s_end(plain):
    at = {"energy": 3.0, "inverse_folding": 0.0}
    text = plain.xcm(values_of(plain, THETA), (Effect("high_energy_cutoff", at),))
    assert "\n3.0\n1000000.0\n" in text


def test_instruments_are_data_groups_that_differ_in_a_constant(plain, saved):
    joint = joint_spectra([plain, plain, plain], ["a", "b", "c"])
    values = values_of(joint, [*THETA, 1.1, 0.9])
    text = joint.xcm(values, (Effect("emission_line", LINE),))
    rows = text.splitlines()
    assert rows[2] == "model  constant*(tbabs*(powerlaw+bbodyrad+gaussian))"
    assert rows[3] == "1.0 -1"
    tied = [f"= p{k}" for k in range(2, 10)]
    assert rows[12:] == ["1.1", *tied, "0.9", *tied]
    made = plain.with_effect(Effect("emission_line", LINE))
    np.testing.assert_allclose(folded(text, saved, plain.response), made.expected(THETA), rtol=1e-9)


@pytest.mark.parametrize(
    "effect",
    [
        Effect("gain_slope", {"slope": 1.01}), Effect("mine", {}), Effect("gain_slope[pn]", {}),
        Effect("emission_line", LINE, kind=len), Effect("emission_line", {"energy": 6.4}),
    ],
)  # fmt: skip
def test_what_xspec_has_no_component_for_is_refused(plain, effect):
    with pytest.raises(InputError, match=rf"XSPEC has no component .* {effect.name.partition('[')[0]}"):
        plain.xcm(values_of(plain, THETA), (effect,))
