"""Scatter between trainings: drawn together by its moments, and read off what is kept."""

import numpy as np
import pytest
from scipy import stats
from studies.paper import claims
from studies.paper.experiment import committed
from studies.paper.numbers import by_claim
from studies.paper.paper_flow import TRAININGS
from studies.paper.trainings import (
    Scatter,
    between_trainings,
    common_share,
    freedom,
    is_paired,
    moderated,
    pooled,
    scatter,
)


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
    assert Scatter(3.0, 5.0).error(1) == pytest.approx(3.0 * 2**0.5)
    assert Scatter(3.0, 5.0).error(9) == pytest.approx(3.0 * (10 / 9) ** 0.5)


def simulated(rng, *, groups, trainings, cells, share, sd):
    """AUCs less their means over trainings, of which cells of a group have a share in common."""
    common = rng.normal(size=(groups, trainings, 1))
    own = rng.normal(size=(groups, trainings, cells))
    values = sd * (share**0.5 * common + (1.0 - share) ** 0.5 * own)
    return values - values.mean(axis=1, keepdims=True)


@pytest.mark.parametrize("share", [0.0, 0.4, 0.9])
def test_cells_of_a_group_lend_each_other_their_scatter_as_far_as_they_are_apart(share):
    """400 groups of 16 cells by five trainings: the variance to 5%, its own scatter to what freedom says."""
    values = simulated(np.random.default_rng(2), groups=400, trainings=5, cells=16, share=share, sd=0.7)
    seen, worth = (values**2).sum(axis=(1, 2)) / 64.0, freedom(5, 16, share)
    assert seen.mean() == pytest.approx(0.49, rel=0.05)
    assert seen.var() == pytest.approx(2.0 * seen.mean() ** 2 / worth, rel=0.25)
    variance, df = pooled(values)
    # Groups that are all alike lend each other nearly everything.
    np.testing.assert_allclose(variance, 0.49, rtol=0.1)
    assert df.min() > 5.0 * worth


def test_groups_that_are_unlike_keep_to_themselves():
    rng = np.random.default_rng(4)
    apart = [
        simulated(rng, groups=1, trainings=5, cells=16, share=0.3, sd=sd)[0] for sd in (0.1, 1.0, 10.0) * 5
    ]
    variance, df = pooled(apart)
    np.testing.assert_allclose(np.sqrt(variance), np.tile([0.1, 1.0, 10.0], 5), rtol=0.5)
    assert df.max() < 64.0


def test_trainings_are_compared_on_the_same_spectra():
    """Of what is committed: all trainings, 16 cells of each detector and level, about their own mean."""
    values = between_trainings()
    assert {key: found.shape for key, found in values.items()} == {
        ("pn", level, detector): (len(TRAININGS), 16)
        for level in ("faint", "medium", "bright")
        for detector in ("D1", "D2", "D3")
    }
    table = committed("detection")
    row = table["claim"].values.tolist().index("grid.pn.bright.B1.5e-06.D2")
    mine = table["trained"].values[:, row]
    error = claims()["grid.pn.bright.B1.5e-06.D2"].error["value"]
    assert table["number"].values[row] == pytest.approx(mine.mean())
    np.testing.assert_allclose(values["pn", "bright", "D2"][:, 0] * error, mine - mine.mean(), atol=1e-12)


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
    known = scatter(claims()["tab2.uncapped"], "dev")
    assert known.sd == pytest.approx(np.sqrt(np.var(both, axis=1, ddof=1).mean()))
    assert known.df == 6
    assert scatter(claims()["tab2.reseed101"], "dev") == known


def test_a_claim_of_several_trainings_scatters_as_they_do():
    table = committed("line_bias")
    rows = {
        part: table["trained"].values[:, i]
        for i, (claim, part) in enumerate(zip(table["claim"].values, table["part"].values, strict=True))
        if claim == "det.B1.dGamma.bright"
    }
    claim = claims()["det.B1.dGamma.bright"]
    free = len(TRAININGS) - 1.0
    assert scatter(claim, "mean") == Scatter(np.std(rows["mean"], ddof=1), free)
    # A step from one part to another scatters by what it does within a training.
    step = rows["mean"] - rows["medium"]
    assert scatter(claim, "mean", "medium") == Scatter(np.std(step, ddof=1), free)


def test_where_no_second_training_is_kept_nothing_is_said():
    for name in (
        "cal.dev.nicer.bright",
        "gm.bias.bright",
        "xc.bright.capture",
        "grid.nicer.faint.B1.2e-05.D2",
    ):
        assert scatter(claims()[name], "value") is None
    # Of one network, which is not trained again: that it gives the same several times says nothing.
    assert scatter(claims()["tab2.uncapped"], "failures") is None


def test_the_share_in_common_is_found_again():
    """200 groups of 16 with a quarter of their variance in common: 5 errors are 0.06."""
    rng = np.random.default_rng(3)
    groups = 0.5 * rng.normal(size=(200, 1)) + 0.75**0.5 * rng.normal(size=(200, 16))
    assert common_share(groups) == pytest.approx(0.25, abs=0.08)
    assert common_share(rng.normal(size=(200, 16))) < 0.02


def test_the_share_in_common_is_over_pairs():
    assert common_share([np.array([1.0, 1.0]), np.array([-2.0, -2.0])]) == pytest.approx(1.0)
    assert common_share([np.array([1.0, 1.0, 0.0])]) == pytest.approx(0.5)
