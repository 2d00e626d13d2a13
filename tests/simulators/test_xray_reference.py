"""The reference case reproduces the published spectra count by count."""

import json
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from gaugeblock.core.errors import InputError

pytest.importorskip("jaxspec")
from gaugeblock.simulators.xray import double_precision, family, published, reference

pytestmark = pytest.mark.usefixtures("xray_data")

STRENGTH = {"B1": 3e-4, "B4": 3}


@lru_cache
def simulator_of(family_name, level):
    simulator = reference(level=level)
    if family_name == "clean":
        return simulator
    return simulator.with_effect(family(family_name, STRENGTH[family_name]))


def simulated(row):
    """Counts of one published spectrum, from its seed, by the published rule."""
    import jax

    theta = published.theta(row["n_at_draw"], row["seed"])
    index = int(row["spectrum_id"].split("|")[-1])
    np.testing.assert_allclose(theta[index], row["theta"], rtol=1e-12)
    expected = simulator_of(row["family"], row["level"]).expected(theta)
    if row["family"] == "clean":
        return np.random.default_rng(row["seed"] + 1).poisson(expected)[index]
    with double_precision():
        key = jax.random.split(jax.random.PRNGKey(row["seed"]))[1]
        return np.asarray(jax.random.poisson(key, expected))[index]


def assert_published(rows, pairs):
    for row in rows:
        assert np.array_equal(simulated(row), row["counts"]), row["spectrum_id"]
    for pair in pairs:
        for change, name in (("clean", "counts_clean"), ("B4", "counts_gain")):
            simulator = simulator_of(change, "medium")
            counts = np.random.default_rng(1000 + pair["i"]).poisson(simulator.expected(pair["theta"]))
            assert np.array_equal(counts, pair[name]), (pair["i"], name)


def test_an_excerpt_of_the_published_spectra_is_reproduced_count_by_count():
    excerpt = json.loads((Path(__file__).parent / "published_spectra.json").read_text())
    assert_published(excerpt["rows"], excerpt["pairs"])


def test_all_published_spectra_are_reproduced_count_by_count(shared_file):
    rows = json.loads(shared_file("paper/reference/ns_spectra_reconstructed.json").read_text())["rows"]
    pairs = json.loads(shared_file("paper/reference/paired_pairs_reconstructed.json").read_text())["rows"]
    assert (len(rows), len(pairs)) == (76, 12)
    assert_published(rows, pairs)
    totals = json.loads(shared_file("paper/reference/ns_bench.json").read_text())["rows"]
    assert {row["id"]: row["n_counts"] for row in totals} == {
        row["spectrum_id"]: sum(row["counts"]) for row in rows
    }


def test_families_are_what_the_study_says_they_are():
    found = {name: family(name, strength).fixed for name, strength in
             (("B1", 2e-5), ("B2", 0.7), ("B3", 5.0), ("B4", 2.0))}  # fmt: skip
    assert found == {
        "B1": {"energy": 6.4, "sigma": 0.05, "norm": 2e-5}, "B2": {"fraction": 0.7}, "B3": {"kT": 5.0},
        "B4": {"factor": 1.02},
    }  # fmt: skip


def test_median_counts_are_the_published_ones():
    medium, theta = reference(), published.theta(20_000, 20260612)
    for level, median in (("faint", 98.2), ("medium", 982.8), ("bright", 9827.5)):
        seconds = reference(level=level).exposure
        totals = medium.with_exposure(seconds).expected(theta).sum(axis=-1)
        assert round(float(np.median(totals)), 1) == median


def test_nicer_has_about_the_counts_that_its_levels_promise():
    medium, theta = reference("nicer"), published.theta(2_000, 20260612)
    assert medium.data_shape == (970,)
    for level, target in (("faint", 100), ("medium", 1000), ("bright", 10_000)):
        seconds = published.EXPOSURES["nicer"][level]
        median = np.median(medium.with_exposure(seconds).expected(theta).sum(axis=-1))
        assert median == pytest.approx(target, rel=0.12)


def test_nicer_takes_other_files_by_path(xray_data):
    from gaugeblock.simulators.xray import data

    rmf, arf = data.path("nicer.rmf"), data.path("nicer.arf")
    theta = published.theta(3, 1)
    by_path = reference("nicer", rmf=rmf, arf=arf)
    assert np.array_equal(by_path.expected(theta), reference("nicer").expected(theta))
    with pytest.raises(InputError, match="both rmf and arf"):
        reference("nicer", rmf=rmf)
    with pytest.raises(InputError, match="response='nicer' only"):
        reference(rmf=rmf, arf=arf)


def test_the_reference_is_the_contract():
    simulator = reference()
    assert simulator.prior.names == (
        "tbabs_1.nh", "powerlaw_1.alpha", "powerlaw_1.norm", "blackbodyrad_1.kT", "blackbodyrad_1.norm",
    )  # fmt: skip
    assert simulator.data_shape == (102,)
    assert simulator.exposure == 353.4
    assert simulator.channels[0, 0] == pytest.approx(0.52154797)
    assert simulator.channels[-1, 1] == pytest.approx(7.795)
    np.testing.assert_allclose(simulator.channels[1:, 0], simulator.channels[:-1, 1], rtol=1e-12)
    assert json.loads(json.dumps(simulator.describe())) == simulator.describe()


def test_the_linear_norm_prior_goes_by_name_only():
    assert reference().prior == published.REFERENCE_PRIOR
    linear = reference(prior="published_linear_norm").prior
    assert linear == published.LINEAR_NORM_PRIOR
    assert linear != published.REFERENCE_PRIOR
    assert linear.bounds.tolist() == published.REFERENCE_PRIOR.bounds.tolist()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"response": "chandra"}, "epic-pn, nicer"),
        ({"level": "dazzling"}, "faint, medium, bright"),
        ({"prior": "flat"}, "published_linear_norm"),
        ({"model": "tbabs*powerlaw"}, "blackbodyrad_1.kT"),
    ],
)
def test_unknown_names_are_one_line(arguments, words):
    with pytest.raises(InputError, match=words) as caught:
        reference(**arguments)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["B1", "B2", "B3", "B4"])
def test_every_published_family_applies_at_every_strength(name):
    simulator = reference()
    theta = published.theta(64, 5)
    plain = simulator.expected(theta).sum(axis=-1)
    changes = []
    for strength in published.STRENGTHS[name]:
        changed = simulator.with_effect(family(name, strength))
        assert changed.prior == simulator.prior
        changes.append(np.median(np.abs(changed.expected(theta).sum(axis=-1) / plain - 1.0)))
    # Stronger is further away; B3 is no small perturbation at any temperature.
    assert name == "B3" or changes == sorted(changes)
    assert min(changes) > 1e-5
    with pytest.raises(InputError, match="B1, B2, B3, B4"):
        family("B5", 1.0)
