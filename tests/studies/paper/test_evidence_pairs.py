"""Paired evidences: what two designs share of their noise, and what is read off the pairs."""

import numpy as np
import pytest
import xarray as xr
from studies.paper import reproduce, run
from studies.paper.experiments import PAST
from studies.paper.experiments.evidence_pairs import DESIGNS, LEVELS, summaries
from studies.paper.experiments.gain_pairs import MEMBERS, GainPairs


@pytest.fixture(scope="module")
def medium(xray_data):
    return GainPairs("medium")


def correlation(theta, counts, pairs):
    means = dict(zip(MEMBERS, pairs.means(theta, 3.0), strict=True))
    noise = [(counts[member] - means[member]) / np.sqrt(means[member]) for member in MEMBERS]
    return np.corrcoef(noise[0].ravel(), noise[1].ravel())[0, 1]


def test_the_same_seed_is_not_the_same_noise(medium):
    theta, coupled = medium.drawn(200, 3.0, np.random.default_rng(1))
    seeded = medium.seeded(theta, 3.0, np.arange(1000, 1200))
    # The study's twelve pairs have 0.40; whole spectra decide, so 200 of them know it to 0.02.
    assert correlation(theta, seeded, medium) == pytest.approx(0.40, abs=0.06)
    assert correlation(theta, coupled, medium) > 0.95


def test_a_seeded_pair_is_that_of_its_seeds_alone(medium):
    theta = medium.simulator.prior.sample(3, np.random.default_rng(2))
    every = medium.seeded(theta, 3.0, np.array([5, 6, 7]))
    one = medium.seeded(theta[1:2], 3.0, np.array([6]))
    for member in MEMBERS:
        np.testing.assert_array_equal(every[member][1:2], one[member])


@pytest.fixture
def table():
    """Differences of known mean, scatter and dependence on the counts."""
    rng = np.random.default_rng(3)
    shape = (len(LEVELS), len(DESIGNS), 400)
    first = rng.normal(-500.0, 50.0, size=shape)
    counts = np.full(shape, 1000.0)
    ratio = 0.02 * rng.standard_normal(shape) + 0.01
    difference = 0.5 - 100.0 * ratio + 0.3 * rng.standard_normal(shape)
    dims = ("level", "design", "pair", "member")
    return xr.Dataset(
        {
            "log_evidence": (dims, np.stack([first, first + difference], axis=-1)),
            "error": (dims, np.full((*shape, 2), 0.1)),
            "counts": (dims, np.stack([counts, counts * np.exp(ratio)], axis=-1)),
        },
        coords={"level": list(LEVELS), "design": list(DESIGNS)},
    )


def test_the_numbers_of_known_pairs_come_out(table):
    for said in summaries(table).values():
        assert said["equal"] == pytest.approx(0.5, abs=4.0 * said["equal_error"])
        assert said["equal_error"] == pytest.approx(0.3 / np.sqrt(400) * np.sqrt(1.25), rel=0.15)
        assert said["slope"] == pytest.approx(-100.0, abs=4.0)
        assert said["mean"] == pytest.approx(-0.5, abs=4.0 * said["error"])
        assert said["twelve"] == pytest.approx(np.sqrt(2.0**2 + 0.3**2) / np.sqrt(12.0), rel=0.15)
        assert said["chance"] == pytest.approx(2 * 0.1**2 / 4.09, rel=0.3)


def test_it_runs_where_it_is_named_and_needs_no_claim(tmp_path, monkeypatch, table):
    monkeypatch.setattr("studies.paper.run.made", lambda *_, **__: table)
    result = reproduce(["evidence_pairs"], tmp_path, seed=1)
    assert (result.judgements, list(result.tables), result.exit_code) == ((), ["evidence_pairs"], 0)
    with xr.open_datatree(tmp_path / "reproduction.nc", engine="netcdf4") as stored:
        assert "evidence_pairs" in stored.children
    assert run.selected(())[1][-len(PAST) :] == PAST
    assert PAST[0] == "evidence_pairs"
    assert run.selected(("gm.quad",))[1] == ("published",)
