"""Scatter between trainings: drawn together by its moments, and read off what is kept."""

import numpy as np
import pytest
from scipy import stats
from studies.paper import claims
from studies.paper.experiment import committed
from studies.paper.numbers import by_claim
from studies.paper.trainings import Scatter, between_networks, is_paired, moderated, scatter


def test_the_prior_is_found_again_from_many_variances():
    """20,000 groups of 4 degrees of freedom, prior 10 and 0.5: a posterior of 14, within 5% (seeded)."""
    rng = np.random.default_rng(7)
    n, prior, scale, df = 20_000, 10.0, 0.5, 4.0
    true = scale * prior / stats.chi2.rvs(prior, size=n, random_state=rng)
    seen = true * stats.chi2.rvs(df, size=n, random_state=rng) / df
    variance, total = moderated(seen, np.full(n, df))
    assert total[0] == pytest.approx(df + prior, rel=0.05)
    np.testing.assert_allclose(variance, (prior * scale + df * seen) / (df + prior), rtol=0.05)
    # What is moderated has the t law that its degrees of freedom say: 10% beyond the 90% interval.
    t = rng.normal(size=n) * np.sqrt(true) / np.sqrt(variance)
    assert np.mean(np.abs(t) > stats.t.ppf(0.95, total)) == pytest.approx(0.1, abs=0.011)


def test_variances_that_scatter_no_more_than_they_must_are_one():
    variance, total = moderated(np.array([1.0, 1.6]), np.array([3.0, 6.0]))
    np.testing.assert_allclose(variance, 1.4)
    assert np.isinf(total).all()


def test_a_difference_of_two_trainings_has_twice_the_variance():
    assert Scatter(3.0, 5.0).error == pytest.approx(3.0 * 2**0.5)
    assert Scatter(3.0, 5.0, trainings=9).error == pytest.approx(3.0 * (10 / 9) ** 0.5)


def test_networks_are_compared_on_spectra_in_common_alone():
    values = between_networks()
    assert {key: len(found) for key, found in values.items()} == {
        (level, detector): number
        for level, number in (("medium", 13), ("bright", 16))
        for detector in ("D1", "D2", "D3")
    }
    one, other = (committed(name)["auc"].sel(response="epic-pn") for name in ("detection", "detection_nicer"))
    place = {"level": "bright", "family": "B1", "strength": 0, "detector": "D2"}
    error = claims()["grid.pn.bright.B1.5e-06.D2"].error["value"]
    assert values["bright", "D2"][0] * 2**0.5 * error == pytest.approx(
        float((one - other).sel({k: v for k, v in place.items() if k != "strength"})[0])
    )


def test_eighty_seven_cells_are_of_the_studys_own_spectra():
    paired = [name for name, claim in claims().items() if is_paired(claim)]
    assert len(paired) == 87
    assert "grid.pn.medium.B1.0.0003.D1" in paired
    assert "grid.pn.medium.B1.5e-06.D3" not in paired
    assert not [name for name in paired if not name.startswith("grid.pn.")]


def test_deviations_scatter_as_the_kept_trainings_do():
    ours = by_claim(committed("calibration_retrained")) | by_claim(committed("calibration_published"))
    names = ("tab2.reseed101", "tab2.reseed202", "tab2.reseed303", "tab2.uncapped")
    both = [[ours[name]["dev"] for name in names], [claims()[name].parts["dev"] for name in names]]
    known = scatter(claims()["cal.dev.pn.bright"], "value")
    assert known.sd == pytest.approx(np.sqrt(np.var(both, axis=1, ddof=1).mean()))
    assert known.df == 6
    assert scatter(claims()["tab2.reseed101"], "dev") == known


def test_where_no_second_training_is_kept_nothing_is_said():
    for name in ("cal.dev.nicer.bright", "is.khat.B1.medium", "gm.bias.bright", "cal.recovery.r"):
        assert scatter(claims()[name], "value") is None
    assert scatter(claims()["tab2.uncapped"], "failures") is None


def test_faint_cells_take_the_scatter_of_medium_ones():
    faint, medium = (claims()[f"grid.nicer.{level}.B1.2e-05.D2"] for level in ("faint", "medium"))
    shares = [scatter(claim, "value").sd / claim.error["value"] for claim in (faint, medium)]
    assert shares[0] == pytest.approx(shares[1])


def test_the_scatter_is_about_nothing_not_about_the_mean():
    """A network that moves all cells of a detector alike scatters by that: D3 at bright mostly does."""
    values = between_networks()["bright", "D3"]
    assert abs(values.mean()) > values.std()
    found = scatter(claims()["grid.pn.bright.B1.2e-05.D3"], "value")
    error = claims()["grid.pn.bright.B1.2e-05.D3"].error["value"]
    assert found.sd > 0.9 * error * np.sqrt((values**2).mean())
